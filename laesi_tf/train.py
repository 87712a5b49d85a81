"""Train a network on live synthetic scenes: to measure leaf area (--task area), outline leaves (mask) or read
the ruling of the paper (ruling).

A flag wins over the same key in --config. Run the same command again to continue a run that was stopped.
--weights RUN starts from the network of another run.
"""

import argparse
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.cli.tensorflow_setup import load_tensorflow
from laesi_tf.common.atomic_files import write_json
from laesi_tf.common.run_files import REPORT_FILE
from laesi_tf.common.schema import add_option_arguments
from laesi_tf.training.config import STRATEGIES, TrainConfig
from laesi_tf.training.config_files import config_from_dict, load_config
from laesi_tf.training.tasks import TASKS


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError."""
    given = vars(_make_parser().parse_args(arguments))
    path, out, json_path, strategy = (given.pop(name) for name in ("config", "out", "json", "strategy"))
    feeding = {name: given.pop(name) for name in ("data_service", "synthesis_device")}
    config = load_config(path, **given) if path else config_from_dict(given)
    load_tensorflow()
    from laesi_tf.training.follower import follow
    from laesi_tf.training.loop import fit, notify
    from laesi_tf.training.replicas import start_replicas

    replicas = start_replicas(strategy, config, notify)
    if not replicas.is_chief:
        steps = follow(config, replicas, **feeding)
        print(f"{steps} steps on {replicas.part.size(config.batch_size)} images each; the chief has the run")
        return
    result = fit(config, out or Path("runs") / config.task, replicas=replicas, **feeding)
    print(_format_summary(result.metrics, config, result.path))
    if json_path:
        write_json(json_path, result.metrics)


def _make_parser() -> argparse.ArgumentParser:
    parser = make_parser("train", __doc__)
    parser.add_argument(
        "--config", type=Path, metavar="FILE", help="TOML file of the keys below, with underscores"
    )
    parser.add_argument("--out", type=Path, metavar="RUN", help="the run directory (default: runs/TASK)")
    parser.add_argument(
        "--data-service",
        default="",
        metavar="HOST:PORT",
        help="render scenes on other machines with the laesi_tf.serve that listens there",
    )
    parser.add_argument(
        "--synthesis-device",
        default="auto",
        metavar="auto|cpu|DEVICE",
        help="what renders live scenes: auto is the accelerator where there is one, cpu the processor's "
        "cores; or a device's name, such as GPU:1",
    )
    parser.add_argument(
        "--strategy",
        choices=STRATEGIES,
        default=STRATEGIES[0],
        help="divide each batch among all GPUs of this machine (mirrored) or of all machines that TF_CONFIG "
        "lists (multi-worker), with the result of one device (default: none)",
    )
    add_option_arguments(parser, TrainConfig)
    return parser


def _format_summary(metrics: Mapping[str, Any], config: TrainConfig, path: Path) -> str:
    images_per_s = metrics["images_per_s"] or float("nan")
    return "\n".join(
        [
            f"{config.task}, {_name_network(config)}, from {metrics['weights_origin']}",
            f"{TASKS[config.task](config).summary(metrics)} on {metrics['n']} validation images, "
            f"best at step {metrics['best_step']} of {metrics['steps']}",
            f"{metrics['minutes']:.1f} minutes at {images_per_s:.0f} images/s",
            f"network and report: {path / REPORT_FILE}",
        ]
    )


def _name_network(config: TrainConfig) -> str:
    return f"MobileNetV3 {config.backbone}" if TASKS[config.task].has_backbone else "fully convolutional"


if __name__ == "__main__":
    run_command(main)
