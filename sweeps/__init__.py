"""The search over 1,425 ways to train: the grid, the workers that go through it, and what was found."""
