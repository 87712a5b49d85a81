// What the first bytes of a file say: its format, and its width and height where that is easy to find.
// A picture of 100 megapixels must be refused before it is decoded, which would take the memory of the tab.

const JPEG_SIZES = new Set([0xc0, 0xc1, 0xc2, 0xc3, 0xc5, 0xc6, 0xc7, 0xc9, 0xca, 0xcb, 0xcd, 0xce, 0xcf]);
const HEIC_BRANDS = new Set(["heic", "heix", "heif", "hevc", "hevx", "heim", "heis", "mif1", "msf1"]);

/** Return {format, width, height}; format is undefined for what is no picture. */
export function readHeader(buffer) {
  const view = new DataView(buffer);
  const text = (from, to) => String.fromCharCode(...new Uint8Array(buffer.slice(from, to)));
  if (view.byteLength < 16) return {};
  if (view.getUint16(0) === 0xffd8) return { format: "JPEG", ...findJpegSize(view) };
  if (text(1, 4) === "PNG" && view.byteLength >= 24) {
    return { format: "PNG", width: view.getUint32(16), height: view.getUint32(20) };
  }
  if (text(0, 4) === "RIFF" && text(8, 12) === "WEBP") return { format: "WebP" };
  if (text(0, 3) === "GIF") {
    return { format: "GIF", width: view.getUint16(6, true), height: view.getUint16(8, true) };
  }
  if (text(0, 2) === "BM") return { format: "BMP" };
  if (text(0, 2) === "II" || text(0, 2) === "MM") return { format: "TIFF" };
  if (text(4, 8) === "ftyp") {
    if (HEIC_BRANDS.has(text(8, 12))) return { format: "HEIC" };
    if (text(8, 12).startsWith("avi")) return { format: "AVIF" };
  }
  return {};
}

function findJpegSize(view) {
  let place = 2;
  while (place + 9 < view.byteLength) {
    if (view.getUint8(place) !== 0xff) return {};
    const marker = view.getUint8(place + 1);
    if (JPEG_SIZES.has(marker)) return { height: view.getUint16(place + 5), width: view.getUint16(place + 7) };
    place += 2 + view.getUint16(place + 2);
  }
  return {};
}
