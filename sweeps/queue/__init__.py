"""The queue of points: which trials remain, claims, retries and the storage behind them."""
