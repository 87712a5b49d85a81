"""The sheet: its ruling, colour, noise and edge, and the desk around it."""
