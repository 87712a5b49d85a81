"""Training: configuration, tasks, the one loop and its run directory."""
