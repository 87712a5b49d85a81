"""Repaint the leaves of synthetic images, and drop those that no longer fit their masks."""
