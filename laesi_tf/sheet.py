"""Write millimetre paper to print, for those who have none, as a PDF.

Print it at 100 % and check the bar of 100 mm with a ruler; if the printer shrinks it to 97 mm, measure with
--grid-mm 0.97.
"""

from collections.abc import Sequence
from pathlib import Path

from laesi_tf.cli.arguments import make_parser
from laesi_tf.cli.console import run_command
from laesi_tf.common.atomic_files import require_writable, write_bytes
from laesi_tf.common.errors import InputError

_PAPERS = ("a4", "letter")
_SUFFIX = ".pdf"


def main(arguments: Sequence[str]) -> None:
    """Run the command. Raises InputError for a file that cannot be written."""
    parser = make_parser("sheet", __doc__, has_json=False)
    parser.add_argument(
        "--out", type=Path, default=Path("sheet.pdf"), metavar="FILE.pdf", help="file to write"
    )
    parser.add_argument("--paper", choices=_PAPERS, default="a4", help="size of the paper")
    options = parser.parse_args(arguments)
    if options.out.suffix.lower() != _SUFFIX:
        raise InputError(f"{options.out} is no name of a PDF; end it in {_SUFFIX}")
    require_writable(options.out)
    try:
        from laesi_tf.exporting.printed_sheet import PAPERS, draw_sheet
    except ImportError:
        raise InputError(
            "a sheet is drawn by Matplotlib, which is not installed; run pip install 'laesi_tf[train]'"
        ) from None

    write_bytes(options.out, draw_sheet(PAPERS[options.paper]))
    print(f"written: {options.out}; print it at 100 % and check the bar of 100 mm with a ruler")


if __name__ == "__main__":
    run_command(main)
