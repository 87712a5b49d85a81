"""The search over 1,425 ways to train: the points, the workers that try them, and the analysis.

Runs from a clone of the repository: `python -m sweeps.run`, `sweeps.dashboard`, `sweeps.analysis`,
`sweeps.grid` and `sweeps.benchmark`.
"""
