"""Describe a generated data set: how many samples, of which size, from which seed, in which shards."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from laesi_tf.common.atomic_files import write_json
from laesi_tf.common.errors import InputError
from laesi_tf.common.schema import list_differing_fields

SPEC_FILE = "dataset.json"
FORMATS = ("records", "folder")
"""TFRecord shards (`laesi_tf.data.tfrecords`), or folders of JPEG and PNG (`laesi_tf.data.image_folders`)."""


@dataclass(frozen=True, kw_only=True)
class DatasetSpec:
    """A data set of `count` samples of `size` (height, width), `per_shard` of them in each shard."""

    count: int
    size: tuple[int, int]
    per_shard: int
    seed: int
    format: str = "records"
    """One of FORMATS."""
    ranges: str
    """All ranges that the scenes are sampled from, as TOML."""
    grid_mm: float | None = 1.0
    """Distance of the finest printed lines, mm; None where it differs from scene to scene."""
    synthesis_version: int = 1
    """`laesi_tf.synthesis.SYNTHESIS_VERSION` of the code that rendered the samples; 1 if not recorded."""

    @property
    def shards(self) -> int:
        """Number of shards."""
        return -(-self.count // self.per_shard)

    def sample_indices(self, shard: int) -> range:
        """Return the indices of the samples in a shard."""
        return range(shard * self.per_shard, min((shard + 1) * self.per_shard, self.count))

    def shard_name(self, shard: int) -> str:
        """Return the name of a shard's file or folder."""
        suffix = ".tfrecord" if self.format == "records" else ""
        return f"pictures-{shard:05}-of-{self.shards:05}{suffix}"


def start_dataset(folder: Path, spec: DatasetSpec) -> None:
    """Write `spec` to `folder`, or continue the data set there. Raises InputError if it is another one."""
    path = folder / SPEC_FILE
    if path.is_file():
        if differing := list_differing_fields(read_spec(folder), spec):
            raise InputError(
                f"{folder} holds another data set, which differs in {', '.join(differing)}; "
                "continue it as it was started or name another folder"
            )
        return
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(f"{folder} is neither empty nor a data set; name another folder")
    write_json(path, asdict(spec))


def read_spec(folder: Path | str) -> DatasetSpec:
    """Read the description of the data set in `folder`. Raises InputError."""
    path = Path(folder) / SPEC_FILE
    try:
        values: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        return DatasetSpec(**values | {"size": tuple(values["size"])})
    except OSError as error:
        raise InputError(
            f"no data set in {folder}: {SPEC_FILE}: {error.strerror}; make one with generate"
        ) from None
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path} is broken ({error}); generate the data set again") from None
