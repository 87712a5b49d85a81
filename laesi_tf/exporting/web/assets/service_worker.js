// Keeps the page for use without a network. `laesi web` writes VERSION and FILES above this line.

const CACHE = `laesi-${VERSION}`;

self.addEventListener("install", (event) => {
  // Not from the browser's own cache, which may hold files of another version.
  const requests = ["./", ...FILES].map((name) => new Request(name, { cache: "reload" }));
  event.waitUntil(caches.open(CACHE).then((cache) => cache.addAll(requests)).then(() => self.skipWaiting()));
});

self.addEventListener("activate", (event) => {
  event.waitUntil(deleteOldCaches().then(() => self.clients.claim()));
});

self.addEventListener("fetch", (event) => {
  const isOurs = new URL(event.request.url).href.startsWith(self.registration.scope);
  if (event.request.method === "GET" && isOurs) event.respondWith(answer(event.request));
});

async function deleteOldCaches() {
  const names = await caches.keys();
  await Promise.all(names.filter((name) => name.startsWith("laesi-") && name !== CACHE).map((name) => caches.delete(name)));
}

async function answer(request) {
  const cache = await caches.open(CACHE);
  const kept = await cache.match(request, { ignoreSearch: true });
  if (kept) return kept;
  const response = await fetch(request);
  // The variant of WebAssembly that this browser uses.
  if (response.status === 200) await cache.put(request, response.clone());
  return response;
}
