"""Export a training run as a small folder for use elsewhere: float16 weights, configuration and metrics.

The exported model is loaded again, and both are evaluated on fresh scenes.
"""

import argparse
from collections.abc import Sequence
from pathlib import Path

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.tensorflow_setup import load_tensorflow
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.run_files import CONFIG_FILE, EXPORTED_WEIGHTS_FILE


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError for a run that is missing or a folder that cannot be written."""
    options = _make_parser().parse_args(arguments)
    require_writable(options.out / CONFIG_FILE)
    load_tensorflow()
    from laesi_tf.exporting.float16 import compute_test_metrics, export_float16
    from laesi_tf.models.saved_model import load_run

    original = load_run(options.run)
    export_float16(original, options.out)
    metrics = {
        "original": compute_test_metrics(original),
        "exported": compute_test_metrics(load_run(options.out)),
    }
    size = (options.out / EXPORTED_WEIGHTS_FILE).stat().st_size
    for name, values in metrics.items():
        print(f"{name}: " + ", ".join(f"{key} {value:.4g}" for key, value in values.items()))
    print(f"exported: {options.out}, weights {size / 1e6:.1f} MB")
    if options.json is not None:
        write_json(options.json, {**metrics, "bytes": size})


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("export", __doc__)
    parser.add_argument("run", type=Path, metavar="RUN", help="run directory that train wrote")
    parser.add_argument("--out", type=Path, required=True, metavar="DIR", help="folder to write")
    return parser


if __name__ == "__main__":
    run_command(main)
