"""Measure speed and memory on this machine. Each benchmark has its own --help.

Machines drift: what is compared is measured in turns, several times, and reported as a median with its
interquartile range. A difference smaller than its range is noise.
"""

from collections.abc import Callable, Sequence

from laesi_tf.benchmarks import photo_speed, synthesis_speed
from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command

BENCHMARKS: dict[str, Callable[[Sequence[str]], None]] = {
    "synthesis": synthesis_speed.main,
    "photo": photo_speed.main,
}


def main(arguments: Sequence[str]) -> None:
    """Hand over to the benchmark that the first argument names."""
    chooser = make_parser("benchmark", __doc__)
    chooser.add_argument("what", choices=tuple(BENCHMARKS), help="what to measure")
    BENCHMARKS[chooser.parse_args(arguments[:1]).what](arguments[1:])


if __name__ == "__main__":
    run_command(main)
