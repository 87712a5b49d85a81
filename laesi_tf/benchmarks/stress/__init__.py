"""Stability: one nuisance at a time from none to absurd, everything else fixed, for every method."""
