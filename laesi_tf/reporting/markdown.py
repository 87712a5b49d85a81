"""Tables in Markdown."""

from collections.abc import Sequence


def format_table(
    header: Sequence[str], rows: Sequence[Sequence[object]], *, align_right: bool = False
) -> list[str]:
    """Return the lines of a table; `align_right` aligns all columns but the first to the right."""
    alignment = ["---", *["---:" if align_right else "---"] * (len(header) - 1)]
    return [f"| {' | '.join(map(str, cells))} |" for cells in (header, alignment, *rows)]
