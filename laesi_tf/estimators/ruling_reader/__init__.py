"""The reader of rulings in spectra of patches."""
