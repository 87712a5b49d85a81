"""Networks, Keras in and Keras out: [B, H, W, 3] with values 0..255 in, one tensor per task out."""
