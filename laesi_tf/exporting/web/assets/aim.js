// Aim with a live preview: one hint at a time, green when a photo would be measured.

import { runTask } from "./background.js";
import { find } from "./elements.js";
import { loadSentences } from "./sentences.js";

const CAMERA = { video: { facingMode: { ideal: "environment" }, width: { ideal: 1920 }, height: { ideal: 1440 } } };
// More hints a second than this nobody reads, and they would empty the battery.
const SHORTEST_MS = 120;
// A hint must be given so many times in a row before it is shown, so that hints do not flicker.
const TIMES = 2;
// Preview pixels along the longer side that the guidance looks at.
const PREVIEW_PX = 1280;

let stream;

/** Whether the page can show a preview at all. */
export const canAim = () => Boolean(navigator.mediaDevices?.getUserMedia);

/**
 * Show the preview until the user closes it; `onPhoto` is called with each photo that is taken, a File, and
 * returns a promise of a short text on it. Rejects where there is no camera or no permission.
 */
export async function aim(onPhoto) {
  stream = await navigator.mediaDevices.getUserMedia(CAMERA);
  const dialog = find("aim");
  const video = find("preview");
  video.srcObject = stream;
  showHint("Starting the camera…", "none");
  find("taken").textContent = "";
  dialog.showModal();
  dialog.onclose = stop;
  find("close-aim").onclick = () => dialog.close();
  find("shutter").onclick = () => takePhoto(video, onPhoto);
  find("shutter").focus();
  await video.play();
  guide(video);
}

function stop() {
  for (const track of stream?.getTracks() ?? []) track.stop();
  stream = undefined;
  find("preview").srcObject = null;
}

async function guide(video) {
  const { hints } = await loadSentences();
  const own = stream;
  let last, times;
  let count = 0;
  const began = performance.now();
  while (stream === own && stream) {
    const started = performance.now();
    try {
      const { hint } = await runTask("guide", ...(await grabPreview(video)));
      times = hint === last ? times + 1 : 1;
      last = hint;
      if (times >= TIMES) showHint(hints[hint], hint === 0 ? "good" : "wait");
      // For measurements of the speed.
      find("hint").dataset.perSecond = (++count / ((performance.now() - began) / 1000)).toFixed(2);
    } catch {
      // Without guidance, photos can be taken all the same.
      showHint("Hold the phone parallel to the paper, the whole leaf in the picture.", "none");
    }
    await new Promise((resolve) => setTimeout(resolve, Math.max(0, SHORTEST_MS - (performance.now() - started))));
  }
}

function showHint(text, state) {
  const hint = find("hint");
  if (hint.textContent !== text) hint.textContent = text;
  hint.dataset.state = state;
  find("shutter").classList.toggle("good", state === "good");
}

async function grabPreview(video) {
  const scale = Math.min(1, PREVIEW_PX / Math.max(video.videoWidth, video.videoHeight));
  const size = scale < 1 && {
    resizeWidth: Math.round(video.videoWidth * scale),
    resizeHeight: Math.round(video.videoHeight * scale),
    resizeQuality: "medium",
  };
  const bitmap = await createImageBitmap(video, size || undefined);
  return [{ bitmap }, [bitmap]];
}

async function takePhoto(video, onPhoto) {
  const shutter = find("shutter");
  const taken = find("taken");
  shutter.disabled = true;
  try {
    const blob = await takeStill(video);
    const time = new Date().toISOString().slice(0, 19).replaceAll(":", "").replace("T", "-");
    taken.textContent = "measuring…";
    const photo = onPhoto(new File([blob], `leaf-${time}.jpg`, { type: blob.type }));
    shutter.disabled = false;
    taken.textContent = await photo;
  } catch (error) {
    taken.textContent = `no photo: ${error?.message ?? error}`;
  } finally {
    shutter.disabled = false;
  }
}

/** Return the camera's own photo at full resolution, or the video's frame where there is none. */
async function takeStill(video) {
  const [track] = stream.getVideoTracks();
  if ("ImageCapture" in window) {
    try {
      return await new ImageCapture(track).takePhoto();
    } catch {
      // Some cameras take none while they show a preview.
    }
  }
  const canvas = new OffscreenCanvas(video.videoWidth, video.videoHeight);
  canvas.getContext("2d").drawImage(video, 0, 0);
  return canvas.convertToBlob({ type: "image/jpeg", quality: 0.95 });
}
