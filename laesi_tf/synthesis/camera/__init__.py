"""The camera: pose, projection and distortion, lens blur, tone, noise and chroma."""
