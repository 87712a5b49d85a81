"""Train MobileNetV3 on live synthetic scenes: to measure leaf area (--task area) or outline leaves (mask).

A flag wins over the same key in --config. Run the same command again to continue a run that was stopped.
"""

from collections.abc import Sequence
from pathlib import Path

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import require_writable, write_json
from laesi_tf.common.run_files import REPORT_FILE
from laesi_tf.training.config import TrainConfig
from laesi_tf.training.config_files import add_config_arguments, config_from_dict, load_config
from laesi_tf.training.loop import TrainingResult, fit


def main(arguments: Sequence[str]) -> None:
    """Parse, train, tell."""
    command = make_parser("train", __doc__)
    command.add_argument(
        "--config", type=Path, metavar="FILE", help="TOML file of the keys below, underscored"
    )
    command.add_argument("--out", type=Path, metavar="RUN", help="the run's folder (default: runs/TASK)")
    command.add_argument(
        "--data-service", default="", metavar="HOST:PORT", help="have scenes made by laesi_tf.serve there"
    )
    add_config_arguments(command)
    given = vars(command.parse_args(arguments))
    path, out, figures, service = (given.pop(name) for name in ("config", "out", "json", "data_service"))
    config = load_config(path, **given) if path else config_from_dict(given)
    if figures:
        require_writable(figures)
    result = fit(config, out or Path("runs") / config.task, data_service=service)
    print(_summary(result, config))
    if figures:
        write_json(figures, result.metrics)


def _summary(result: TrainingResult, config: TrainConfig) -> str:
    told = result.metrics
    score = (
        f"MRE {told['mre']:.2f} %, median {told['median']:.2f} %, 90th percentile {told['p90']:.2f} %"
        if config.task == "area"
        else f"mIoU {told['miou']:.4f}, MPE {told['mpe']:.4f}"
    )
    return "\n".join(
        [
            f"{config.task}, MobileNetV3 {config.backbone}, from {told['weights_origin']}",
            f"{score} on {told['n']} fresh scenes, best at step {told['best_step']} of {told['steps']}",
            f"{told['minutes']:.1f} minutes at {told['images_per_s'] or float('nan'):.0f} images/s",
            f"model and report: {result.path / REPORT_FILE}",
        ]
    )


if __name__ == "__main__":
    run_command(main)
