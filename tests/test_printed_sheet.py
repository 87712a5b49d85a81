"""The sheet to print: a PDF of the right size, whose ruling is read as well as that of bought paper."""

import re
import zlib
from pathlib import Path

import cv2
import numpy as np
import pytest
from drawn_sheets import View, draw_photo
from matplotlib.backends.backend_agg import FigureCanvasAgg

from laesi_tf import sheet
from laesi_tf.common.errors import InputError
from laesi_tf.estimators.photo_pyramid import PhotoPyramid
from laesi_tf.estimators.ruling.sheet_reader import SheetReader
from laesi_tf.exporting.printed_sheet import PAPERS, make_figure

MILLIMETRES = {1.0: 0.55, 5.0: 0.8, 10.0: 1.0}
PX_PER_MM = 16


@pytest.mark.parametrize("paper", sorted(PAPERS))
def test_the_pdf_has_the_papers_size_and_lines_a_millimetre_apart(tmp_path: Path, paper: str) -> None:
    path = tmp_path / "sheet.pdf"
    sheet.main(["--out", str(path), "--paper", paper])
    content = path.read_bytes()
    assert content.startswith(b"%PDF-") and len(content) < 100_000
    box = re.search(rb"/MediaBox \[ 0 0 ([\d.]+) ([\d.]+) \]", content)
    assert box is not None
    size = np.array([float(side) for side in box.groups()]) * 25.4 / 72
    np.testing.assert_allclose(size, [PAPERS[paper].width_mm, PAPERS[paper].height_mm], atol=0.01)
    streams = re.findall(rb"stream\r?\n(.*?)\r?\nendstream", content, re.DOTALL)
    drawing = max((zlib.decompress(stream) for stream in streams if stream[:1] == b"x"), key=len).decode()
    lines = re.findall(r"([\d.]+) ([\d.]+) m\n([\d.]+) ([\d.]+) l", drawing)
    assert len(lines) > PAPERS[paper].ruled_width_mm + PAPERS[paper].ruled_height_mm
    upright = sorted({float(x) for x, _, end, _ in lines if x == end})
    steps = np.diff(upright[: PAPERS[paper].ruled_width_mm]) * 25.4 / 72
    assert np.median(steps) == pytest.approx(1.0, abs=1e-3)


def test_the_pdf_is_the_same_each_time_and_other_names_are_refused(tmp_path: Path) -> None:
    for name in ("a.pdf", "b.pdf"):
        sheet.main(["--out", str(tmp_path / name)])
    assert (tmp_path / "a.pdf").read_bytes() == (tmp_path / "b.pdf").read_bytes()
    with pytest.raises(InputError, match=r"\.pdf"):
        sheet.main(["--out", str(tmp_path / "sheet.png")])


@pytest.fixture(scope="module")
def printed() -> np.ndarray:
    """The sheet as a printer would put it on paper, uint8 [h, w, 3]."""
    figure = make_figure(PAPERS["a4"])
    figure.set_dpi(PX_PER_MM * 25.4)
    canvas = FigureCanvasAgg(figure)
    canvas.draw()
    return np.asarray(canvas.buffer_rgba())[..., :3].copy()


def photograph(printed: np.ndarray, view: View) -> np.ndarray:
    """A photo of the sheet's ruling, uint8 [h, w, 3], blurred and noisy."""
    y, x = (np.mgrid[: view.height * 2, : view.width * 2] + 0.5) / 2
    u, v = view.to_sheet(x, y)
    places = [(u + 105) * PX_PER_MM - 0.5, (v + 160) * PX_PER_MM - 0.5]
    # Areas of paper rather than points of it.
    soft = cv2.GaussianBlur(printed, (0, 0), 0.5 * PX_PER_MM / view.px_per_mm)
    fine = cv2.remap(soft, *(place.astype(np.float32) for place in places), cv2.INTER_LINEAR)
    small = cv2.resize(fine, (view.width, view.height), interpolation=cv2.INTER_AREA).astype(np.float32)
    small = 0.92 * cv2.GaussianBlur(small, (0, 0), 0.7)
    noisy = small + np.random.default_rng(0).normal(0, 3, small.shape)
    coded = cv2.imencode(".jpg", np.clip(noisy, 0, 255).astype(np.uint8), [cv2.IMWRITE_JPEG_QUALITY, 88])[1]
    return cv2.imdecode(coded, cv2.IMREAD_COLOR)


VIEWS = (
    View(720, 960, px_per_mm=10.0, tilt=(0.15, -0.1)),
    View(720, 960, px_per_mm=5.0, k1=0.03),
    View(720, 540, px_per_mm=4.0, turn=0.4),
)


@pytest.mark.parametrize("view", VIEWS, ids=str)
def test_its_ruling_is_read_as_well_as_that_of_bought_paper(
    printed: np.ndarray, sheet_reader: SheetReader, view: View
) -> None:
    middle = np.array([view.width / 2, view.height / 2])
    expected = 1 / np.sqrt(view.density(middle[None])[0])
    errors = []
    for photo in (photograph(printed, view), draw_photo(view, MILLIMETRES, blur=0.7, quality=88)):
        reading = sheet_reader.read(PhotoPyramid(photo.astype(np.uint8)).overview, grid_mm=None)
        assert reading.camera is not None, reading.refusal
        errors.append(abs(float(reading.camera.px_per_mm(middle)) / expected - 1))
    assert errors[0] < 2e-3 and errors[0] < errors[1] + 1e-3


def test_a_printer_that_shrinks(printed: np.ndarray, sheet_reader: SheetReader) -> None:
    view = View(720, 960, px_per_mm=8.0)
    photo = photograph(printed, view)
    # What is taken for 0.97 mm has 8 pixels.
    reading = sheet_reader.read(PhotoPyramid(photo).overview, grid_mm=0.97)
    assert reading.camera is not None, reading.refusal
    assert float(reading.camera.px_per_mm(np.array([480.0, 360.0]))) == pytest.approx(8 / 0.97, rel=2e-3)
