"""Queues of trials that workers share, stored with Optuna."""
