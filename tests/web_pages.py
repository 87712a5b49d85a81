"""The page in a real browser, and what it measures there."""

import contextlib
import io
import json
import threading
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import chromium
import numpy as np
from PIL import Image

from laesi_tf.exporting.web.server import open_server

PHONE = {"width": 390, "height": 844, "is_phone": True}
DESKTOP = {"width": 1280, "height": 900}

_READ = """(async () => {
  const { loadPhotos } = await import('./store.js');
  const photos = await loadPhotos();
  return JSON.stringify(photos.map(({ file, thumbnail, ...photo }) => ({ ...photo, file: file.name })));
})()"""


@contextlib.contextmanager
def serve(folder: Path) -> Iterator[str]:
    """Serve `folder` inside this context; yields its address."""
    with open_server(folder, 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        try:
            yield f"http://localhost:{server.server_port}/"
        finally:
            server.shutdown()
            thread.join()


def open_page(browser: chromium.Browser, address: str, **window: Any) -> None:
    """Open the page and wait until it can measure."""
    browser.call("Runtime.enable")
    browser.open(address, **window)
    ready = "document.body?.dataset.ready || document.getElementById('fault')?.hidden === false"
    browser.wait_until(ready, 120)


def measure_files(browser: chromium.Browser, files: Sequence[Path]) -> list[dict[str, Any]]:
    """Choose `files` on the page and return what it keeps of them."""
    before = len(read_photos(browser))
    browser.choose_files("#files", files)
    done = f"document.querySelectorAll('#list li').length === {before + len(files)}"
    browser.wait_until(f"{done} && !document.getElementById('summary').textContent.includes('to go')", 600)
    return read_photos(browser)[before:]


def read_photos(browser: chromium.Browser) -> list[dict[str, Any]]:
    """Return the photos that the page keeps, without their files."""
    photos: list[dict[str, Any]] = json.loads(browser.evaluate(_READ))
    return photos


def fake_camera(path: Path, image: np.ndarray) -> list[str]:
    """Write a video of one `image`, and return the flags that show it to the page as a camera."""
    frame = io.BytesIO()
    Image.fromarray(image).save(frame, "JPEG", quality=90)
    path.write_bytes(frame.getvalue() * 10)
    return [
        "--use-fake-ui-for-media-stream",
        "--use-fake-device-for-media-stream",
        f"--use-file-for-fake-video-capture={path}",
    ]


def list_exceptions(browser: chromium.Browser) -> list[str]:
    """Return the errors that the page did not catch."""
    return [
        str(event["params"]["exceptionDetails"])
        for event in browser.events
        if event.get("method") == "Runtime.exceptionThrown"
    ]
