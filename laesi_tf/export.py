"""Export a training run as a small folder for use elsewhere: float16 weights, configuration and figures.

The exported model is loaded again and compared with the run on fresh scenes before it counts as exported.
"""

from collections.abc import Sequence
from pathlib import Path

from laesi_tf.cli import parser, run
from laesi_tf.exporting.float16 import compute_test_metrics
from laesi_tf.files import write_json
from laesi_tf.runs import EXPORTED, export, load_run


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError for a run that is not there or a folder that cannot be written."""
    command = parser("export", __doc__)
    command.add_argument("run", type=Path, metavar="RUN", help="folder that train wrote")
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    options = command.parse_args(arguments)
    original = load_run(options.run)
    export(original, options.out)
    figures = {
        "original": compute_test_metrics(original),
        "exported": compute_test_metrics(load_run(options.out)),
        "bytes": (options.out / EXPORTED).stat().st_size,
    }
    for name in ("original", "exported"):
        print(f"{name}: " + ", ".join(f"{key} {value:.4g}" for key, value in figures[name].items()))
    print(f"written: {options.out}, weights {figures['bytes'] / 1e6:.1f} MB")
    if options.json is not None:
        write_json(options.json, figures)


if __name__ == "__main__":
    run(main)
