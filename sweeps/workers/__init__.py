"""Worker processes: start, supervise and stop them."""
