"""Repaint the leaves of a data set that generate wrote, by a diffusion model or from photos of leaves.

--model controlnet is the paper's: Stable Diffusion paints into the mask, guided by the edges of the mask and
by a text; it needs the extra `inpaint`, and in practice a GPU. --model exemplar warps the texture of
photographed leaves onto the masks, without a network. Outside the mask every pixel stays as it is.

The result is a data set of the same form. Run the command again to continue after a stop. n machines with
--shard 0/n to n-1/n together write the same files as one machine alone.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.dataset_arguments import add_shard_argument
from laesi_tf.cli.tensorflow_setup import load_tensorflow
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.errors import InputError
from laesi_tf.common.parsing import non_negative_int
from laesi_tf.common.schema import add_option_arguments, from_table
from laesi_tf.data.dataset_spec import SPEC_FILE, read_spec
from laesi_tf.inpainting.base import InpainterSettings
from laesi_tf.inpainting.registry import INPAINTERS


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError."""
    options = _make_parser().parse_args(arguments)
    settings = _read_settings(options)
    read_spec(options.shards)
    if options.out.resolve() == options.shards.resolve():
        raise InputError(f"--out {options.out} is the data set that is read; name another folder")
    require_writable(options.out / SPEC_FILE)
    settings.check()
    load_tensorflow(uses_gpu=False)
    from laesi_tf.inpainting.repainting import repaint_dataset

    metrics = repaint_dataset(
        options.shards,
        options.out,
        settings,
        model=options.model,
        seed=options.seed,
        shard_fraction=options.shard,
    )
    if options.json is not None:
        write_json(options.json, metrics)
    print(_format_summary(metrics, options.out))


def _read_settings(options: argparse.Namespace) -> InpainterSettings:
    """Return the settings of the chosen inpainter. Raises InputError for an option of another one."""
    given = vars(options)
    for model, cls in INPAINTERS.items():
        for name in cls.field_names():
            if name in given and name not in INPAINTERS[options.model].field_names():
                flag = f"--{name.replace('_', '-')}"
                raise InputError(
                    f"{flag} has no effect with --model {options.model}; leave it out, or add --model {model}"
                )
    chosen = INPAINTERS[options.model]
    return from_table(chosen, {name: given[name] for name in chosen.field_names() if name in given})


def _format_summary(metrics: Mapping[str, Any], out: Path) -> str:
    present = metrics["shards_already_there"]
    return (
        "{pictures} pictures in {shards} shards repainted by {model}, {seconds:.0f} s at "
        "{pictures_per_s:.2f} pictures/s, size {mb:.0f} MB".format_map(metrics)
        + (f"; {present} shards existed already" if present else "")
        + f": {out}"
    )


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("inpaint", __doc__)
    parser.add_argument("shards", type=Path, metavar="SHARDS", help="folder of the data set to repaint")
    parser.add_argument(
        "--out", type=Path, required=True, metavar="DIR", help="folder of the repainted data set"
    )
    parser.add_argument("--model", choices=tuple(INPAINTERS), default="controlnet", help="the inpainter")
    parser.add_argument("--seed", type=non_negative_int, default=0, help="seed of what is painted")
    add_shard_argument(parser, verb="repaint")
    for name, settings in INPAINTERS.items():
        add_option_arguments(parser.add_argument_group(f"--model {name}"), settings)
    return parser


if __name__ == "__main__":
    run_command(main)
