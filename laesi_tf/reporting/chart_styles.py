"""Colours and markers of charts: by Okabe and Ito, which the colour-blind distinguish as well; markers do in
grey."""

COLOURS = ("#000000", "#0072B2", "#E69F00", "#009E73", "#CC79A7", "#D55E00", "#56B4E9", "#999999")
MARKERS = ("o", "s", "^", "D", "v", "P", "X", "<", ">", "p", "*", "h")


def style_of(number: int) -> tuple[str, str]:
    """Return colour and marker of series `number`, from 0 on."""
    return COLOURS[number % len(COLOURS)], MARKERS[number % len(MARKERS)]
