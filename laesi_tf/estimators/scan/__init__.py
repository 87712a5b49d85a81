"""Leaves on a plain background, as on a flatbed scanner, at a known scale."""
