// What an app does around the file that measures: give it the photo, and describe what comes back.
// All that measures is in the file.

import { ringArea, traceLevel } from "./contours.js";
import { fill } from "./sentences.js";

const NO_REFUSAL = 0;
const CUT_OFF = 1;
const TOUCHED = 2;
const MASK_LEVEL = 127.5;
const HEAVY = 10;

/** Return the inputs of the signature for a decoded picture. `gridMm` is null where the lines shall say it. */
export function makeInputs(picture, gridMm) {
  return {
    photo: picture.pixels,
    size: Int32Array.of(picture.height, picture.width),
    grid_mm: Float32Array.of(gridMm ?? 0),
    px_per_mm: Float32Array.of(0),
  };
}

/**
 * Return the measurement of a picture from the `outputs` of the graph, by name; lengths in photo pixels, areas
 * in cm2.
 */
export function describeMeasurement(outputs, picture, gridMm, sentences) {
  const step = Math.sqrt((picture.photoWidth / picture.width) * (picture.photoHeight / picture.height));
  const refusal = outputs.refusal[0];
  const isMeasured = refusal === NO_REFUSAL;
  const leaves = [];
  for (let index = 0; index < outputs.count[0]; index++) {
    const leaf = describeLeaf(outputs, index, picture, step, isMeasured, sentences);
    if (leaf) leaves.push(leaf);
  }
  const notes = [];
  if (outputs.note[0]) notes.push(sentences.notes[outputs.note[0]]);
  if (isMeasured && outputs.beside[0] > 0) notes.push(fill(sentences.off_sheet, { count: outputs.beside[0] }));
  if (isMeasured && outputs.uncounted[0] > 0) notes.push(fill(sentences.uncounted, { count: outputs.uncounted[0] }));
  let text = explainRefusal(refusal, outputs, step, gridMm, sentences);
  if (text === null && leaves.length === 0) text = sentences.no_leaf;
  return {
    leaves: sortInReadingOrder(leaves),
    refusal: text,
    note: notes.join("; ") || null,
    tilt_deg: outputs.pitch_mm[0] > 0 ? outputs.tilt_deg[0] : null,
    grid: outputs.pitch_mm[0] > 0 ? traceGrid(outputs.grid, picture) : [],
  };
}

function explainRefusal(refusal, outputs, step, gridMm, sentences) {
  if (refusal === NO_REFUSAL) return null;
  const numbers = { period: outputs.period_px[0] * step, grid: gridMm, times: outputs.uncounted_share[0] };
  const text = fill(sentences.refusals[refusal], numbers);
  const isOfRuling = sentences.of_ruling.includes(refusal);
  return isOfRuling && outputs.count[0] === 0 ? `${sentences.no_leaf}; ${text}` : text;
}

function describeLeaf(outputs, index, picture, step, isMeasured, sentences) {
  const rings = traceMask(outputs, index, picture);
  if (rings.length === 0 || (isMeasured && !(outputs.area_cm2[index] > 0))) return null;
  const leafNotes = [];
  if (outputs.flags[index] & CUT_OFF) leafNotes.push(sentences.cut_off);
  if (outputs.flags[index] & TOUCHED) leafNotes.push(sentences.touched);
  const leaf = { rings, note: leafNotes.join("; ") || null };
  if (isMeasured) {
    for (const name of ["area_cm2", "uncertainty_cm2", "length_mm", "width_mm"]) leaf[name] = outputs[name][index];
    leaf.px_per_mm = outputs.leaf_px_per_mm[index] * step;
  }
  return leaf;
}

/** Return the outlines of a leaf in photo pixels, the outer one first, holes after it. */
function traceMask(outputs, index, picture) {
  const side = Math.sqrt(outputs.mask.length / (outputs.square.length / 3));
  const mask = outputs.mask.subarray(index * side * side, (index + 1) * side * side);
  const [left, top, width] = outputs.square.subarray(index * 3, index * 3 + 3);
  // A border of zeros closes outlines that reach the edge.
  const columns = side + 2;
  const field = new Float32Array(columns * columns);
  for (let row = 0; row < side; row++) field.set(mask.subarray(row * side, (row + 1) * side), (row + 1) * columns + 1);
  const pixel = width / side;
  const scale = { x: picture.photoWidth / picture.width, y: picture.photoHeight / picture.height };
  const clip = (value, high) => Math.round(10 * Math.min(Math.max(value, 0), high)) / 10;
  return traceLevel(field, columns, MASK_LEVEL)
    .filter((ring) => ring.length > 3)
    .sort((a, b) => Math.abs(ringArea(b)) - Math.abs(ringArea(a)))
    .map((ring) =>
      ring.map(([x, y]) => [
        clip((left + (x - 0.5) * pixel) * scale.x, picture.photoWidth),
        clip((top + (y - 0.5) * pixel) * scale.y, picture.photoHeight),
      ]),
    );
}

/** Return every tenth line of the ruling in photo pixels. */
function traceGrid(grid, picture) {
  const nodes = Math.sqrt(grid.length / 2);
  const across = picture.photoWidth / (nodes - 1);
  const down = picture.photoHeight / (nodes - 1);
  const lines = [];
  for (const axis of [0, 1]) {
    const field = Float32Array.from({ length: nodes * nodes }, (_, node) => grid[2 * node + axis] / HEAVY);
    const low = field.reduce((a, b) => Math.min(a, b));
    const high = field.reduce((a, b) => Math.max(a, b));
    for (let level = Math.ceil(low); level <= high; level++) {
      for (const line of traceLevel(field, nodes, level)) {
        lines.push(line.map(([x, y]) => [Math.round(10 * x * across) / 10, Math.round(10 * y * down) / 10]));
      }
    }
  }
  return lines;
}

/** Return leaves by rows from the top and from left to right. */
export function sortInReadingOrder(leaves) {
  const boxes = leaves.map((leaf) => {
    const xs = leaf.rings[0].map((point) => point[0]);
    const ys = leaf.rings[0].map((point) => point[1]);
    const [top, bottom] = [Math.min(...ys), Math.max(...ys)];
    return { leaf, x: (Math.min(...xs) + Math.max(...xs)) / 2, y: (top + bottom) / 2, bottom };
  });
  let waiting = boxes.sort((a, b) => a.y - b.y);
  const order = [];
  while (waiting.length) {
    // A leaf belongs to a row if its middle is not below the bottom of the row's first one.
    const { bottom } = waiting[0];
    order.push(...waiting.filter((box) => box.y <= bottom).sort((a, b) => a.x - b.x));
    waiting = waiting.filter((box) => box.y > bottom);
  }
  return order.map((box) => box.leaf);
}
