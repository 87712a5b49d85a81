"""The paper's six experiments and its table: the same networks trained on six data sets.

configs/ holds a file for each row of the table, recipe.toml what all rows share. `python -m experiments.run`
trains and measures, `python -m experiments.table` writes the table and the error against the data's size.
"""
