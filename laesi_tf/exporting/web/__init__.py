"""The page that measures leaves in a browser: its files, and what writes and shows them."""
