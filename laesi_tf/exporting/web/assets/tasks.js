// What the worker does.

import { decodePicture } from "./decode.js";
import { describeMeasurement, makeInputs } from "./measurement.js";
import { Runner } from "./runner.js";
import { loadSentences } from "./sentences.js";
import { makeGuidanceInputs } from "./view.js";

const THUMBNAIL_PX = 240;

const graphs = {};
let canvas;

/** Return the graph of a kind, `photo` or `guidance`, loaded once. */
function loadGraph(kind) {
  graphs[kind] ??= Runner.load(`${kind}.tflite`, kind);
  // A file that could not be loaded is asked for again with the next photo.
  graphs[kind].catch(() => delete graphs[kind]);
  return graphs[kind];
}

export const TASKS = {
  /** Load all that measuring needs. */
  async load() {
    await Promise.all([loadGraph("photo"), loadSentences()]);
  },

  /** Measure a photo, {blob, gridMm}; returns its measurement, its size and a thumbnail. */
  async measure({ blob, gridMm }) {
    const sentences = await loadSentences();
    const graph = await loadGraph("photo");
    const picture = await decodePicture(blob, graph.metadata.input_size[0], sentences.limits);
    const started = performance.now();
    const outputs = await graph.run(makeInputs(picture, gridMm));
    requireNumbers(outputs);
    const measurement = describeMeasurement(outputs, picture, gridMm, sentences);
    return {
      measurement,
      width: picture.photoWidth,
      height: picture.photoHeight,
      milliseconds: performance.now() - started,
      thumbnail: await makeThumbnail(picture),
    };
  },

  /** Return the hint, {hint}, for a preview image, {bitmap}, and the measures that it follows from. */
  async guide({ bitmap }) {
    const graph = await loadGraph("guidance");
    const outputs = await graph.run(makeGuidanceInputs(readPixels(bitmap), graph.metadata));
    return Object.fromEntries(Object.entries(outputs).map(([name, [value]]) => [name, value]));
  },
};

function readPixels(bitmap) {
  const { width, height } = bitmap;
  if (canvas?.width !== width || canvas.height !== height) canvas = new OffscreenCanvas(width, height);
  const context = canvas.getContext("2d", { alpha: false, willReadFrequently: true });
  context.drawImage(bitmap, 0, 0);
  bitmap.close();
  return context.getImageData(0, 0, width, height);
}

/** Throw where LiteRT.js gave numbers that no photo has, as it does in silence for operations it lacks. */
function requireNumbers(outputs) {
  const areas = outputs.area_cm2.subarray(0, outputs.count[0]);
  if (areas.some(Number.isNaN) || (outputs.refusal[0] === 0 && !(outputs.pitch_mm[0] > 0))) {
    throw new Error("this browser computes the measurement wrongly; update it, or use another browser");
  }
}

async function makeThumbnail(picture) {
  const { pixels, width, height } = picture;
  const stride = pixels.length / 3;
  const side = Math.sqrt(stride);
  const image = new ImageData(width, height);
  for (let y = 0, to = 0; y < height; y++) {
    for (let from = y * side * 3; from < (y * side + width) * 3; from += 3, to += 4) {
      image.data[to] = pixels[from];
      image.data[to + 1] = pixels[from + 1];
      image.data[to + 2] = pixels[from + 2];
      image.data[to + 3] = 255;
    }
  }
  const scale = Math.min(1, THUMBNAIL_PX / Math.max(width, height));
  const canvas = new OffscreenCanvas(Math.max(1, Math.round(width * scale)), Math.max(1, Math.round(height * scale)));
  const bitmap = await createImageBitmap(image);
  canvas.getContext("2d").drawImage(bitmap, 0, 0, canvas.width, canvas.height);
  bitmap.close();
  return canvas.convertToBlob({ type: "image/jpeg", quality: 0.8 });
}
