"""Units."""

MM_PER_INCH = 25.4
