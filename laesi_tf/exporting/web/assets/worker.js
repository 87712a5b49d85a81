// Measures in the background, so that the page stays responsive. A classic worker, as LiteRT.js loads its
// WebAssembly with importScripts; all else is modules.

const modules = import("./tasks.js");

onmessage = async ({ data: { id, task, value } }) => {
  try {
    postMessage({ id, result: await (await modules).TASKS[task](value) });
  } catch (error) {
    postMessage({ id, error: String(error?.message ?? error), isOfPicture: error?.name === "PictureError" });
  }
};
