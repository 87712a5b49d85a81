// What the user knows about the paper.

import { find } from "./elements.js";

const GRID = "laesi-grid-mm";

/** Return the distance of the finest lines in mm; null where the lines shall say it. */
export function readGridMm() {
  const value = Number(localStorage.getItem(GRID));
  return value > 0 ? value : null;
}

/** Connect the dialog. */
export function setUpSettings() {
  const field = find("grid");
  find("open-settings").onclick = () => {
    field.value = readGridMm() ?? "";
    find("settings").showModal();
  };
  field.onchange = () => {
    if (field.validity.valid && field.value) localStorage.setItem(GRID, field.value);
    else if (!field.value) localStorage.removeItem(GRID);
  };
}
