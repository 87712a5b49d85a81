"""The whole measurement as one TensorFlow graph of static shapes, which LiteRT can run."""
