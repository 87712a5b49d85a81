"""The paper's six experiments and their table: the same networks trained on six data sets.

configs/ has one file for each row of the table, recipe.toml what all rows share. `python -m experiments.run`
trains and measures, `python -m experiments.table` writes the table and the error against the number of
synthetic images. Both run from a clone of the repository.
"""
