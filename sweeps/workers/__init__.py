"""Worker processes: start, supervise and stop them; the objective that they run."""
