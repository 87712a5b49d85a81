"""Measure the photos of a folder: in threads, with results that survive an interruption."""
