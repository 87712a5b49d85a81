"""The page in headless Chromium: it measures as LiteRT does in Python, also without a network."""

import io
import json
import subprocess
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import chromium
import numpy as np
import pytest
from drawn_sheets import View, draw_photo
from litert_files import write_guidance_file
from PIL import Image
from test_ruling_estimator import MILLIMETRES, draw_disk
from web_pages import (
    DESKTOP,
    PHONE,
    fake_camera,
    list_exceptions,
    measure_files,
    open_page,
    read_photos,
    serve,
)

from laesi_tf.data.decoding import decode_photo
from laesi_tf.estimators.base import Estimator, PhotoInfo
from laesi_tf.estimators.factory import load_estimator
from laesi_tf.exporting.web import litert_js
from laesi_tf.exporting.web.sentences import collect_sentences, replace_flags
from laesi_tf.exporting.web.site import write_site

SAMPLE = Path(__file__).parents[1] / "docs" / "sample" / "leaf.jpg"
AXE = "axe-core@4.10.2"
pytestmark = [
    pytest.mark.skipif(chromium.binary() is None, reason="no Chromium; apt-get install chromium"),
    pytest.mark.skipif(not litert_js.list_files(), reason="no LiteRT.js; laesi web --fetch-runtime"),
]


@pytest.fixture(scope="module")
def litert(photo_file: Path) -> Estimator:
    return load_estimator(photo_file)


@pytest.fixture(scope="module")
def site(photo_file: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("web")
    guidance = out / "guidance.tflite"
    write_guidance_file(guidance)
    models = {"photo.tflite": photo_file.read_bytes(), "guidance.tflite": guidance.read_bytes()}
    documents = {"sheet-a4.pdf": b"%PDF-", "sheet-letter.pdf": b"%PDF-"}
    write_site(out, models=models, documents=documents, sentences=collect_sentences())
    return out


@pytest.fixture(scope="module")
def address(site: Path) -> Iterator[str]:
    with serve(site) as address:
        yield address


@pytest.fixture(scope="module")
def phone(address: str) -> Iterator[chromium.Browser]:
    """A browser whose page is open in the size of a phone."""
    with chromium.Browser() as browser:
        open_page(browser, address, **PHONE)
        yield browser
        assert list_exceptions(browser) == []


def save(folder: Path, name: str, image: np.ndarray, **options: Any) -> Path:
    path = folder / name
    Image.fromarray(image).save(path, **options)
    return path


def test_areas_and_refusals_are_those_of_python(
    phone: chromium.Browser, litert: Estimator, tmp_path: Path
) -> None:
    """On PNG files: browsers and Pillow decode JPEG a little differently."""
    two = draw_photo(View(600, 900, px_per_mm=6.0, turn=0.0), MILLIMETRES).astype(np.uint8)
    y, x = np.mgrid[:600, :900]
    for middle in (200, 600):
        two[((x - middle) / 60) ** 2 + ((y - 300) / 110) ** 2 < 1] = (40, 160, 40)
    images = {
        "tilted": draw_disk(View(600, 800, tilt=(0.15, -0.1)))[0],
        "shrunk": draw_disk(View(1250, 1650, px_per_mm=9.0))[0],
        "two": two,
        "cut_off": draw_disk(View(600, 800))[0][:, 370:],
        "fives": draw_disk(View(600, 800), levels={5.0: 0.8})[0],
        "no_leaf": draw_photo(View(600, 800), MILLIMETRES).astype(np.uint8),
        "blank": np.full((200, 200, 3), 240, np.uint8),
    }
    paths = [save(tmp_path, f"{name}.png", image) for name, image in images.items()]
    for shown, image in zip(measure_files(phone, paths), images.values(), strict=True):
        measurement, expected = shown["measurement"], litert.measure(image)
        refusal = expected.refusal and replace_flags(expected.refusal)
        assert measurement["refusal"] == refusal, shown["name"]
        assert len(measurement["leaves"]) == len(expected.leaves)
        assert measurement["note"] == (expected.note and replace_flags(expected.note))
        for leaf, other in zip(measurement["leaves"], expected.leaves, strict=True):
            assert leaf["note"] == other.note
            if refusal is None:
                for name in ("area_cm2", "length_mm", "width_mm", "px_per_mm"):
                    assert leaf[name] == pytest.approx(getattr(other, name), rel=1e-5), name
                # From a matrix of covariances in float32.
                assert leaf["uncertainty_cm2"] == pytest.approx(other.uncertainty_cm2, rel=1e-3)
            outline, same = np.array(leaf["rings"][0]), other.outline
            assert same is not None
            for end in (np.min, np.max):
                np.testing.assert_allclose(end(outline, axis=0), end(same, axis=0), atol=2)
        if expected.camera is not None and refusal is None:
            assert expected.tilt_deg == pytest.approx(measurement["tilt_deg"], abs=1e-3)
            for line in measurement["grid"]:
                lines = expected.camera.to_sheet(np.array(line))
                assert np.abs(lines - np.round(lines)).min(axis=1).max() < 0.05


def test_what_cannot_be_measured_is_explained_and_the_rest_goes_on(
    phone: chromium.Browser, tmp_path: Path
) -> None:
    jpeg = io.BytesIO()
    Image.fromarray(draw_disk(View(480, 640))[0]).save(jpeg, "JPEG", quality=92)
    header = b"\x89PNG\r\n\x1a\n" + bytes([0, 0, 0, 13]) + b"IHDR" + (10_000).to_bytes(4, "big") * 2
    contents = {
        "empty.jpg": (b"", "the file is empty"),
        "text.jpg": (b"This is the text of a letter, not a picture.", "this is not a picture"),
        "cut_off.png": (header[:16] + (640).to_bytes(4, "big") * 2 + b"\x08\x02\0\0\0", "damaged or cut off"),
        "large.png": (header + b"\x08\x02\0\0\0", "100 megapixels"),
        "photo.heic": (b"\0\0\0\x18ftypheic\0\0\0\0mif1heic" + b"\0" * 64, "cannot decode HEIC"),
        "good.jpg": (jpeg.getvalue(), None),
    }
    for name, (content, _) in contents.items():
        (tmp_path / name).write_bytes(content)
    photos = measure_files(phone, [tmp_path / name for name in contents])
    for photo, (_, message) in zip(photos, contents.values(), strict=True):
        if message is None:
            assert photo["measurement"]["refusal"] is None
        else:
            assert message in photo["error"], photo["error"]
    assert phone.evaluate("document.getElementById('fault').hidden")


def test_a_photo_is_turned_upright_and_the_sample_is_read(
    phone: chromium.Browser, litert: Estimator, tmp_path: Path
) -> None:
    exif = Image.Exif()
    exif[0x0112] = 6
    turned = save(tmp_path, "turned.jpg", draw_disk(View(480, 640))[0], quality=95, exif=exif)
    photo, sample = measure_files(phone, [turned, SAMPLE])
    assert (photo["width"], photo["height"]) == (480, 640)
    expected = litert.measure(decode_photo(turned))
    assert photo["measurement"]["leaves"][0]["area_cm2"] == pytest.approx(expected.area_cm2, rel=1e-3)
    assert len(sample["measurement"]["grid"]) > 10


def test_names_distances_and_tables(phone: chromium.Browser, litert: Estimator, tmp_path: Path) -> None:
    image = draw_disk(View(600, 800))[0]
    path = save(tmp_path, "=leaf.png", image)
    (before,) = measure_files(phone, [path])
    phone.evaluate("document.querySelector('#list button').click()")
    phone.evaluate("""{
      const name = document.getElementById('name');
      name.value = 'oak, tree 7';
      name.dispatchEvent(new Event('change'));
      document.getElementById('grid-of-photo').value = '0.97';
      [...document.querySelectorAll('#detail button')].find(b => b.textContent === 'Measure again').click();
    }""")
    area = "document.querySelector('#detail .area')?.textContent"
    phone.wait_until(f"!({area} ?? '').includes('No area') && ({area} ?? '').includes('±')", 60)
    photo = read_photos(phone)[-1]
    assert photo["id"] == before["id"] and photo["name"] == "oak, tree 7" and photo["grid_mm"] == 0.97
    expected = litert.measure(image, PhotoInfo(grid_mm=0.97)).area_cm2
    area_cm2 = photo["measurement"]["leaves"][0]["area_cm2"]
    assert area_cm2 == pytest.approx(expected, rel=1e-5)
    assert area_cm2 == pytest.approx(0.97**2 * before["measurement"]["leaves"][0]["area_cm2"], rel=1e-3)
    table = phone.evaluate("""(async () => {
      const [{ makeRecords, formatCsv, formatJson }, { loadPhotos }] =
        [await import('./tables.js'), await import('./store.js')];
      const { columns } = await (await fetch('sentences.json')).json();
      const records = makeRecords((await loadPhotos()).slice(-1));
      return [formatCsv(records, columns), formatJson(records, columns)];
    })()""")
    header, row = table[0].splitlines()
    assert header.startswith("photo,sample,leaf,area_cm2,uncertainty_cm2")
    assert row.startswith(f'\'=leaf.png,"oak, tree 7",1,{float(f"{area_cm2:.4g}"):g}')
    assert json.loads(table[1])[0]["area_cm2"] == float(f"{area_cm2:.4g}")
    phone.evaluate("document.getElementById('detail').close()")


def test_it_works_without_a_network_and_keeps_what_it_measured(site: Path, tmp_path: Path) -> None:
    first, second = (save(tmp_path, f"{name}.png", draw_disk(View(480, 640))[0]) for name in "ab")
    with chromium.Browser() as browser:
        with serve(site) as address:
            open_page(browser, address, **PHONE)
            measure_files(browser, [first])
        # The server is gone.
        browser.evaluate("document.title = 'before'")
        open_page(browser, address, **PHONE)
        assert browser.evaluate("document.title") == "Leaf area"
        assert [photo["file"] for photo in read_photos(browser)] == ["a.png"]
        (photo,) = measure_files(browser, [second])
        assert photo["measurement"]["refusal"] is None
        assert list_exceptions(browser) == []


def test_no_request_leaves_the_server(site: Path, tmp_path: Path) -> None:
    with serve(site) as address, chromium.Browser() as browser:
        browser.call("Network.enable")
        open_page(browser, address, **DESKTOP)
        measure_files(browser, [save(tmp_path, "a.png", draw_disk(View(480, 640))[0])])
        urls = [
            event["params"]["request"]["url"]
            for event in browser.events
            if event.get("method") == "Network.requestWillBeSent"
        ]
        assert urls and all(url.startswith((address, "blob:", "data:")) for url in urls), urls
        assert browser.evaluate("globalThis.crossOriginIsolated")


@pytest.mark.parametrize("content", ["cut off", "of another model"])
def test_a_measurement_file_that_is_not_ours_is_named(site: Path, tmp_path: Path, content: str) -> None:
    for path in site.iterdir():
        (tmp_path / path.name).symlink_to(path)
    broken = tmp_path / "photo.tflite"
    whole = broken.read_bytes()
    broken.unlink()
    broken.write_bytes(whole[:-1000] if content == "cut off" else b"TFL3" * 100)
    with serve(tmp_path) as address, chromium.Browser() as browser:
        open_page(browser, address, **PHONE)
        assert "photo.tflite is cut off" in browser.evaluate("document.getElementById('fault').textContent")


def test_keys_alone_suffice(phone: chromium.Browser, tmp_path: Path) -> None:
    measure_files(phone, [save(tmp_path, "keys.png", draw_disk(View(480, 640))[0])])
    phone.evaluate("document.activeElement.blur()")
    reached = []
    for _ in range(40):
        phone.press("Tab", 9)
        reached.append(phone.evaluate("document.activeElement.id || document.activeElement.className"))
        if phone.evaluate("document.activeElement.matches('#list button')"):
            break
    assert {"open-settings", "save-csv"} <= set(reached)
    phone.press("Enter", 13)
    assert phone.evaluate("document.getElementById('detail').open")
    assert phone.evaluate("document.activeElement.textContent") == "Done"
    phone.press("Escape", 27)
    assert not phone.evaluate("document.getElementById('detail').open")
    assert phone.evaluate("document.activeElement.matches('#list button')")


@pytest.fixture(scope="session")
def axe(request: pytest.FixtureRequest) -> str:
    """The checker of accessibility, fetched from npm once."""
    folder: Path = request.config.cache.mkdir("axe")
    script = folder / "package" / "axe.min.js"
    if not script.is_file():
        command = f"npm pack --silent {AXE} && tar xzf axe-core-*.tgz package/axe.min.js"
        done = subprocess.run(
            ["sh", "-c", command], cwd=folder, capture_output=True, timeout=120, check=False
        )
        if done.returncode:
            pytest.skip("axe-core cannot be fetched from npm")
    return script.read_text(encoding="utf-8")


@pytest.mark.parametrize("scheme", ["light", "dark"])
def test_screen_readers_and_contrast(phone: chromium.Browser, axe: str, scheme: str) -> None:
    features = [{"name": "prefers-color-scheme", "value": scheme}]
    phone.call("Emulation.setEmulatedMedia", features=features)
    phone.evaluate(axe)
    for state in ("", "open-settings", "first photo"):
        if state == "open-settings":
            phone.evaluate("document.getElementById('open-settings').click()")
        elif state:
            phone.evaluate("document.querySelector('#list button').click()")
        found = phone.evaluate("axe.run().then(r => JSON.stringify(r.violations))")
        serious = [v for v in json.loads(found) if v["impact"] in ("serious", "critical")]
        assert not serious, json.dumps(serious, indent=1)[:2000]
        phone.evaluate("for (const dialog of document.querySelectorAll('dialog[open]')) dialog.close()")
    phone.call("Emulation.setEmulatedMedia", features=[])


HINT = "document.getElementById('hint').dataset.state"


@pytest.mark.parametrize("kind", ["good", "unruled"])
def test_hints_while_aiming(address: str, tmp_path: Path, kind: str) -> None:
    image = draw_disk(View(960, 1280, px_per_mm=10.0))[0]
    if kind == "unruled":
        image = np.full((960, 1280, 3), 200, np.uint8)
    expected = {"good": "Good", "unruled": "No ruling"}[kind]
    with chromium.Browser(flags=fake_camera(tmp_path / "camera.mjpeg", image)) as browser:
        open_page(browser, address, **PHONE)
        browser.evaluate("document.getElementById('take').click()")
        browser.wait_until(f"document.getElementById('hint').textContent.startsWith('{expected}')", 60)
        assert browser.evaluate(HINT) == ("good" if kind == "good" else "wait")
        if kind == "good":
            browser.evaluate("document.getElementById('shutter').click()")
            browser.wait_until("document.getElementById('taken').textContent.includes('cm²')", 60)
            (photo,) = read_photos(browser)
            assert photo["measurement"]["refusal"] is None and max(photo["width"], photo["height"]) >= 1280
        browser.evaluate("document.getElementById('close-aim').click()")
        browser.wait_until("document.getElementById('preview').srcObject === null", 10)
        assert list_exceptions(browser) == []


def test_without_a_camera_the_phone_takes_the_photo(phone: chromium.Browser) -> None:
    phone.evaluate(
        "document.getElementById('capture').onclick = (e) => { e.preventDefault(); document.title = 'asked' }"
    )
    phone.evaluate("document.getElementById('take').click()")
    phone.wait_until("document.title === 'asked'", 10)
