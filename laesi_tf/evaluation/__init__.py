"""Scores of measurements and similarity of image sets."""
