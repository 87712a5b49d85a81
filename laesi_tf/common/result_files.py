"""Names of the files that `predict` writes into its folder, and the size of the overlays among them."""

TABLE_FILE = "areas.csv"
"""One row per leaf."""
JOURNAL_FILE = "areas.journal"
"""One line per photo: all that is needed to continue after an interruption, and to write the other files."""
PROVENANCE_FILE = "areas.provenance.json"
"""Software, models and settings of the measurements."""
PAGE_FILE = "report.html"
"""A summary for people."""
OVERLAY_SUFFIX = ".overlay.jpg"
"""End of the name of each photo's overlay: PNG takes six times the bytes and ten times as long."""
OVERLAY_SIDE_PX = 1600
"""Longer side of an overlay: leaf edges are visible, in a fifth of the bytes of a 12-megapixel photo."""


def is_result_file(name: str) -> bool:
    """Return whether a file of this name is one that `predict` writes, rather than a photo."""
    names = (TABLE_FILE, JOURNAL_FILE, PROVENANCE_FILE, PAGE_FILE)
    return name in names or name.endswith(OVERLAY_SUFFIX)
