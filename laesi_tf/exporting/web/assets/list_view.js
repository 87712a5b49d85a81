// The list of photos: thumbnail, area or reason, name.

import { find, make } from "./elements.js";
import { findReason, formatArea, isMeasured, listNotes, sumAreas } from "./formats.js";

const addresses = new Map();

/** Show `photos`, the newest first; `onOpen` is called with the photo that the user chooses. */
export function showList(photos, onOpen) {
  const items = photos.toReversed().map((photo) => {
    const button = make("button", { type: "button", onclick: () => onOpen(photo) }, ...describe(photo));
    return make("li", {}, button);
  });
  find("list").replaceChildren(...items);
  forgetAddresses(new Set(photos));
}

function describe(photo) {
  const picture = photo.thumbnail
    ? make("img", { src: addressOf(photo), alt: "" })
    : make("span", { className: "blank", "aria-hidden": "true" });
  return [picture, describeResult(photo), make("span", { className: "name" }, photo.name)];
}

function describeResult(photo) {
  const result = make("span");
  const reason = findReason(photo);
  if (reason !== null) {
    result.append(make("span", { className: "refused" }, "No area"), make("span", { className: "reason" }, reason));
  } else if (!isMeasured(photo)) {
    result.append(make("span", { className: "dim" }, "Measuring…"));
  } else {
    result.append(makeArea(photo.measurement.leaves));
    const { leaves } = photo.measurement;
    if (leaves.length > 1) result.append(make("span", { className: "reason" }, `${leaves.length} leaves together`));
    const notes = listNotes(photo.measurement);
    if (notes.length) result.append(make("span", { className: "reason note" }, notes[0]));
  }
  return result;
}

/** Return the area of leaves as an element. */
export function makeArea(leaves) {
  const [area, uncertainty] = formatArea(...sumAreas(leaves));
  return make("span", { className: "area" }, `${area} `, make("small", {}, `± ${uncertainty} cm²`));
}

function addressOf(photo) {
  if (!addresses.has(photo)) addresses.set(photo, URL.createObjectURL(photo.thumbnail));
  return addresses.get(photo);
}

function forgetAddresses(shown) {
  for (const [photo, address] of addresses) {
    if (shown.has(photo)) continue;
    URL.revokeObjectURL(address);
    addresses.delete(photo);
  }
}
