"""Bad input to the commands: exit status 2, one line on what, where and what to do, nothing half-written."""

import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from green import photo, save_run
from PIL import Image

from laesi_tf import evaluate, predict
from laesi_tf.cli.console import run_command
from laesi_tf.common.errors import InputError

pytestmark = pytest.mark.usefixtures("stand_in_networks")

Fails = Callable[..., str]


@pytest.fixture(scope="module")
def model(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return save_run(tmp_path_factory.mktemp("runs") / "area", "area")


@pytest.fixture
def leaf(tmp_path: Path) -> Path:
    Image.fromarray(photo(80, 80)).save(tmp_path / "leaf.png")
    (tmp_path / "manifest.csv").write_text("image,area_cm2\nleaf.png,10\n")
    return tmp_path / "leaf.png"


@pytest.fixture
def fails(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]) -> Fails:
    """Run a command that must fail and return its line; the folder must hold what it held before."""

    def call(command: ModuleType, *arguments: object) -> str:
        before = sorted(tmp_path.rglob("*"))
        monkeypatch.chdir(tmp_path)
        monkeypatch.setattr(sys, "argv", ["command", *map(str, arguments)])
        with pytest.raises(SystemExit) as stopped:
            run_command(command.main)
        printed = capsys.readouterr()
        assert stopped.value.code == 2
        assert printed.err.startswith("error: ") and printed.err.count("\n") == 1
        assert printed.out == ""
        assert sorted(tmp_path.rglob("*")) == before
        return printed.err

    return call


def test_wrong_arguments(fails: Fails, model: Path) -> None:
    assert "leaf.png" in fails(predict, "leaf.png")
    assert "PHOTO" in fails(predict, "--model", model)
    assert "--photos" in fails(evaluate, "--model", model)
    assert "--px-per-mm" in fails(predict, "leaf.png", "--model", model, "--px-per-mm", "0")
    assert "--colour" in fails(predict, "leaf.png", "--model", model, "--colour", "red")


def test_no_run(fails: Fails, leaf: Path, tmp_path: Path) -> None:
    assert "nowhere" in fails(predict, leaf, "--model", "nowhere")
    assert "nowhere" in fails(evaluate, "--model", "nowhere", "--photos", tmp_path / "manifest.csv")


def test_broken_run(fails: Fails, leaf: Path, model: Path, tmp_path: Path) -> None:
    broken = tmp_path / "broken"
    broken.mkdir()
    (broken / "config.toml").write_bytes((model / "config.toml").read_bytes())
    (broken / "best.keras").write_bytes((model / "best.keras").read_bytes()[:500])
    assert "best.keras" in fails(predict, leaf, "--model", broken)


def test_area_model_as_mask_model(fails: Fails, leaf: Path, model: Path) -> None:
    assert "--task mask" in fails(predict, leaf, "--mask-model", model)


def test_only_bad_photos(fails: Fails, leaf: Path, model: Path, tmp_path: Path) -> None:
    (tmp_path / "empty.jpg").touch()
    (tmp_path / "cut.png").write_bytes(leaf.read_bytes()[:80])
    assert "empty.jpg is empty" in fails(predict, tmp_path / "empty.jpg", "--model", model)
    said = fails(predict, tmp_path / "cut.png", tmp_path / "empty.jpg", "none.jpg", "--model", model)
    assert "cut.png" in said and "other 2" in said


def test_folder_without_photos(fails: Fails, model: Path, tmp_path: Path) -> None:
    (tmp_path / "photos").mkdir()
    assert "no photo in it" in fails(predict, tmp_path / "photos", "--model", model)


def test_bad_manifest(fails: Fails, leaf: Path, model: Path, tmp_path: Path) -> None:
    path = tmp_path / "manifest.csv"
    for row, message in [
        ("leaf.png,0", "line 2: area_cm2"),
        ("../leaf.png,3", "leaves"),
        ("x.png,3", "none of the 1 photos can be read"),
    ]:
        path.write_text(f"image,area_cm2\n{row}\n")
        assert message in fails(evaluate, "--model", model, "--photos", path)
    path.write_text("image,area_cm2,split\nleaf.png,3,train\n")
    assert "'test'" in fails(evaluate, "--model", model, "--photos", path, "--split", "test")


def test_manifest_of_bad_photos(fails: Fails, leaf: Path, model: Path, tmp_path: Path) -> None:
    leaf.write_bytes(leaf.read_bytes()[:80])
    assert "none of the 1 photos" in fails(evaluate, "--model", model, "--photos", tmp_path / "manifest.csv")


@pytest.mark.parametrize("command", [predict, evaluate])
@pytest.mark.parametrize("option", ["--out", "--json"])
def test_unwritable_output(
    fails: Fails, leaf: Path, model: Path, tmp_path: Path, command: ModuleType, option: str
) -> None:
    target = {"--out": leaf, "--json": leaf / "figures.json"}[option]
    photos = [leaf] if command is predict else ["--photos", tmp_path / "manifest.csv"]
    assert "cannot write" in fails(command, *photos, "--model", model, option, target)
    assert "cannot write" in fails(command, *photos, "--model", model, "--json", tmp_path)


def test_a_real_process_writes_one_line(leaf: Path, tmp_path: Path) -> None:
    arguments = [sys.executable, "-m", "laesi_tf.predict", leaf, "--model", tmp_path / "nowhere"]
    path = os.pathsep.join([str(Path(predict.__file__).parents[1]), os.environ.get("PYTHONPATH", "")])
    done = subprocess.run(
        arguments,
        capture_output=True,
        text=True,
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": path},
        timeout=120,
    )
    assert done.returncode == 2 and done.stdout == ""
    assert done.stderr.startswith("error: ") and len(done.stderr.splitlines()) == 1


def test_files_that_a_command_reads_are_not_replaced(tmp_path: Path) -> None:
    """A flag before the photos takes the first of them; a table may have the name of the manifest."""
    picture = tmp_path / "leaf.png"
    Image.fromarray(np.full((40, 40, 3), 200, np.uint8)).save(picture)
    before = picture.read_bytes()
    with pytest.raises(InputError, match="is no JSON file"):
        predict.main(["--json", str(picture), str(picture), "--out", str(tmp_path / "out")])
    with pytest.raises(InputError, match="is no JSON file"):
        predict.main([str(picture), "--jsonl", str(picture), "--out", str(tmp_path / "out")])
    assert picture.read_bytes() == before
    manifest = tmp_path / "photos.csv"
    manifest.write_text("image,area_cm2\nleaf.png,3\n", encoding="utf-8")
    with pytest.raises(InputError, match="this command reads it"):
        evaluate.main(["--photos", str(manifest), "--out", str(tmp_path)])
    assert manifest.read_text(encoding="utf-8").startswith("image,area_cm2")
