"""One trial: its search space, budget, data, training and artifacts."""
