// The page: photos come in, are measured one after the other, shown and kept.

import { aim, canAim } from "./aim.js";
import { runTask } from "./background.js";
import { showDetail } from "./detail_view.js";
import { find } from "./elements.js";
import { formatArea, isMeasured, sumAreas } from "./formats.js";
import { showList } from "./list_view.js";
import { readGridMm, setUpSettings } from "./settings.js";
import { deleteAllPhotos, deletePhoto, loadPhotos, savePhoto } from "./store.js";
import { formatCsv, formatJson, makeRecords } from "./tables.js";

const photos = [];
const queue = [];
const finished = new WeakMap();
let isMeasuring = false;

function showAll() {
  find("empty").hidden = photos.length > 0;
  find("results").hidden = photos.length === 0;
  const left = queue.length + (isMeasuring ? 1 : 0);
  const measured = photos.filter(isMeasured).length;
  find("summary").textContent = left ? `measuring, ${left} to go` : photos.length ? `${measured} of ${photos.length} measured` : "";
  showList(photos, openPhoto);
}

function showFault(message) {
  find("fault").textContent = message;
  find("fault").hidden = !message;
}

async function keep(photo) {
  try {
    photo.id = await savePhoto(photo);
  } catch (error) {
    showFault(`This photo is not kept after the page is closed: ${error?.message ?? error}. Save the CSV, then delete photos.`);
  }
}

/** Measure files, in their order, each as a photo of its own; returns these. */
function addFiles(files) {
  const shared = { added: new Date().toISOString(), grid_mm: readGridMm() };
  const added = files.map((file) => ({ file, name: file.name.replace(/\.[^.]+$/, ""), ...shared }));
  photos.push(...added);
  queue.push(...added);
  showAll();
  measureQueue();
  return added;
}

async function measureQueue() {
  if (isMeasuring) return;
  isMeasuring = true;
  while (queue.length) {
    const photo = queue.shift();
    showAll();
    await measurePhoto(photo);
    if (photos.includes(photo)) await keep(photo);
    finished.get(photo)?.();
    if (isOpen(photo)) openPhoto(photo);
  }
  isMeasuring = false;
  showAll();
}

async function measurePhoto(photo) {
  try {
    Object.assign(photo, await runTask("measure", { blob: photo.file, gridMm: photo.grid_mm }), { error: null });
    showFault("");
  } catch (error) {
    Object.assign(photo, { error: error.message, measurement: null });
    if (!error.isOfPicture) showFault(error.message);
  }
}

let opened;
const isOpen = (photo) => opened === photo && find("detail").open;

function openPhoto(photo) {
  opened = photo;
  showDetail(photo, {
    rename: async (_, name) => {
      photo.name = name;
      await keep(photo);
      showAll();
    },
    measureAgain: (_, gridMm) => {
      Object.assign(photo, { measurement: null, error: null, grid_mm: gridMm });
      queue.push(photo);
      openPhoto(photo);
      measureQueue();
    },
    saveFile: () => download(photo.file, photo.file.name),
    remove: async () => {
      find("detail").close();
      photos.splice(photos.indexOf(photo), 1);
      if (photo.id !== undefined) await deletePhoto(photo.id);
      showAll();
    },
  });
}

/** Aim with a live preview, or leave the photo to the camera's own program where there is no preview. */
async function takePhotos() {
  try {
    if (!canAim()) throw new Error("no cameras here");
    await aim(addAimed);
  } catch {
    find("capture").click();
  }
}

/** Measure a photo that was aimed at and return a short text on it. */
async function addAimed(file) {
  const [photo] = addFiles([file]);
  await new Promise((resolve) => finished.set(photo, resolve));
  if (!isMeasured(photo)) return "no area: see the list";
  const [area, uncertainty] = formatArea(...sumAreas(photo.measurement.leaves));
  return `${area} ± ${uncertainty} cm²`;
}

function download(blob, name) {
  const link = Object.assign(document.createElement("a"), { href: URL.createObjectURL(blob), download: name });
  link.click();
  setTimeout(() => URL.revokeObjectURL(link.href), 10_000);
}

async function saveTable(format, type, suffix) {
  const { columns } = await (await fetch("sentences.json")).json();
  const day = new Date().toISOString().slice(0, 10);
  download(new Blob([format(makeRecords(photos), columns)], { type }), `leaf-areas-${day}.${suffix}`);
}

function setUpButtons() {
  find("choose").onclick = () => find("files").click();
  find("take").onclick = takePhotos;
  for (const id of ["files", "capture"]) {
    find(id).onchange = ({ target }) => {
      // A copy, as emptying the field, which lets the same file be chosen again, empties its list.
      const files = [...target.files];
      target.value = "";
      addFiles(files);
    };
  }
  find("save-csv").onclick = () => saveTable(formatCsv, "text/csv", "csv");
  find("save-json").onclick = () => saveTable(formatJson, "application/json", "json");
  find("delete-all").onclick = async () => {
    if (!confirm(`Delete ${photos.length} photos and their results from this device?`)) return;
    photos.length = queue.length = 0;
    await deleteAllPhotos();
    showAll();
  };
}

function setUpDropping() {
  const mark = (isOver) => document.body.classList.toggle("drop", isOver);
  addEventListener("dragover", (event) => {
    event.preventDefault();
    mark(true);
  });
  addEventListener("dragleave", () => mark(false));
  addEventListener("drop", (event) => {
    event.preventDefault();
    mark(false);
    addFiles([...event.dataTransfer.files]);
  });
}

/** Keep the page for use without a network; what the worker loads then comes through it, too. */
async function registerServiceWorker() {
  if (!navigator.serviceWorker) return;
  try {
    await navigator.serviceWorker.register("service_worker.js");
    await navigator.serviceWorker.ready;
  } catch {
    // Without it the page works as long as there is a network.
  }
}

async function start() {
  setUpButtons();
  setUpDropping();
  setUpSettings();
  try {
    photos.push(...(await loadPhotos()));
  } catch {
    showFault("Results are not kept after the page is closed, as this browser allows no storage here.");
  }
  showAll();
  await registerServiceWorker();
  try {
    await runTask("load");
    document.body.dataset.ready = "true";
  } catch (error) {
    showFault(error.message);
  }
}

await start();
