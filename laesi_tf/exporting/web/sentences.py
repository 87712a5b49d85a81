"""The sentences that the page shows: those of `predict`, from the same constants, without its flags."""

from typing import Any

from laesi_tf.estimators.graph.guidance_graph import Hint
from laesi_tf.estimators.leaf_outline import CUT_OFF, TOUCHED
from laesi_tf.estimators.mask_estimator import NO_LEAF
from laesi_tf.estimators.ruling.codes import Refusal
from laesi_tf.estimators.ruling.judge import NOTES, SENTENCES
from laesi_tf.estimators.ruling_estimator import MOSTLY_UNCOUNTED, NO_LEAF_ON_SHEET, OFF_SHEET, UNCOUNTED
from laesi_tf.reporting.leaf_records import COLUMNS

HINTS = {
    Hint.READY: "Good: take the photo",
    Hint.TOO_DARK: "Too dark: go where there is more light",
    Hint.NO_RULING: "No ruling seen: show bare millimetre paper around the leaf",
    Hint.BLURRED: "Blurred: hold the phone still and let it focus",
    Hint.MOVE_CLOSER: "Move closer: the millimetres are too small",
    Hint.TOO_TILTED: "Too tilted: hold the phone parallel to the paper",
    Hint.NO_LEAF: "No leaf seen: lay one on the paper",
    Hint.LEAF_CUT_OFF: "The leaf is cut off: show all of it",
    Hint.LEAF_OFF_PAPER: "The leaf is not on the paper: lay it on the ruling",
    Hint.SHADOW: "Shadow on the paper: turn so that the phone throws none",
}
"""What the page says while the user aims."""
_FIELD = "“Line distance”"
"""Name of the page's field."""
_FLAGS = {
    "--grid-mm (column grid_mm of a manifest)": _FIELD,
    "(--grid-mm ": f"({_FIELD} ",
    "with --grid-mm": f"under {_FIELD}",
}
"""How the page says what the sentence says with a flag."""
MAX_MEGAPIXELS = 80
"""Of a picture: decoded, it takes four bytes a pixel in a browser's tab."""


def collect_sentences() -> dict[str, Any]:
    """Return what the page shows, by place; refusals and notes by their code in the graph's outputs."""
    refusals = {
        Refusal.NO_LEAF: NO_LEAF,
        Refusal.NO_LEAF_ON_SHEET: NO_LEAF_ON_SHEET,
        Refusal.MOSTLY_UNCOUNTED: MOSTLY_UNCOUNTED,
        **SENTENCES,
    }
    return {
        "refusals": {str(int(code)): replace_flags(text) for code, text in refusals.items()},
        "of_ruling": [int(code) for code in SENTENCES],
        "notes": {str(int(code)): replace_flags(text) for code, text in NOTES.items()},
        "no_leaf": NO_LEAF,
        "off_sheet": OFF_SHEET,
        "uncounted": UNCOUNTED,
        "cut_off": CUT_OFF,
        "touched": TOUCHED,
        "hints": {str(int(code)): text for code, text in HINTS.items()},
        "columns": COLUMNS,
        "limits": {"max_megapixels": MAX_MEGAPIXELS},
    }


def replace_flags(sentence: str) -> str:
    """Return `sentence` with the page's field in place of the command's flag."""
    for flag, field in _FLAGS.items():
        sentence = sentence.replace(flag, field)
    return sentence
