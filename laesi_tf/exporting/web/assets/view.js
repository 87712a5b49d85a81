// What the guidance looks at: a preview shrunk to a square, and four parts of it at its own resolution.

import { AreaShrinker, fitSize } from "./shrink.js";

/**
 * Return the inputs of the guidance graph for an RGBA picture, {data, width, height}. `metadata` is that of the
 * graph's file.
 */
export function makeGuidanceInputs(picture, metadata) {
  const [side] = metadata.input_size;
  const longer = Math.max(picture.width, picture.height);
  const size = fitSize(picture.width, picture.height, side);
  const shrinker = new AreaShrinker(picture.width, picture.height, size.width, size.height, side, side);
  shrinker.add(picture.data);
  return {
    view: shrinker.pixels,
    size: Int32Array.of(size.height, size.width),
    parts: cutParts(picture, metadata),
    frame_px: Float32Array.of(metadata.frame_size[0] / longer),
  };
}

function cutParts({ data, width, height }, { input_size: [side], part_size: part, part_places: places }) {
  const parts = new Uint8Array(side * side * 3);
  const start = (place, length) => Math.max(0, Math.min(length - part, Math.round(place * length - part / 2)));
  places.forEach((down, row) => {
    places.forEach((across, column) => {
      const [top, left] = [start(down, height), start(across, width)];
      for (let y = 0; y < Math.min(part, height); y++) {
        let to = ((row * part + y) * side + column * part) * 3;
        const first = ((top + y) * width + left) * 4;
        for (let from = first; from < first + Math.min(part, width) * 4; from += 4) {
          parts[to++] = data[from];
          parts[to++] = data[from + 1];
          parts[to++] = data[from + 2];
        }
      }
    });
  });
  return parts;
}
