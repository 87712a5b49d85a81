"""Write docs/page.jpg, the page on a phone in three states.

    python tests/show_page.py PAGE

PAGE is a folder that `laesi web` wrote.
"""

import io
import sys
import tempfile
import time
from pathlib import Path

import chromium
import numpy as np
from PIL import Image
from web_pages import PHONE, fake_camera, measure_files, open_page, serve

ROOT = Path(__file__).parents[1]
SAMPLE = ROOT / "docs" / "sample" / "leaf.jpg"
_GAP = 24
_SCALE = 0.5


def main() -> None:
    """Take the screenshots and put them side by side."""
    page = Path(sys.argv[1])
    photo = Image.open(SAMPLE).convert("RGB")
    # As a phone held upright would see it.
    portrait = photo.crop((photo.width // 4, 0, photo.width // 4 + photo.height * 3 // 4, photo.height))
    camera = np.asarray(portrait.resize((960, 1280), Image.Resampling.LANCZOS))
    with tempfile.TemporaryDirectory() as folder, serve(page) as address:
        flags = fake_camera(Path(folder) / "camera.mjpeg", camera)
        with chromium.Browser(flags=flags) as browser:
            open_page(browser, address, **PHONE)
            states = [_shoot(browser, Path(folder))]
            browser.evaluate("document.getElementById('take').click()")
            browser.wait_until("document.getElementById('hint').dataset.state === 'good'", 60)
            states.append(_shoot(browser, Path(folder)))
            browser.evaluate("document.getElementById('close-aim').click()")
            measure_files(browser, [SAMPLE])
            browser.evaluate("document.querySelector('#list button').click()")
            states.append(_shoot(browser, Path(folder)))
    width, height = (round(side * _SCALE) for side in states[0].size)
    row = Image.new("RGB", (3 * width + 4 * _GAP, height + 2 * _GAP), (222, 226, 223))
    for index, state in enumerate(states):
        row.paste(
            state.resize((width, height), Image.Resampling.LANCZOS), (_GAP + index * (width + _GAP), _GAP)
        )
    row.save(ROOT / "docs" / "page.jpg", quality=85)


def _shoot(browser: chromium.Browser, folder: Path) -> Image.Image:
    # Pictures are decoded after the page has changed.
    time.sleep(1)
    path = folder / "shot.png"
    browser.take_screenshot(path)
    return Image.open(io.BytesIO(path.read_bytes())).convert("RGB")


if __name__ == "__main__":
    main()
