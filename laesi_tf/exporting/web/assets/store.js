// Photos and measurements on this device, until the user deletes them.

const NAME = "laesi";
const PHOTOS = "photos";

let opening;

function open() {
  opening ??= new Promise((resolve, reject) => {
    const request = indexedDB.open(NAME, 1);
    request.onupgradeneeded = () => request.result.createObjectStore(PHOTOS, { keyPath: "id", autoIncrement: true });
    request.onsuccess = () => resolve(request.result);
    request.onerror = () => reject(request.error);
  });
  return opening;
}

async function run(mode, operate) {
  const database = await open();
  return new Promise((resolve, reject) => {
    const transaction = database.transaction(PHOTOS, mode);
    const request = operate(transaction.objectStore(PHOTOS));
    transaction.oncomplete = () => resolve(request.result);
    transaction.onabort = transaction.onerror = () => reject(transaction.error ?? request.error);
  });
}

/** Return all photos, the oldest first. */
export const loadPhotos = () => run("readonly", (store) => store.getAll());

/** Write a photo and return its id, which a new one gets here. */
export const savePhoto = (photo) => run("readwrite", (store) => store.put(photo));

/** Delete a photo. */
export const deletePhoto = (id) => run("readwrite", (store) => store.delete(id));

/** Delete everything. */
export const deleteAllPhotos = () => run("readwrite", (store) => store.clear());
