"""Mixtures: shares, order, continuation, and messages for impossible files."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import pytest
import tensorflow as tf
from green import disk, photo
from hypothesis import given, settings
from hypothesis import strategies as st
from PIL import Image
from record_sets import SIZE, SPEC, write_dataset
from scenes import only

from laesi_tf import train
from laesi_tf.common.errors import InputError
from laesi_tf.data import mixture
from laesi_tf.data.mixture import SLOTS, Source, load_mixture, mix_sources


def counting(name: int, weight: float) -> Source:
    """A source whose n-th sample has the area 1000 * name + n."""

    def sample(place: tf.Tensor) -> dict[str, tf.Tensor]:
        area = tf.cast(place + 1000 * name, tf.float32)
        return {"image": tf.zeros([2, 2, 3]), "mask": tf.zeros([2, 2]), "area_cm2": area, "px_per_mm": 1.0}

    return Source(str(name), weight, lambda start: tf.data.Dataset.range(start, 10**6).map(sample))


def areas_of_mixture(sources: Sequence[Source], *, start: int = 0, count: int) -> list[int]:
    return [int(sample["area_cm2"]) for sample in mix_sources(sources, seed=5, start=start).take(count)]


@settings(max_examples=20, deadline=None)
@given(weights=st.lists(st.floats(0.01, 100), min_size=1, max_size=5))
def test_shares_are_exact_to_the_slot(weights: list[float]) -> None:
    quotas = mixture._slots_per_source(weights)
    assert quotas.sum() == SLOTS and (quotas >= 1).all()
    share = np.array(weights) / sum(weights) * SLOTS
    assert (np.abs(quotas - share) <= len(weights) + 1).all()


def test_each_source_gives_its_samples_in_order_and_by_its_share() -> None:
    areas = areas_of_mixture([counting(0, 3), counting(1, 1)], count=2 * SLOTS)
    firsts, seconds = ([area % 1000 for area in areas if area // 1000 == name] for name in (0, 1))
    assert firsts == list(range(3 * SLOTS // 2)) and seconds == list(range(SLOTS // 2))
    # Shuffled, not in runs: the second source comes up in every eighth of a block.
    assert all(any(area >= 1000 for area in areas[at : at + 32]) for at in range(0, SLOTS, 32))


@pytest.mark.parametrize("start", [1, SLOTS, 3 * SLOTS + 17])
def test_a_stream_that_starts_later_continues_the_same(start: int) -> None:
    sources = [counting(0, 2), counting(1, 1), counting(2, 1)]
    assert (
        areas_of_mixture(sources, start=start, count=40)
        == areas_of_mixture(sources, count=start + 40)[start:]
    )


Write = Callable[[str], Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """A folder with a data set, three photos, ranges with few components, and the mixture to write."""
    (tmp_path / "simple.toml").write_text(f"without = {sorted(only('surface').without)}\n")
    write_dataset(tmp_path / "dataset")
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


def load(path: Path, *, needs_masks: bool = False) -> list[Source]:
    return load_mixture(path, size=SIZE, seed=3, needs_masks=needs_masks)


LIVE, RECORDS, PHOTOS = (
    f'[{name}]\nkind = "{kind}"\n'
    for name, kind in {"scenes": "live", "cached": "records", "real": "photos"}.items()
)
WHOLE = """
[scenes]
kind = "live"
ranges = "simple.toml"
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


def test_counts_limit_the_number_of_different_samples(write: Write) -> None:
    sources = load(write(WHOLE), needs_masks=True)
    assert [source.weight for source in sources] == [20, 10, 2]
    areas = [float(sample["area_cm2"]) for sample in mix_sources(sources, seed=3).take(3 * SLOTS)]
    photos = [area for area in areas if area >= 500]
    assert set(photos) == {500, 501} and abs(len(photos) - 3 * SLOTS / 16) <= 6
    images = set()
    for sample in mix_sources(sources, seed=3).take(2 * SLOTS):
        images.add(sample["image"].numpy().tobytes())
        assert sample.keys() == {"image", "mask", "area_cm2", "px_per_mm"}
        assert sample["image"].shape == (*SIZE, 3) and sample["mask"].numpy().any()
    assert len(images) == 20 + 10 + 1  # the photos look alike


def test_live_sources_show_different_leaves(write: Write) -> None:
    live = LIVE + 'ranges = "simple.toml"\nweight = 1\n'
    sources = load(write(live + live.replace("scenes", "others")))
    areas = [{float(sample["area_cm2"]) for sample in source.stream(0).take(4)} for source in sources]
    assert not areas[0] & areas[1]


def test_live_sources_have_the_ranges_and_textures_of_the_run(write: Write) -> None:
    path, textures = write(LIVE + "count = 2\n"), tf.zeros([1, 8, 8, 3])
    simple, other = ({"ranges": str(path.parent / f"{name}.toml")} for name in ("simple", "other"))
    (path.parent / "other.toml").write_text(f"without = {sorted(only('ruling').without)}\n")
    images = []
    for options in (simple, other, simple | {"textures": textures}):
        (source,) = load_mixture(path, size=SIZE, seed=3, needs_masks=False, **options)
        images.append(next(iter(source.stream(0)))["image"].numpy())
    plain, ruled, textured = images
    assert (plain != ruled).any() and (plain != textured).any()


@pytest.mark.parametrize("stream", ["false", "true"])
def test_all_photos_are_used_before_any_is_repeated(write: Write, stream: str) -> None:
    (photos,) = load(write(f'[real]\nkind = "photos"\nweight = 1\nstream = {stream}\n'))
    areas = [float(sample["area_cm2"]) for sample in mix_sources([photos], seed=3).take(9)]
    for epoch in range(3):
        assert sorted(areas[3 * epoch : 3 * epoch + 3]) == [500, 501, 502]
    assert [float(one["area_cm2"]) for one in mix_sources([photos], seed=3, start=4).take(5)] == areas[4:]


def test_a_source_of_weight_zero_is_not_opened(write: Write) -> None:
    (live,) = load(write(f'{LIVE}weight = 0.5\n[cached]\nkind = "records"\nfolder = "nowhere"\nweight = 0\n'))
    assert live.name == "scenes"


def test_a_mixture_may_contain_ranges(write: Write) -> None:
    (narrow,) = load(
        write(f"{LIVE}weight = 1\n[scenes.ranges.camera]\nclosest_mm = 200\nfarthest_mm = 200\n")
    )
    scales = [float(sample["px_per_mm"]) for sample in narrow.stream(0).take(3)]
    assert max(scales) <= SIZE[1] / 200 * 1.01


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (f"{LIVE}weight = 1\n{PHOTOS}count = 2\n", "weights and counts"),
        (f"{PHOTOS}count = 4\n", "photos: count is 4, but there are 3"),
        (f'{RECORDS}folder = "dataset"\ncount = 11\n', f"count is 11, but there are {SPEC.count}"),
        ("[scenes]\ncount = 4\n", r"\[scenes\] kind = None must be live, records or photos"),
        ('[scenes]\nkind = "alive"\n', r"\[scenes\] kind = 'alive' must be .*did you mean 'live'"),
        (f"{LIVE}cuont = 4\n", "unknown key 'cuont'; did you mean 'count'"),
        (f"{LIVE}count = -1\n", "count = -1 must be a whole number from 0 up"),
        (f"{LIVE}count = 1.5\n", "count = 1.5 must be a whole number"),
        (f"{PHOTOS}weight = true\n", "weight = True must be a number"),
        (f"{LIVE}weight = 1\nranges = {{camrea = 1}}\n", "unknown key 'camrea'"),
        ("", "gives no source"),
        (LIVE, "no weight and no count"),
        ("[live", "is not TOML"),
        ("live = 3", "live must be a table"),
    ],
)
def test_impossible_mixtures_are_named(write: Write, text: str, message: str) -> None:
    with pytest.raises(InputError, match=message):
        load(write(text))


def test_records_of_another_size_are_named(write: Write) -> None:
    path = write(f'{RECORDS}folder = "dataset"\nweight = 1\n')
    with pytest.raises(InputError, match="48 x 64 pixels; train with that --size"):
        load_mixture(path, size=(32, 32), seed=0, needs_masks=False)


def test_a_truncated_shard_is_named_by_train(write: Write, tmp_path: Path) -> None:
    path = write(f'{RECORDS}folder = "dataset"\nweight = 1\n')
    shard = tmp_path / "dataset" / SPEC.shard_name(0)
    shard.write_bytes(shard.read_bytes()[:-20])
    arguments = [f"--mixture={path}", f"--out={tmp_path / 'run'}", "--size=48x64", "--weights=none"]
    with pytest.raises(InputError, match=rf"{shard.name} is truncated; run the command that wrote it again"):
        train.main(arguments)
    assert not (tmp_path / "run").exists()
