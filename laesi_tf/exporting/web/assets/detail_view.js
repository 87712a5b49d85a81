// One photo: the picture with what was read on it, all numbers, and what can be done with it.

import { find, make, makeSvg } from "./elements.js";
import { findReason, formatArea, isMeasured, listNotes } from "./formats.js";
import { makeArea } from "./list_view.js";

let address;

/** Show `photo`; `actions` are rename(photo, name), measureAgain(photo), remove(photo). */
export function showDetail(photo, actions) {
  const dialog = find("detail");
  if (address) URL.revokeObjectURL(address);
  address = URL.createObjectURL(photo.file);
  dialog.replaceChildren(makePicture(photo), makeBody(photo, actions, dialog));
  if (!dialog.open) dialog.showModal();
  dialog.scrollTop = 0;
  dialog.onclose = () => {
    // The event comes late: another photo may be shown by now.
    if (dialog.open) return;
    URL.revokeObjectURL(address);
    address = undefined;
    dialog.replaceChildren();
  };
}

function makePicture(photo) {
  const image = make("img", { src: address, alt: `Photo ${photo.name}` });
  // What no browser can decode, such as a text file, has no picture.
  image.onerror = () => image.closest(".photo").remove();
  const frame = make("div", { className: "frame" }, image);
  if (photo.measurement) frame.append(drawMeasurement(photo));
  return make("div", { className: "photo" }, frame);
}

function drawMeasurement({ measurement, width, height }) {
  const drawing = makeSvg("svg", { viewBox: `0 0 ${width} ${height}`, preserveAspectRatio: "none", "aria-hidden": "true" });
  const path = (line) => `M${line.map(([x, y]) => `${x} ${y}`).join("L")}`;
  drawing.append(makeSvg("path", { class: "grid", d: measurement.grid.map(path).join("") }));
  for (const leaf of measurement.leaves) {
    drawing.append(makeSvg("path", { class: "outline", d: leaf.rings.map((ring) => `${path(ring)}Z`).join("") }));
  }
  if (measurement.leaves.length > 1) {
    const size = Math.max(width, height) / 30;
    measurement.leaves.forEach((leaf, index) => {
      const [x, y] = findMiddle(leaf.rings[0]);
      const attributes = { class: "number", x, y, "font-size": size, "stroke-width": size / 6 };
      drawing.append(makeSvg("text", attributes, String(index + 1)));
    });
  }
  return drawing;
}

function findMiddle(ring) {
  return [0, 1].map((axis) => {
    const values = ring.map((point) => point[axis]);
    return (Math.min(...values) + Math.max(...values)) / 2;
  });
}

function makeBody(photo, actions, dialog) {
  const name = make("input", { type: "text", id: "name", value: photo.name, autocomplete: "off" });
  name.onchange = () => actions.rename(photo, name.value.trim() || photo.file.name);
  const grid = makeGridField(photo.grid_mm);
  const close = make("button", { type: "button", className: "main", autofocus: true, onclick: () => dialog.close() }, "Done");
  const measureAgain = () => grid.reportValidity() && actions.measureAgain(photo, Number(grid.value) || null);
  const again = make("button", { type: "button", onclick: measureAgain }, "Measure again");
  const save = make("button", { type: "button", onclick: () => actions.saveFile(photo) }, "Save photo");
  const remove = make("button", { type: "button", className: "danger", onclick: () => actions.remove(photo) }, "Delete");
  return make(
    "div",
    { className: "body" },
    ...describeResult(photo),
    make(
      "div",
      { className: "fields" },
      make("div", {}, make("label", { htmlFor: "name" }, "Name"), name),
      make("div", {}, make("label", { htmlFor: grid.id }, "Line distance"), grid),
    ),
    make("div", { className: "actions" }, close, again, save, remove),
  );
}

/** Return the field for the distance of the finest lines, with the limits of that in the settings. */
function makeGridField(gridMm) {
  const field = find("grid").cloneNode();
  return Object.assign(field, { id: "grid-of-photo", value: gridMm ?? "", placeholder: "mm" });
}

function describeResult(photo) {
  const reason = findReason(photo);
  const title = { id: "detail-area" };
  if (reason !== null) {
    return [make("h2", { ...title, className: "area refused" }, "No area"), make("p", {}, capitalise(reason), ".")];
  }
  if (!isMeasured(photo)) return [make("h2", title, "Measuring…")];
  const { measurement } = photo;
  const notes = listNotes(measurement).map((note) => make("p", { className: "note" }, capitalise(note), "."));
  return [
    make("h2", title, makeArea(measurement.leaves)),
    ...notes,
    measurement.leaves.length > 1 ? makeTable(measurement.leaves) : makeNumbers(measurement),
    make(
      "p",
      { className: "legend" },
      make("i", { className: "key-outline" }), "outline",
      make("i", { className: "key-grid" }), "every tenth printed line, as it was read. Where both lie right, the area is right.",
    ),
  ];
}

function makeNumbers({ leaves: [leaf], tilt_deg: tilt }) {
  const entries = [
    ["Length", `${leaf.length_mm.toFixed(1)} mm`],
    ["Width", `${leaf.width_mm.toFixed(1)} mm`],
    ["Tilt", `${tilt.toFixed(0)}°`],
    ["Scale", `${leaf.px_per_mm.toFixed(1)} px/mm`],
  ];
  const items = entries.map(([term, value]) => make("div", {}, make("dt", {}, term), make("dd", {}, value)));
  return make("dl", { className: "numbers" }, ...items);
}

function makeTable(leaves) {
  const cells = (tag, texts) => make("tr", {}, ...texts.map((text) => make(tag, {}, text)));
  const rows = leaves.map((leaf, index) => {
    const [area, uncertainty] = formatArea(leaf.area_cm2, leaf.uncertainty_cm2);
    return cells("td", [`${index + 1}`, `${area} ± ${uncertainty}`, leaf.length_mm.toFixed(1), leaf.width_mm.toFixed(1)]);
  });
  return make("table", {}, cells("th", ["Leaf", "cm²", "mm long", "mm wide"]), ...rows);
}

const capitalise = (text) => text.charAt(0).toUpperCase() + text.slice(1);
