"""Samples for training: rendered scenes, generated data sets and photos, as tf.data pipelines."""
