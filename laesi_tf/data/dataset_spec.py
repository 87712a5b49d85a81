"""Describe a generated data set: how many samples, of which size, from which seed, in which shards."""

import json
from dataclasses import asdict, dataclass
from pathlib import Path

from laesi_tf.common.atomic_files import write_json
from laesi_tf.common.errors import InputError

SPEC_FILE = "dataset.json"


@dataclass(frozen=True, kw_only=True)
class DatasetSpec:
    """What a data set holds: `count` pictures of `size` (height, width), `per_shard` of them in a shard."""

    count: int
    size: tuple[int, int]
    per_shard: int
    seed: int
    format: str = "records"
    """"records", or "folder" where shards are those of `laesi_tf.data.image_folders`."""
    ranges: str
    """All that the scenes are drawn from, as TOML."""

    @property
    def shards(self) -> int:
        """How many shards make the data set."""
        return -(-self.count // self.per_shard)

    def pictures(self, shard: int) -> range:
        """Indices of the pictures in a shard."""
        return range(shard * self.per_shard, min((shard + 1) * self.per_shard, self.count))

    def name(self, shard: int) -> str:
        """Name of a shard's file or folder."""
        suffix = ".tfrecord" if self.format == "records" else ""
        return f"pictures-{shard:05}-of-{self.shards:05}{suffix}"


def start_dataset(folder: Path, contents: DatasetSpec) -> None:
    """Write what the data set in `folder` is to hold; InputError if another one has begun there."""
    path = folder / SPEC_FILE
    if path.is_file():
        if read_spec(folder) != contents:
            raise InputError(f"{folder} holds another data set; continue it as it was begun or name another")
        return
    if folder.is_dir() and any(folder.iterdir()):
        raise InputError(f"{folder} is neither empty nor a data set; name another folder")
    write_json(path, asdict(contents))


def read_spec(folder: Path | str) -> DatasetSpec:
    """What the data set in `folder` is to hold. Raises InputError."""
    path = Path(folder) / SPEC_FILE
    try:
        values = json.loads(path.read_text(encoding="utf-8"))
        return DatasetSpec(**values | {"size": tuple(values["size"])})
    except OSError as error:
        raise InputError(
            f"no data set in {folder}: {SPEC_FILE}: {error.strerror}; make one with generate"
        ) from None
    except (ValueError, TypeError, KeyError) as error:
        raise InputError(f"{path} is broken ({error}); make the data set again") from None
