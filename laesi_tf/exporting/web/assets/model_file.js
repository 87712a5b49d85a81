// Read a file that `laesi export` wrote: a graph, and behind it a zip archive with one member, laesi.json.

const END_OF_ARCHIVE = 0x06054b50;
const MEMBER_ENTRY = 0x02014b50;
const DEFLATED = 8;

/** A file that cannot be used; the message is for the user. */
export class ModelFileError extends Error {}

/** Return {model: Uint8Array, metadata} of a file's bytes (ArrayBuffer). Throws ModelFileError. */
export async function readModelFile(buffer, name) {
  let metadata, start;
  try {
    [metadata, start] = await readArchive(buffer);
  } catch {
    throw new ModelFileError(`${name} is cut off or was not written by laesi export; reload the page, or write it again`);
  }
  const model = new Uint8Array(buffer, 0, start);
  // Browsers give no digests to pages that come without encryption from another machine.
  if (globalThis.crypto?.subtle && (await sha256(model)) !== metadata.sha256) {
    throw new ModelFileError(`${name} is damaged: its graph does not match its checksum; reload the page`);
  }
  return { model, metadata };
}

async function readArchive(buffer) {
  const view = new DataView(buffer);
  const end = buffer.byteLength - 22;
  if (view.getUint32(end, true) !== END_OF_ARCHIVE) throw new Error("no archive");
  const directorySize = view.getUint32(end + 12, true);
  const entry = end - directorySize;
  if (view.getUint32(entry, true) !== MEMBER_ENTRY) throw new Error("no directory");
  const method = view.getUint16(entry + 10, true);
  const size = view.getUint32(entry + 20, true);
  // Offsets count from the archive's own start, or from that of the file: sizes say where it is.
  const nameLength = view.getUint16(entry + 28, true);
  const packed = entry - size;
  const start = packed - 30 - nameLength;
  let content = new Blob([new Uint8Array(buffer, packed, size)]).stream();
  if (method === DEFLATED) content = content.pipeThrough(new DecompressionStream("deflate-raw"));
  return [JSON.parse(await new Response(content).text()), start];
}

async function sha256(bytes) {
  const digest = new Uint8Array(await crypto.subtle.digest("SHA-256", bytes));
  return Array.from(digest, (byte) => byte.toString(16).padStart(2, "0")).join("");
}
