// Run a graph with LiteRT.js: typed arrays in, typed arrays out, nothing left in the heap of WebAssembly.

import { loadAndCompile, loadLiteRt, Tensor } from "./runtime/litert.js";
import { readModelFile } from "./model_file.js";

const FOLDER = new URL("./runtime/", import.meta.url).href;

let loading;

function loadRuntime() {
  // The script looks for its .wasm beside the worker otherwise.
  self.Module = { locateFile: (name) => FOLDER + name };
  return (loading ??= loadLiteRt(FOLDER));
}

/** A graph of one signature. */
export class Runner {
  /** Load the file of `kind` at `name`, relative to the page. Throws ModelFileError. */
  static async load(name, kind) {
    const [response] = await Promise.all([fetch(new URL(name, import.meta.url)), loadRuntime()]);
    if (!response.ok) throw new Error(`${name} is missing on the server; write the page again with laesi web`);
    const { model, metadata } = await readModelFile(await response.arrayBuffer(), name);
    if (metadata.kind !== kind) throw new Error(`${name} is a file of kind ${metadata.kind}, not ${kind}`);
    const compiled = await loadAndCompile(model, { accelerator: "wasm" });
    return new Runner(Object.values(compiled.signatures)[0] ?? compiled, metadata);
  }

  constructor(signature, metadata) {
    this.signature = signature;
    this.metadata = metadata;
  }

  /** Return the outputs by name for `inputs` by name, typed arrays both. */
  async run(inputs) {
    const tensors = {};
    for (const [name, values] of Object.entries(inputs)) tensors[name] = new Tensor(values, shapeOf(values));
    let results = {};
    try {
      results = await this.signature.run(tensors);
      return Object.fromEntries(Object.entries(results).map(([name, tensor]) => [name, tensor.toTypedArray().slice()]));
    } finally {
      for (const tensor of [...Object.values(tensors), ...Object.values(results)]) tensor.delete();
    }
  }
}

/** Return the shape of an input: a square picture, the two numbers of a size, or a single number. */
function shapeOf(values) {
  if (values instanceof Uint8Array) return [Math.sqrt(values.length / 3), Math.sqrt(values.length / 3), 3];
  return values.length === 1 ? [] : [values.length];
}
