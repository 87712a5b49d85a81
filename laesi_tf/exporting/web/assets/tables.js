// The results as CSV and JSON, with the columns and digits of `laesi predict`.

const FORMULA_STARTS = /^[=+\-@\t\r]/;

/** Round to significant digits. */
export const round = (value, digits) => (value == null ? null : Number(value.toPrecision(digits)));

/** Return one record per measured leaf, or one for a photo without. */
export function makeRecords(photos) {
  return photos.flatMap((photo) => {
    const shared = { photo: photo.file.name, sample: photo.name, method: "LiteRT: ruling x silhouette" };
    const { measurement, error } = photo;
    if (!measurement || measurement.refusal !== null) {
      return [{ ...shared, refused: Boolean(measurement), error: measurement ? measurement.refusal : error }];
    }
    return measurement.leaves.map((leaf, index) => ({
      ...shared,
      leaf: index + 1,
      area_cm2: round(leaf.area_cm2, 4),
      uncertainty_cm2: round(leaf.uncertainty_cm2, 2),
      px_per_mm: round(leaf.px_per_mm, 4),
      length_mm: round(leaf.length_mm, 4),
      width_mm: round(leaf.width_mm, 4),
      tilt_deg: measurement.tilt_deg === null ? null : Math.round(measurement.tilt_deg * 10) / 10,
      refused: false,
      note: [leaf.note, measurement.note].filter(Boolean).join("; ") || null,
    }));
  });
}

/** Return records as CSV with a line for the names of `columns`. */
export function formatCsv(records, columns) {
  const lines = records.map((record) => columns.map((name) => formatCell(record[name])).join(","));
  return [columns.join(","), ...lines].map((line) => `${line}\r\n`).join("");
}

/** Return records as JSON, all columns in each. */
export function formatJson(records, columns) {
  const whole = records.map((record) => Object.fromEntries(columns.map((name) => [name, record[name] ?? null])));
  return `${JSON.stringify(whole, null, 2)}\n`;
}

function formatCell(value) {
  if (value === null || value === undefined) return "";
  if (typeof value === "boolean") return value ? "True" : "False";
  let text = String(value);
  // A spreadsheet would run it as a formula.
  if (typeof value === "string" && FORMULA_STARTS.test(text) && Number.isNaN(Number(text))) text = `'${text}`;
  return /[",\r\n]/.test(text) ? `"${text.replaceAll('"', '""')}"` : text;
}
