"""Compromises between speed and accuracy, by name."""

PRESETS: dict[str, int | None] = {"fast": 640, "balanced": 1024, "accurate": None}
"""Longer side to which photos are shrunk before they are measured; None for all pixels."""
