"""Read and write training configurations as TOML, dictionaries and command-line flags."""

import argparse
import dataclasses
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import tomli_w

from laesi_tf.common.atomic_files import write_text
from laesi_tf.common.errors import InputError
from laesi_tf.common.schema import read_toml, suggest_closest
from laesi_tf.training.config import TrainConfig

# The table of a run's config.toml that says where it came from; not an input.
PROVENANCE = "provenance"


def config_from_dict(values: Mapping[str, Any]) -> TrainConfig:
    """A configuration from plain values as TOML or flags hold them; InputError names an unknown key."""
    names = [field.name for field in dataclasses.fields(TrainConfig)]
    for key in values:
        if key not in names:
            raise InputError(
                f"unknown configuration key {key!r}{suggest_closest(key, names)}; see --help for all keys"
            )
    return TrainConfig(**values)


def load_config(path: Path | str, **overrides: Any) -> TrainConfig:
    """The configuration in a TOML file, such as a run's config.toml, with `overrides` winning."""
    values = read_toml(path)
    values.pop(PROVENANCE, None)
    try:
        return config_from_dict(values | overrides)
    except InputError:
        try:
            config_from_dict(values)
        except InputError as error:
            raise InputError(f"{path}: {error}") from None
        raise


def save_config(path: Path | str, config: TrainConfig, provenance: Mapping[str, Any]) -> None:
    """Write `config` as TOML with a table that says where the run came from."""
    values = dataclasses.asdict(config) | {"size": list(config.size)}
    write_text(path, tomli_w.dumps({**values, PROVENANCE: provenance}))


def add_config_arguments(parser: argparse.ArgumentParser) -> None:
    """One flag per field, --batch-size for `batch_size`; a flag that is not given leaves no attribute."""
    for field in dataclasses.fields(TrainConfig):
        choices = field.metadata["choices"]
        sized = field.name == "size"
        parser.add_argument(
            f"--{field.name.replace('_', '-')}",
            type=str if sized else field.type,
            default=argparse.SUPPRESS,
            metavar="|".join(choices) or field.name.split("_")[-1].upper(),
            help=f"{field.metadata['help']} (default: {'224x224' if sized else field.default})",
        )
