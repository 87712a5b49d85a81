"""Mixtures: shares, order, continuing, and what is said of files that ask for the impossible."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
import tensorflow as tf
from green import disk, photo
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from test_records import CONTENTS, SIZE, fill

from laesi_tf.common.errors import InputError
from laesi_tf.data import mixture
from laesi_tf.data.mixture import SLOTS, Source, load_mixture, mix_sources


def counting(name: int, weight: float) -> Source:
    """A source whose n-th picture has the area 1000 * name + n."""

    def picture(place: tf.Tensor) -> dict[str, tf.Tensor]:
        area = tf.cast(place + 1000 * name, tf.float32)
        return {"image": tf.zeros([2, 2, 3]), "mask": tf.zeros([2, 2]), "area_cm2": area, "px_per_mm": 1.0}

    return Source(str(name), weight, lambda start: tf.data.Dataset.range(start, 10**6).map(picture))


def drawn(sources: Sequence[Source], *, start: int = 0, count: int) -> list[int]:
    return [int(picture["area_cm2"]) for picture in mix_sources(sources, seed=5, start=start).take(count)]


@settings(max_examples=20, deadline=None)
@given(weights=st.lists(st.floats(0.01, 100), min_size=1, max_size=5))
def test_shares_are_exact_to_the_slot(weights: list[float]) -> None:
    quotas = mixture._slots_per_source(weights)
    assert quotas.sum() == SLOTS and (quotas >= 1).all()
    share = np.array(weights) / sum(weights) * SLOTS
    assert (np.abs(quotas - share) <= len(weights) + 1).all()


def test_each_source_gives_its_pictures_in_its_order_and_share() -> None:
    found = drawn([counting(0, 3), counting(1, 1)], count=2 * SLOTS)
    firsts, seconds = ([area % 1000 for area in found if area // 1000 == name] for name in (0, 1))
    assert firsts == list(range(3 * SLOTS // 2)) and seconds == list(range(SLOTS // 2))
    # Shuffled, not in runs: the second source comes up in every eighth of a block.
    assert all(any(area >= 1000 for area in found[at : at + 32]) for at in range(0, SLOTS, 32))


@pytest.mark.parametrize("start", [1, SLOTS, 3 * SLOTS + 17])
def test_a_stream_that_starts_later_continues_the_same(start: int) -> None:
    sources = [counting(0, 2), counting(1, 1), counting(2, 1)]
    assert drawn(sources, start=start, count=40) == drawn(sources, count=start + 40)[start:]


Write = Callable[[str], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """A folder with a data set, three photos and the mixture to write."""
    fill(tmp_path / "dataset")
    rows = ["image,area_cm2,mask,split"]
    for number in range(3):
        Image.fromarray(photo(40, 60)).save(tmp_path / f"{number}.png")
        Image.fromarray(disk(40, 60)).save(tmp_path / f"{number}_mask.png")
        rows.append(f"{number}.png,{500 + number},{number}_mask.png,train")
    (tmp_path / "manifest.csv").write_text("\n".join(rows))

    def write_(text: str) -> Path:
        path = tmp_path / "mixture.toml"
        path.write_text(text)
        return path

    return write_


def load(path: Path, *, masked: bool = False) -> list[Source]:
    return load_mixture(path, size=SIZE, seed=3, masked=masked)


LIVE, RECORDS, PHOTOS = (
    f'[{name}]\nkind = "{kind}"\n'
    for name, kind in {"scenes": "live", "cached": "records", "real": "photos"}.items()
)
WHOLE = """
[scenes]
kind = "live"
count = 20
[cached]
kind = "records"
folder = "dataset"
count = 10
[real]
kind = "photos"
split = "train"
count = 2
"""


def test_counts_bound_how_many_different_pictures_there_are(write: Write) -> None:
    sources = load(write(WHOLE), masked=True)
    assert [source.weight for source in sources] == [20, 10, 2]
    found = [float(picture["area_cm2"]) for picture in mix_sources(sources, seed=3).take(3 * SLOTS)]
    photos = [area for area in found if area >= 500]
    assert set(photos) == {500, 501} and abs(len(photos) - 3 * SLOTS / 16) <= 6
    images = set()
    for picture in mix_sources(sources, seed=3).take(2 * SLOTS):
        images.add(picture["image"].numpy().tobytes())
        assert picture.keys() == {"image", "mask", "area_cm2", "px_per_mm"}
        assert picture["image"].shape == (*SIZE, 3) and picture["mask"].numpy().any()
    assert len(images) == 20 + 10 + 1  # the photos look alike


def test_live_sources_show_different_leaves(write: Write) -> None:
    both = LIVE + "weight = 1\n" + LIVE.replace("scenes", "others") + "weight = 1\n"
    areas = [[float(p["area_cm2"]) for p in source.stream(0).take(4)] for source in load(write(both))]
    assert not set(areas[0]) & set(areas[1])


def test_live_sources_have_the_ranges_and_textures_of_the_run(write: Write) -> None:
    path, textures = write(LIVE + "count = 2\n"), tf.zeros([1, 8, 8, 3])
    plain, other, textured = (
        next(iter(load_mixture(path, size=SIZE, seed=3, masked=False, **more)[0].stream(0)))["image"].numpy()
        for more in ({}, {"ranges": "rendering_1"}, {"textures": textures})
    )
    assert (plain != other).any() and (plain != textured).any()


@pytest.mark.parametrize("stream", ["false", "true"])
def test_photos_come_all_before_any_comes_again(write: Write, stream: str) -> None:
    (photos,) = load(write(f'[real]\nkind = "photos"\nweight = 1\nstream = {stream}\n'))
    found = [float(picture["area_cm2"]) for picture in mix_sources([photos], seed=3).take(9)]
    for epoch in range(3):
        assert sorted(found[3 * epoch : 3 * epoch + 3]) == [500, 501, 502]
    assert [float(one["area_cm2"]) for one in mix_sources([photos], seed=3, start=4).take(5)] == found[4:]


def test_weight_zero_is_not_even_opened(write: Write) -> None:
    (live,) = load(write(f'{LIVE}weight = 0.5\n[cached]\nkind = "records"\nfolder = "nowhere"\nweight = 0\n'))
    assert live.name == "scenes"


def test_ranges_stand_in_the_mixture_itself(write: Write) -> None:
    (narrow,) = load(
        write(f"{LIVE}weight = 1\n[scenes.ranges.camera]\nclosest_mm = 200\nfarthest_mm = 200\n")
    )
    scales = [float(picture["px_per_mm"]) for picture in narrow.stream(0).take(3)]
    assert max(scales) <= SIZE[1] / 200 * 1.01


@pytest.mark.parametrize(
    ("text", "said"),
    [
        (f"{LIVE}weight = 1\n{PHOTOS}count = 2\n", "weights and counts"),
        (f"{PHOTOS}count = 4\n", "4 pictures are asked for, but there are 3"),
        (f'{RECORDS}folder = "dataset"\ncount = 11\n', f"11 pictures.*there are {CONTENTS.count}"),
        ("[scenes]\ncount = 4\n", r"\[scenes\] is of kind None; use live"),
        ('[scenes]\nkind = "alive"\n', r"\[scenes\] is of kind 'alive'; use live"),
        (f"{LIVE}cuont = 4\n", "no 'cuont'; use count"),
        (f"{LIVE}count = -1\n", "must not be below 0"),
        (f"{LIVE}count = 1.5\n", "wrong type"),
        (f"{PHOTOS}weight = true\n", "wrong type"),
        (f"{LIVE}weight = 1\nranges = {{camrea = 1}}\n", "unknown key 'camrea'"),
        ("", "gives no source"),
        (LIVE, "no weight and no count"),
        ("[live", "cannot read mixture"),
    ],
)
def test_impossible_mixtures_are_named(write: Write, text: str, said: str) -> None:
    with pytest.raises(InputError, match=said):
        load(write(text))


def test_records_of_another_size_are_named(write: Write) -> None:
    path = write(f'{RECORDS}folder = "dataset"\nweight = 1\n')
    with pytest.raises(InputError, match="48 x 64 pixels; train with that --size"):
        load_mixture(path, size=(32, 32), seed=0, masked=False)
