"""Turn the ruling network's answers into a calibrated camera: votes, local spectra, one fit of the sheet."""
