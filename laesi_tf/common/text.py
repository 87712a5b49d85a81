"""Text and numbers for terminals, captions and tables."""

_DIGITS = 5
"""Significant digits of a measured number: more than any camera resolves."""


def sanitise_text(text: object) -> str:
    """Return `text` with control characters and undecodable bytes replaced, for terminals and captions."""
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in str(text))


def round_for_table(value: float | None, digits: int = _DIGITS) -> float | None:
    """Return `value` with so many significant digits, by default five; None stays None."""
    return None if value is None else float(f"{value:.{digits}g}")


def format_ordinal(number: int) -> str:
    """Return "1st", "2nd", "3rd", "4th" and so on."""
    ending = "th" if number % 100 in (11, 12, 13) else {1: "st", 2: "nd", 3: "rd"}.get(number % 10, "th")
    return f"{number}{ending}"
