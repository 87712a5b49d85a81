// Calls into the worker that measures.

let worker;
let last = 0;
const waiting = new Map();

function start() {
  worker = new Worker("worker.js");
  worker.onmessage = ({ data: { id, result, error, isOfPicture } }) => {
    const { resolve, reject } = waiting.get(id);
    waiting.delete(id);
    if (error === undefined) resolve(result);
    else reject(Object.assign(new Error(error), { isOfPicture }));
  };
  worker.onerror = (event) => {
    // It has run out of memory, or could not start: a new one takes the next task.
    for (const { reject } of waiting.values()) reject(new Error(event.message || "the measurement could not be started"));
    waiting.clear();
    worker.terminate();
    worker = undefined;
  };
}

/** Run a task of tasks.js and return its result. */
export function runTask(task, value, transfer = []) {
  if (!worker) start();
  return new Promise((resolve, reject) => {
    const id = ++last;
    waiting.set(id, { resolve, reject });
    worker.postMessage({ id, task, value }, transfer);
  });
}
