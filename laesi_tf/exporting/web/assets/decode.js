// From a file to pixels: upright, in sRGB, on white, shrunk by area means.

import { readHeader } from "./picture_header.js";
import { AreaShrinker, fitSize } from "./shrink.js";

const HEADER_BYTES = 2 ** 18;
// A canvas of a strip stays far below the area that phones allow.
const STRIP_PIXELS = 2 ** 20;

/** A picture that cannot be measured; the message is for the user. */
export class PictureError extends Error {
  name = "PictureError";
}

/**
 * Decode a picture into the upper left corner of a black square of `side` pixels.
 * Returns {pixels: Uint8Array [side, side, 3], width, height, photoWidth, photoHeight}. Throws PictureError.
 */
export async function decodePicture(blob, side, limits) {
  const header = await checkHeader(blob, limits);
  let bitmap;
  try {
    bitmap = await createImageBitmap(blob, { imageOrientation: "from-image" });
  } catch {
    throw new PictureError(explainFailure(header.format));
  }
  try {
    requireSize(bitmap.width, bitmap.height, limits);
    return shrinkInStrips(bitmap, side);
  } finally {
    bitmap.close();
  }
}

async function checkHeader(blob, limits) {
  if (blob.size === 0) throw new PictureError("the file is empty: it was not copied completely; choose it again");
  const header = readHeader(await blob.slice(0, HEADER_BYTES).arrayBuffer());
  if (!header.format) throw new PictureError("this is not a picture; choose a JPEG, PNG or HEIC photo");
  if (header.width) requireSize(header.width, header.height, limits);
  return header;
}

function requireSize(width, height, limits) {
  const megapixels = Math.round((width * height) / 1e6);
  if (width * height > limits.max_megapixels * 1e6) {
    throw new PictureError(
      `the picture has ${megapixels} megapixels, and a browser can measure at most ${limits.max_megapixels}; ` +
        "choose a lower resolution in the camera's settings",
    );
  }
}

function explainFailure(format) {
  if (format === "HEIC") {
    return (
      "this browser cannot decode HEIC photos; open the page in Safari, or let the camera save JPEG " +
      "(iPhone: Settings, Camera, Formats, Most Compatible)"
    );
  }
  if (format === "TIFF") return "browsers cannot decode TIFF; save the picture as JPEG or PNG";
  return `the ${format} file is damaged or cut off: it cannot be decoded; copy or take it again`;
}

function shrinkInStrips(bitmap, side) {
  const { width, height } = bitmap;
  const size = fitSize(width, height, side);
  const shrinker = new AreaShrinker(width, height, size.width, size.height, side, side);
  const rows = Math.max(1, Math.min(height, Math.floor(STRIP_PIXELS / width)));
  const canvas = new OffscreenCanvas(width, rows);
  const context = canvas.getContext("2d", { alpha: false, willReadFrequently: true });
  for (let top = 0; top < height; top += rows) {
    const count = Math.min(rows, height - top);
    context.fillStyle = "white";
    context.fillRect(0, 0, width, count);
    context.drawImage(bitmap, 0, top, width, count, 0, 0, width, count);
    shrinker.add(context.getImageData(0, 0, width, count).data);
  }
  return { pixels: shrinker.pixels, ...size, photoWidth: width, photoHeight: height };
}
