"""Export a training run as a small folder for use elsewhere: float16 weights, configuration and figures.

The exported model is loaded again and compared with the run on fresh scenes before it counts as exported.
"""

from collections.abc import Sequence
from pathlib import Path

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import write_json
from laesi_tf.common.run_files import EXPORTED_WEIGHTS_FILE
from laesi_tf.exporting.float16 import compute_test_metrics, export_float16
from laesi_tf.models.saved_model import load_run


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError for a run that is not there or a folder that cannot be written."""
    command = make_parser("export", __doc__)
    command.add_argument("run", type=Path, metavar="RUN", help="folder that train wrote")
    command.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    options = command.parse_args(arguments)
    original = load_run(options.run)
    export_float16(original, options.out)
    figures = {
        "original": compute_test_metrics(original),
        "exported": compute_test_metrics(load_run(options.out)),
        "bytes": (options.out / EXPORTED_WEIGHTS_FILE).stat().st_size,
    }
    for name in ("original", "exported"):
        print(f"{name}: " + ", ".join(f"{key} {value:.4g}" for key, value in figures[name].items()))
    print(f"written: {options.out}, weights {figures['bytes'] / 1e6:.1f} MB")
    if options.json is not None:
        write_json(options.json, figures)


if __name__ == "__main__":
    run_command(main)
