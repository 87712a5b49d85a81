// The sentences of `laesi predict` with their numbers filled in.

let sentences;

/** Load the sentences; they come from the same constants as those of the Python package. */
export async function loadSentences() {
  sentences ??= await (await fetch("sentences.json")).json();
  return sentences;
}

/** Fill in a template of Python's str.format: {name}, {name:.1f} or {name:g}. */
export function fill(template, values) {
  return template.replace(/\{(\w+)(?::(?:\.(\d)f|g))?\}/g, (_, name, digits) =>
    digits === undefined ? String(values[name]) : values[name].toFixed(Number(digits)),
  );
}
