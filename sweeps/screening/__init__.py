"""The choice of the screening: which short budget ranks points as long trials do."""
