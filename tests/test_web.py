"""The files of the page, the command that writes them, and what it fetches from npm. No browser."""

import io
import json
import shutil
import subprocess
import sys
import tarfile
import threading
import urllib.request
from pathlib import Path

import cv2
import numpy as np
import pytest

from laesi_tf import web
from laesi_tf.common.errors import InputError
from laesi_tf.estimators.litert_file import write_litert_file
from laesi_tf.exporting.web import litert_js, site
from laesi_tf.exporting.web.sentences import HINTS, collect_sentences
from laesi_tf.exporting.web.server import open_server

ASSETS = Path(site.__file__).parent / "assets"


@pytest.fixture
def runtime(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """Stand-ins for the files of LiteRT.js."""
    folder = tmp_path / "runtime"
    folder.mkdir()
    for package in litert_js._PACKAGES:
        for name in package.files.values():
            (folder / name).write_bytes(name.encode())
    monkeypatch.setattr(site.litert_js, "list_files", lambda: sorted(folder.iterdir()))
    return folder


def write(out: Path, model: bytes = b"model") -> str:
    site.write_site(
        out, models={"photo.tflite": model}, documents={"sheet-a4.pdf": b"%PDF"}, sentences={"a": 1}
    )
    return (out / "service_worker.js").read_text(encoding="utf-8")


@pytest.mark.usefixtures("runtime")
def test_the_service_worker_names_what_the_page_needs(tmp_path: Path) -> None:
    out = tmp_path / "page"
    worker = write(out)
    kept = json.loads(worker.splitlines()[1].removeprefix("const FILES = ").removesuffix(";"))
    assert {
        "index.html",
        "app.js",
        "worker.js",
        "photo.tflite",
        "sentences.json",
        "runtime/litert.js",
    } <= set(kept)
    assert all((out / name).is_file() for name in kept)
    assert not any(name.endswith(".wasm") for name in kept)
    assert worker == write(out) and worker != write(out, b"another")


def test_the_page_names_only_files_that_exist() -> None:
    text = "".join(path.read_text(encoding="utf-8") for path in ASSETS.iterdir() if path.suffix != ".png")
    assert "https://" not in text and "http://www.w3.org" in text
    manifest = json.loads((ASSETS / "manifest.webmanifest").read_text(encoding="utf-8"))
    assert all((ASSETS / icon["src"]).is_file() for icon in manifest["icons"])


def test_sentences_name_no_flags_and_every_hint_has_one() -> None:
    sentences = collect_sentences()
    texts = json.dumps(sentences, ensure_ascii=False)
    assert "--" not in texts and "manifest" not in texts
    assert len(sentences["refusals"]) == 11 and len(sentences["hints"]) == len(HINTS)
    assert all(len(text) < 70 for text in sentences["hints"].values())


def test_without_litert_js_one_line_says_what_to_do(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(site.litert_js, "list_files", list)
    with pytest.raises(InputError, match="--fetch-runtime"):
        web.main(["--out", str(tmp_path / "page")])
    monkeypatch.setattr(litert_js.shutil, "which", lambda _: None)
    with pytest.raises(InputError, match="npm is not installed"):
        web.main(["--fetch-runtime"])
    with pytest.raises(InputError, match="--out"):
        web.main([])


@pytest.mark.usefixtures("runtime")
def test_a_file_of_another_kind_is_refused(tmp_path: Path) -> None:
    model = tmp_path / "mask.tflite"
    write_litert_file(model, b"graph", {"kind": "mask"})
    with pytest.raises(InputError, match="'mask'"):
        web.main(["--out", str(tmp_path / "page"), "--model", str(model)])
    assert not (tmp_path / "page").exists()


@pytest.mark.usefixtures("runtime")
def test_another_page_is_not_replaced(tmp_path: Path) -> None:
    (tmp_path / "index.html").write_text("mine")
    with pytest.raises(InputError, match="holds other files"):
        web.main(["--out", str(tmp_path)])
    assert (tmp_path / "index.html").read_text() == "mine"


def make_npm(folder: Path, content: dict[str, bytes] | None) -> None:
    """Write a program that packs `content` as npm would; one that fails for None."""
    folder.mkdir()
    archive = io.BytesIO()
    with tarfile.open(fileobj=archive, mode="w:gz") as members:
        for name, data in (content or {}).items():
            member = tarfile.TarInfo(f"package/{name}")
            member.size = len(data)
            members.addfile(member, io.BytesIO(data))
    (folder / "packed").write_bytes(archive.getvalue())
    program = folder / "npm"
    copy = f"import shutil; shutil.copy({str(folder / 'packed')!r}, 'a.tgz'); print('a.tgz')"
    fail = "import sys; sys.exit('npm error: no network')"
    program.write_text(f"#!{sys.executable}\n{fail if content is None else copy}\n")
    program.chmod(0o755)


def test_litert_js_is_fetched_and_checked(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    package = litert_js._Package("@a/b", "1.0", "another", {"dist/index.js": "litert.js"})
    monkeypatch.setattr(litert_js, "_PACKAGES", (package,))
    out = tmp_path / "runtime"
    content = b'import { x } from "@litertjs/wasm-utils";'
    make_npm(tmp_path / "good", {"dist/index.js": content})
    monkeypatch.setenv("PATH", str(tmp_path / "good"))
    with pytest.raises(litert_js.FetchError, match="checksum"):
        litert_js.fetch(out)
    assert litert_js.list_files(out) == []
    digest = litert_js.base64.b64encode(
        litert_js.hashlib.sha512((tmp_path / "good" / "packed").read_bytes()).digest()
    )
    monkeypatch.setattr(litert_js, "_PACKAGES", (package._replace(sha512=digest.decode()),))
    litert_js.fetch(out)
    (path,) = litert_js.list_files(out)
    assert path.read_bytes() == b'import { x } from "./wasm_utils.js";'
    make_npm(tmp_path / "bad", None)
    monkeypatch.setenv("PATH", str(tmp_path / "bad"))
    with pytest.raises(litert_js.FetchError, match="no network"):
        litert_js.fetch(out)


def test_the_server_isolates_the_page_and_serves_loopback_alone(tmp_path: Path) -> None:
    (tmp_path / "a.wasm").write_bytes(b"x")
    with open_server(tmp_path, 0) as server:
        thread = threading.Thread(target=server.serve_forever)
        thread.start()
        with urllib.request.urlopen(f"http://127.0.0.1:{server.server_port}/a.wasm") as answer:
            headers = answer.headers
        with pytest.raises(InputError, match="another --port"):
            open_server(tmp_path, server.server_port)
        server.shutdown()
        thread.join()
    assert server.server_address[0] == "127.0.0.1"
    assert headers["Content-Type"] == "application/wasm"
    assert headers["Cross-Origin-Opener-Policy"] == "same-origin"
    assert headers["Cross-Origin-Embedder-Policy"] == "require-corp"


SHRINK = """
import fs from "node:fs";
const { AreaShrinker, fitSize } = await import(process.argv[2]);
const [width, height, side] = process.argv.slice(4).map(Number);
const size = fitSize(width, height, side);
const shrinker = new AreaShrinker(width, height, size.width, size.height);
const pixels = fs.readFileSync(process.argv[3]);
const strip = 50 * width * 4;
for (let at = 0; at < pixels.length; at += strip) shrinker.add(pixels.subarray(at, at + strip));
fs.writeSync(1, JSON.stringify([size.width, size.height, ...shrinker.pixels]));
"""


@pytest.mark.skipif(shutil.which("node") is None, reason="no Node.js")
@pytest.mark.parametrize(
    ("height", "width", "side"),
    [(200, 301, 100), (120, 160, 80), (90, 120, 30), (60, 50, 100), (333, 250, 111)],
)
def test_photos_are_shrunk_as_in_python(tmp_path: Path, height: int, width: int, side: int) -> None:
    image = np.random.default_rng(height).integers(0, 256, (height, width, 4), np.uint8)
    (tmp_path / "pixels").write_bytes(image.tobytes())
    (tmp_path / "shrink.mjs").write_text(SHRINK)
    # Node.js takes a file for a module by its name alone.
    shutil.copy(ASSETS / "shrink.js", tmp_path / "assets.mjs")
    arguments = [tmp_path / "assets.mjs", tmp_path / "pixels", str(width), str(height), str(side)]
    command = ["node", tmp_path / "shrink.mjs", *arguments]
    shown = json.loads(subprocess.run(command, capture_output=True, check=True).stdout)
    size = np.array([width, height])
    if max(size) > side:
        size = np.round(size * side / max(size)).astype(int)
    expected = cv2.resize(image[..., :3], tuple(map(int, size)), interpolation=cv2.INTER_AREA)
    assert shown[:2] == size.tolist()
    difference = np.array(shown[2:]).reshape(expected.shape) - expected.astype(int)
    assert np.abs(difference).max() <= 1 and np.mean(difference != 0) < 3e-3
