"""What every other package may use: no TensorFlow, nothing of the package, no side effects."""
