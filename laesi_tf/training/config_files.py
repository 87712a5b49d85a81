"""Read and write training configurations as TOML files."""

import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from laesi_tf.common.atomic_files import write_text
from laesi_tf.common.errors import InputError
from laesi_tf.common.schema import from_table, read_toml
from laesi_tf.training.config import TrainConfig

PROVENANCE = "provenance"
"""The table of a run's config.toml that says where the run comes from; not an input."""


def config_from_dict(values: Mapping[str, Any]) -> TrainConfig:
    """Return a configuration from values as TOML or flags hold them. Raises InputError, naming the key."""
    return from_table(TrainConfig, values)


def load_config(path: Path | str, **overrides: Any) -> TrainConfig:
    """Return the configuration in a TOML file, such as a run's config.toml, changed by `overrides`.

    Raises InputError, which names the file only where its own values are wrong.
    """
    values = read_toml(path)
    values.pop(PROVENANCE, None)
    try:
        return config_from_dict(values | overrides)
    except InputError:
        from_table(TrainConfig, values, where=f"{path}:")
        raise


def save_config(path: Path | str, config: TrainConfig, provenance: Mapping[str, Any]) -> None:
    """Write `config` as TOML with a table that says where the run comes from."""
    values = dataclasses.asdict(config) | {"size": list(config.size)}
    # Commands import this module before they know whether what training needs is installed.
    import tomli_w

    write_text(path, tomli_w.dumps({**values, PROVENANCE: provenance}))
