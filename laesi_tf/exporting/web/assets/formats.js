// Numbers as people read them.

/** Return an area with its uncertainty: two significant digits of the latter say how many digits count. */
export function formatArea(area, uncertainty) {
  const digits = uncertainty > 0 ? Math.min(3, Math.max(0, 1 - Math.floor(Math.log10(uncertainty)))) : 2;
  return [area.toFixed(digits), uncertainty.toFixed(digits)];
}

/** Return the area of all leaves and its uncertainty: errors of the scale are common, so they add up. */
export function sumAreas(leaves) {
  const sum = (name) => leaves.reduce((total, leaf) => total + leaf[name], 0);
  return [sum("area_cm2"), sum("uncertainty_cm2")];
}

export const isMeasured = (photo) => photo.measurement?.refusal === null;

/** Return why a photo has no area, or null. */
export const findReason = (photo) => photo.error ?? photo.measurement?.refusal ?? null;

/** Return all doubts about a photo's areas. */
export function listNotes(measurement) {
  const { leaves } = measurement;
  const ofLeaves = leaves.map((leaf, i) => leaf.note && (leaves.length > 1 ? `leaf ${i + 1}: ${leaf.note}` : leaf.note));
  return [measurement.note, ...ofLeaves].filter(Boolean);
}
