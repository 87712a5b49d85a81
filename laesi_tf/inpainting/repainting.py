"""Repaint a data set shard by shard, and continue one that was interrupted.

The result is a data set of the same form: everything but the image and the prompt stays as it is, and each
sample says how it was made (`inpaint_model`, `inpaint_seed`, `inpaint_strength`, `imperfection`). Images are
stored as PNG: a second JPEG compression would change the pixels outside the mask. `inpainting.json` beside
the shards has all settings.
"""

import itertools
import shutil
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from laesi_tf.common.atomic_files import read_json, write_json
from laesi_tf.common.errors import InputError
from laesi_tf.common.progress import progress_bar
from laesi_tf.data.canny import prompt_species
from laesi_tf.data.dataset_generation import find_missing_shards, remove_partial_shard, size_bytes
from laesi_tf.data.dataset_spec import SPEC_FILE, DatasetSpec, read_spec
from laesi_tf.data.encoding import encode_png_image
from laesi_tf.data.image_folders import merge_manifests
from laesi_tf.data.stored_samples import (
    STORED_FORMATS,
    StoredSample,
    read_records,
    require_complete,
    write_records,
)
from laesi_tf.inpainting.base import (
    Inpainter,
    InpainterSettings,
    MaskedImage,
    image_seed,
    restore_background,
)

INPAINTING_FILE = "inpainting.json"
"""Settings that a data set was repainted with; distinguishes it from one that generate wrote."""


def repaint_dataset(
    source: Path,
    out: Path,
    settings: InpainterSettings,
    *,
    model: str,
    seed: int,
    shard_fraction: tuple[int, int] = (0, 1),
) -> dict[str, Any]:
    """Repaint what is missing of shards i, i + n, i + 2n, ... for `shard_fraction` (i, n) of a data set.

    `model` is the name of the inpainter that `settings` load. After an interruption, batches that were
    finished are kept. Returns the metrics that the command prints. Raises InputError.
    """
    spec = read_spec(source)
    require_complete(source, spec)
    description = {
        "model": model,
        "seed": seed,
        **settings.describe(),
        "source": asdict(spec) | {"size": list(spec.size)},
    }
    _require_same_settings(out, description)
    shards = range(shard_fraction[0], spec.shards, shard_fraction[1])
    missing = find_missing_shards(shards, spec, out, remedy="repainted again")
    inpainter = settings.load() if missing else None
    _start_repainting(out, spec, description)
    started = time.monotonic()
    total = sum(len(spec.sample_indices(shard)) for shard in missing)
    bar: Any = progress_bar([], total=total, unit="picture")
    painted = 0
    try:
        for shard in missing:
            assert inpainter is not None
            painted += _repaint_shard(source, out, spec, shard, inpainter, seed=seed, advance=bar.update)
    except KeyboardInterrupt:
        raise KeyboardInterrupt(
            "interrupted; finished pictures are kept, run the same command again to continue"
        ) from None
    finally:
        bar.close()
    if spec.format == "folder":
        merge_manifests(out, spec)
    seconds = time.monotonic() - started
    return {
        "model": inpainter.name if inpainter is not None else model,
        "pictures": total,
        "pictures_painted": painted,
        "shards": len(missing),
        "shards_already_there": len(shards) - len(missing),
        "seconds": seconds,
        "pictures_per_s": painted / seconds if painted else 0.0,
        "mb": sum(size_bytes(out / spec.shard_name(shard)) for shard in shards) / 1e6,
    }


def repaint_samples(
    samples: Sequence[StoredSample], inpainter: Inpainter, *, seed: int, where: str
) -> list[StoredSample]:
    """Repaint stored samples of one size. Raises InputError, which says `where`, for an empty mask."""
    images = [_to_masked_image(sample, seed=seed, where=where) for sample in samples]
    return [
        _to_stored_sample(sample, image, repainting.image, inpainter).with_values(
            prompt=repainting.prompt, imperfection=repainting.imperfection
        )
        for sample, image, repainting in zip(samples, images, inpainter.repaint(images), strict=True)
    ]


def _repaint_shard(
    source: Path,
    out: Path,
    spec: DatasetSpec,
    shard: int,
    inpainter: Inpainter,
    *,
    seed: int,
    advance: Callable[[int], Any],
) -> int:
    """Repaint one shard and return the number of images that were painted now.

    A shard may take an hour, so each batch is written to a folder of parts first.
    """
    name = spec.shard_name(shard)
    stored = STORED_FORMATS[spec.format]
    parts = out / f".{name}.parts"
    files, painted = [], 0
    for batch in _split_batches(stored.read(source / name), inpainter.batch_size):
        part = parts / f"{batch[0].index:08}-{batch[-1].index:08}.tfrecord"
        if not part.is_file():
            write_records(part, repaint_samples(batch, inpainter, seed=seed, where=f"{source / name}"))
            painted += len(batch)
        files.append(part)
        advance(len(batch))
    remove_partial_shard(out / name)
    stored.write(out / name, (sample for part in files for sample in read_records(part)))
    shutil.rmtree(parts, ignore_errors=True)
    return painted


def _split_batches(samples: Iterator[StoredSample], size: int) -> Iterator[list[StoredSample]]:
    while batch := list(itertools.islice(samples, size)):
        yield batch


def _to_masked_image(sample: StoredSample, *, seed: int, where: str) -> MaskedImage:
    mask = sample.decode_mask()
    if not mask.any():
        raise InputError(f"the mask of image {sample.index} in {where} is empty: there is no leaf to repaint")
    prompt = str(sample.values.get("prompt", ""))
    species = str(sample.values["species"]) if "species" in sample.values else prompt_species(prompt)
    return MaskedImage(
        image=sample.decode_image(),
        mask=mask,
        prompt=prompt,
        species=species,
        seed=image_seed(seed, sample.seed, sample.index),
    )


def _to_stored_sample(
    sample: StoredSample, image: MaskedImage, painted: Any, inpainter: Inpainter
) -> StoredSample:
    restored = restore_background(painted, image.image, image.mask)
    return sample.with_image(encode_png_image(restored)).with_values(
        inpaint_model=inpainter.name, inpaint_seed=image.seed, inpaint_strength=float(inpainter.strength)
    )


def _require_same_settings(out: Path, expected: dict[str, Any]) -> None:
    """Raise InputError if `out` holds anything but a data set that was repainted as `expected` says."""
    path = out / INPAINTING_FILE
    if path.is_file():
        present = read_json(path)
        differing = sorted(key for key in {*expected, *present} if expected.get(key) != present.get(key))
        if differing:
            raise InputError(
                f"{out} was repainted with other settings: {', '.join(differing)}; continue it as it was "
                "started or name another folder"
            )
    elif out.is_dir() and any(out.iterdir()):
        raise InputError(f"{out} is neither empty nor a repainted data set; name another folder")


def _start_repainting(out: Path, spec: DatasetSpec, description: dict[str, Any]) -> None:
    """Describe the data set in `out`, unless that was done before an interruption."""
    if not (out / INPAINTING_FILE).is_file():
        write_json(out / INPAINTING_FILE, description)
    if not (out / SPEC_FILE).is_file():
        write_json(out / SPEC_FILE, asdict(spec))
