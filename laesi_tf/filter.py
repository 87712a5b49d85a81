"""Drop repainted images whose leaf no longer fits its mask.

A mask network segments each image of a data set that inpaint wrote. Where what it finds differs from the mask
in more pixels than --max-deviation times the leaf's, the image is rejected. The accepted and the rejected
images become a data set each, `accepted` and `rejected` in --out, beside deviations.csv, a histogram and a
sheet of examples. The same command continues after a stop.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.dataset_arguments import add_filter_arguments
from laesi_tf.cli.tensorflow_setup import load_tensorflow
from laesi_tf.common.atomic_files import require_writable, write_figure, write_json
from laesi_tf.data.dataset_spec import read_spec

if TYPE_CHECKING:
    from laesi_tf.inpainting.filtering import FilterResult

_EXAMPLES = 12


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError."""
    options = _make_parser().parse_args(arguments)
    dataset = options.dataset.resolve()
    out = options.out or dataset.with_name(f"{dataset.name}-filtered")
    read_spec(options.dataset)
    require_writable(out / "histogram.png")
    load_tensorflow()
    from laesi_tf.inpainting.filtering import filter_dataset, load_examples
    from laesi_tf.reporting.filter_report import draw_examples, plot_deviations
    from laesi_tf.reporting.overlay import write_png

    result = filter_dataset(
        options.dataset, out, mask_run=options.mask_run, max_deviation=options.max_deviation
    )
    write_figure(out / "histogram.png", plot_deviations(result.deviations, result.max_deviation))
    examples = load_examples(options.dataset, result, mask_run=options.mask_run, count=_EXAMPLES)
    write_png(out / "examples.png", draw_examples(examples))
    if options.json is not None:
        write_json(
            options.json,
            {
                "pictures": len(result.deviations),
                "rejected": int((~result.is_accepted).sum()),
                "rejection_rate": result.rejection_rate,
                "max_deviation": result.max_deviation,
                "imperfections": result.summarise_imperfections(),
            },
        )
    print(_format_summary(result, out))


def _format_summary(result: "FilterResult", out: Path) -> str:
    total, rejected = len(result.deviations), int((~result.is_accepted).sum())
    lines = [
        f"{total} pictures, {rejected} rejected ({result.rejection_rate:.1%}; the paper: 15 to 20 %): {out}"
    ]
    imperfections = result.summarise_imperfections()
    if set(imperfections) != {""}:
        for name, figures in imperfections.items():
            label = name or "painted faithfully"
            lines.append(f"  {label:20}{figures['count']:6}, rejected {figures['rejection_rate']:.1%}")
    return "\n".join(lines)


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("filter", __doc__)
    parser.add_argument("dataset", type=Path, metavar="DIR", help="folder of the repainted data set")
    add_filter_arguments(parser)
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="folder of the result (default: DIR with -filtered behind it)"
    )
    return parser


if __name__ == "__main__":
    run_command(main)
