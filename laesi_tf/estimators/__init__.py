"""Ways to measure a photo, behind one protocol."""
