"""Results that survive: interruptions, full disks, vanished folders, other settings, changed photos."""

import errno
import json
import os
import shutil
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest
from measuring_folders import MeanLevel, names, predict, read_rows, save

from laesi_tf import predict as command
from laesi_tf.common import atomic_files
from laesi_tf.common.errors import InputError
from laesi_tf.estimators import factory
from laesi_tf.reporting.record_tables import RecordTable

LEVELS = {"a": 10, "b": 20, "c": 30, "d": 40}


@pytest.fixture
def photos(tmp_path: Path) -> Path:
    for name, level in LEVELS.items():
        save(tmp_path / "in" / f"{name}.png", level)
    return tmp_path / "in"


def use(monkeypatch: pytest.MonkeyPatch, estimator: MeanLevel) -> MeanLevel:
    monkeypatch.setattr(factory, "load_estimator", lambda *_, **__: estimator)
    return estimator


def test_ctrl_c_keeps_what_was_measured_and_the_same_command_continues(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    use(monkeypatch, MeanLevel())
    predict(tmp_path / "whole", photos, "--workers", 1)
    use(monkeypatch, MeanLevel(stop_after=2, error=KeyboardInterrupt()))
    with pytest.raises(
        KeyboardInterrupt, match=r"interrupted: the results of 2 of 4 photos are in .*areas.csv"
    ):
        predict(tmp_path / "out", photos, "--workers", 1)
    assert names(read_rows(tmp_path / "out")) == ["a.png", "b.png"]
    estimator = use(monkeypatch, MeanLevel())
    predict(tmp_path / "out", photos)
    assert estimator.calls == 2
    assert "unchanged since: 2 of 4 photos" in capsys.readouterr().out
    whole, continued = (tmp_path / name / "areas.csv" for name in ("whole", "out"))
    assert whole.read_bytes() == continued.read_bytes()
    assert use(monkeypatch, MeanLevel()).calls == 0
    predict(tmp_path / "out", photos)
    assert whole.read_bytes() == continued.read_bytes()


def test_changed_and_new_photos_are_measured(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, MeanLevel())
    predict(tmp_path / "out", photos)
    estimator = use(monkeypatch, MeanLevel())
    save(photos / "b.png", 200)
    os.utime(photos / "b.png", ns=(1, 1))
    save(photos / "aa.png", 5)
    rows = predict(tmp_path / "out", photos)
    assert estimator.calls == 2 and names(rows) == ["a.png", "aa.png", "b.png", "c.png", "d.png"]
    assert [float(row["area_cm2"]) for row in rows] == [10, 5, 200, 30, 40]


def test_again_measures_anew_and_keeps_the_results_of_other_photos(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, MeanLevel())
    whole = predict(tmp_path / "out", photos)
    estimator = use(monkeypatch, MeanLevel())
    rows = predict(tmp_path / "out", photos / "b.png", "--again")
    assert estimator.calls == 1 and sorted(names(rows)) == names(whole)
    assert len(list((tmp_path / "out").glob("*.overlay.jpg"))) == len(whole)


def test_again_with_other_settings_removes_what_was_there(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, MeanLevel())
    predict(tmp_path / "out", photos)
    table = tmp_path / "out" / "areas.csv"
    table.write_text(table.read_text() + "mine\n")
    rows = predict(tmp_path / "out", photos / "b.png", "--px-per-mm", 6, "--again")
    assert names(rows) == ["b.png"]
    assert [path.name for path in (tmp_path / "out").glob("*.overlay.jpg")] == ["b.overlay.jpg"]
    assert "mine" in (tmp_path / "out" / "areas.edited.csv").read_text()


def test_files_of_the_user_stay(photos: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    use(monkeypatch, MeanLevel())
    mine = photos / "b.overlay.jpg"
    mine.write_bytes(b"mine")
    rows = predict(photos, photos / "b.png")
    assert mine.read_bytes() == b"mine" and rows[0]["overlay"] == "b-png.overlay.jpg"
    for result in ("areas.csv", "areas.journal"):
        (photos / result).unlink()
    with pytest.raises(InputError, match=r"report\.html exists"):
        predict(photos, photos / "b.png")


def test_photos_of_earlier_commands_stay_in_the_table(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    use(monkeypatch, MeanLevel())
    predict(tmp_path / "out", photos / "c.png")
    rows = predict(tmp_path / "out", photos / "a.png")
    assert names(rows) == ["c.png", "a.png"]
    assert "photos of earlier commands that are in the table, too: 1\n" in capsys.readouterr().out


def test_other_settings_are_not_mixed(photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    use(monkeypatch, MeanLevel())
    predict(tmp_path / "out", photos, "--px-per-mm", 5)
    before = (tmp_path / "out" / "areas.csv").read_bytes()
    with pytest.raises(InputError, match=r"other settings \(px_per_mm: 5.0, now 6.0\); choose another --out"):
        predict(tmp_path / "out", photos, "--px-per-mm", 6)
    assert (tmp_path / "out" / "areas.csv").read_bytes() == before
    rows = predict(tmp_path / "out", photos, "--px-per-mm", 6, "--again")
    assert {row["px_per_mm"] for row in rows} == {"6.0"}


def test_a_table_of_another_origin_is_not_replaced(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, MeanLevel())
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "areas.csv").write_text("mine")
    with pytest.raises(InputError, match=r"exists, and areas\.journal, .* does not"):
        predict(tmp_path / "out", photos)
    assert (tmp_path / "out" / "areas.csv").read_text() == "mine"
    (tmp_path / "out" / "areas.csv").chmod(0o444)
    with pytest.raises(InputError, match="write-protected"):
        predict(tmp_path / "out", photos, "--again")


def test_a_table_that_somebody_edited_is_kept(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    use(monkeypatch, MeanLevel())
    predict(tmp_path / "out", photos)
    (tmp_path / "out" / "areas.csv").write_text("edited")
    assert len(predict(tmp_path / "out", photos)) == 4
    assert (tmp_path / "out" / "areas.edited.csv").read_text() == "edited"
    assert "areas.edited.csv" in capsys.readouterr().out


def test_csv_and_names_survive_again_and_other_settings(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, MeanLevel())
    (tmp_path / "n.csv").write_text("b.png,fir\n")
    out, table = str(tmp_path / "out"), tmp_path / "out" / "areas.csv"
    command.main([str(photos), "--out", out, "--csv", "excel", "--names", str(tmp_path / "n.csv")])
    before = table.read_bytes()
    command.main([str(photos), "--out", out, "--again"])
    assert table.read_bytes() == before
    command.main([str(photos), "--out", out, "--again", "--px-per-mm", "5"])
    assert table.read_bytes().startswith(b"\xef\xbb\xbf") and b"b.png,fir," in table.read_bytes()


def test_a_new_dialect_survives_an_interruption(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: object) -> None:
        raise KeyboardInterrupt

    use(monkeypatch, MeanLevel())
    predict(tmp_path / "out", photos)
    with monkeypatch.context() as patch, pytest.raises(KeyboardInterrupt):
        patch.setattr(RecordTable, "rewrite", interrupt)
        predict(tmp_path / "out", photos, "--csv", "excel")
    predict(tmp_path / "out", photos)
    assert (tmp_path / "out" / "areas.csv").read_bytes().startswith(b"\xef\xbb\xbf")


def test_a_refused_command_leaves_no_trace_in_the_folder(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, MeanLevel())
    predict(tmp_path / "out", photos)
    before = {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()}
    (tmp_path / "out" / "areas.csv").chmod(0o444)
    with pytest.raises(InputError, match="write-protected"):
        predict(tmp_path / "out", photos, "--csv", "excel")
    assert {path.name: path.read_bytes() for path in (tmp_path / "out").iterdir()} == before


def test_a_folder_of_an_earlier_version_has_no_kept_options(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, MeanLevel())
    predict(tmp_path / "out", photos)
    before, journal = (tmp_path / "out" / "areas.csv").read_bytes(), tmp_path / "out" / "areas.journal"
    lines = journal.read_bytes().splitlines(keepends=True)
    assert lines.pop(1).startswith(b'{"table": ')
    for damage in (b"", b'{"table": {"csv": "excel"}}\n', b'{"table": 1}\n'):
        journal.write_bytes(b"".join([*lines, damage]))
        predict(tmp_path / "out", photos)
        assert (tmp_path / "out" / "areas.csv").read_bytes() == before


def test_a_full_disk_is_one_error_and_keeps_whole_rows(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, MeanLevel())
    predict(tmp_path / "out", photos / "a.png")
    before = (tmp_path / "out" / "areas.csv").read_bytes()
    write = atomic_files.append_bytes
    state = {"count": 0}

    def fill_disk(path: Path, content: bytes) -> None:
        state["count"] += 1
        if state["count"] > 3:
            raise InputError(f"cannot write {path}: {os.strerror(errno.ENOSPC)}; free some space")
        write(path, content)

    for module in ("laesi_tf.measuring.journal", "laesi_tf.reporting.record_tables"):
        monkeypatch.setattr(f"{module}.append_bytes", fill_disk)
    with pytest.raises(InputError, match=r"No space left.*the results of \d of 4 photos are in"):
        predict(tmp_path / "out", photos, "--workers", 1)
    monkeypatch.undo()
    assert (tmp_path / "out" / "areas.csv").read_bytes().startswith(before)
    use(monkeypatch, MeanLevel())
    assert names(predict(tmp_path / "out", photos)) == ["a.png", "b.png", "c.png", "d.png"]


def test_appending_is_whole_or_not_at_all(tmp_path: Path) -> None:
    path = tmp_path / "file"
    with pytest.raises(InputError, match="its folder has vanished"):
        atomic_files.append_bytes(path, b"x")
    path.write_bytes(b"one\n")
    atomic_files.append_bytes(path, b"two\n")
    assert path.read_bytes() == b"one\ntwo\n"


def test_a_vanished_drive_ends_the_run(photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    class Unplug(MeanLevel):
        def measure(self, image: object, *rest: object) -> object:
            if self.calls == 1:
                shutil.rmtree(photos)
            return super().measure(image, *rest)

    use(monkeypatch, Unplug())
    with pytest.raises(InputError, match=r"have vanished; connect the drive.*2 of 4 photos"):
        predict(tmp_path / "out", photos, "--workers", 1)
    assert names(read_rows(tmp_path / "out")) == ["a.png", "b.png"]


def test_a_fault_with_one_photo_does_not_end_the_work(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    class Faulty(MeanLevel):
        def measure(self, image: object, *rest: object) -> object:
            if float(image.mean()) == LEVELS["b"]:  # type: ignore[attr-defined]
                raise ZeroDivisionError("one")
            return super().measure(image, *rest)

    use(monkeypatch, Faulty())
    rows = predict(tmp_path / "out", photos)
    assert [bool(row["area_cm2"]) for row in rows] == [True, False, True, True]
    assert "fault of laesi_tf (ZeroDivisionError: one); please report" in rows[1]["error"]
    assert "Traceback" in capsys.readouterr().err


def test_a_damaged_last_line_is_measured_again(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    use(monkeypatch, MeanLevel())
    whole = predict(tmp_path / "out", photos)
    journal = tmp_path / "out" / "areas.journal"
    journal.write_bytes(journal.read_bytes()[:-40])
    estimator = use(monkeypatch, MeanLevel())
    assert predict(tmp_path / "out", photos) == whole and estimator.calls == 1
    journal.write_text("no journal")
    with pytest.raises(InputError, match="is no journal of this version"):
        predict(tmp_path / "out", photos)
    assert predict(tmp_path / "out", photos, "--again") == whole


def test_two_commands_do_not_write_into_one_folder(
    photos: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    fcntl = pytest.importorskip("fcntl")
    use(monkeypatch, MeanLevel())
    predict(tmp_path / "out", photos)
    descriptor = os.open(tmp_path / "out", os.O_RDONLY)
    fcntl.flock(descriptor, fcntl.LOCK_EX)
    with pytest.raises(InputError, match="another command is writing"):
        predict(tmp_path / "out", photos)
    os.close(descriptor)


@pytest.mark.parametrize("workers", [1, 2, 5])
def test_rows_do_not_depend_on_the_number_of_workers(
    workers: int, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Uneven(MeanLevel):
        def measure(self, image: object, *rest: object) -> object:
            time.sleep(0.001 * (hash(float(image.mean())) % 7))  # type: ignore[attr-defined]
            return super().measure(image, *rest)

    for level in range(30):
        save(tmp_path / "in" / f"{level:02}.png", level)
    use(monkeypatch, Uneven())
    rows = predict(tmp_path / "out", tmp_path / "in", "--workers", workers)
    assert names(rows) == [f"{level:02}.png" for level in range(30)]
    assert rows[0]["refused"] == "True"


KILLED = """
import sys, time
sys.path.insert(0, sys.argv[1])
from measuring_folders import MeanLevel
from laesi_tf import predict
from laesi_tf.estimators import factory
predict.load_tensorflow = lambda **_: None

class Slow(MeanLevel):
    def measure(self, image, *rest):
        time.sleep(0.05)
        return super().measure(image, *rest)

factory.load_estimator = lambda *_, **__: Slow()
predict.main(sys.argv[2:])
"""


def test_kill_9_loses_only_photos_in_progress(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    for level in range(1, 25):
        save(tmp_path / "in" / f"{level:02}.png", level)
    arguments = [
        str(tmp_path / "in"),
        "--out",
        str(tmp_path / "out"),
        "--workers",
        "2",
        "--json",
        str(tmp_path / "j"),
    ]
    (tmp_path / "n.csv").write_text("01.png,oak\n24.png,fir\n")
    only_once = ["--names", str(tmp_path / "n.csv"), "--csv", "excel"]
    process = subprocess.Popen(
        [sys.executable, "-c", KILLED, str(Path(__file__).parent), *arguments, *only_once]
    )
    table = tmp_path / "out" / "areas.csv"
    deadline = time.monotonic() + 60
    while not table.exists() or table.read_bytes().count(b"\n") < 5:
        assert time.monotonic() < deadline and process.poll() is None
        time.sleep(0.01)
    process.send_signal(signal.SIGKILL)
    process.wait()
    before = read_rows(tmp_path / "out")
    assert 4 <= len(before) < 24
    estimator = use(monkeypatch, MeanLevel())
    command.main(arguments)
    after = read_rows(tmp_path / "out")
    assert after[: len(before)] == before and names(after) == [f"{level:02}.png" for level in range(1, 25)]
    assert estimator.calls <= 24 - len(before)
    figures = json.loads((tmp_path / "j").read_text())
    assert [figure["sample"] for figure in figures] == ["oak", *[None] * 22, "fir"]
    assert table.read_bytes().startswith(b"\xef\xbb\xbf")
