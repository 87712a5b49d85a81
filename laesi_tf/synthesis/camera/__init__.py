"""The camera: pose and projection, lens blur, tone, noise and chroma."""
