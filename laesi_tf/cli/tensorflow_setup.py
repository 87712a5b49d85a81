"""Import TensorFlow without the lines that it writes to stderr."""

import contextlib
import os
from collections.abc import Iterator


@contextlib.contextmanager
def suppress_stderr() -> Iterator[None]:
    """Send file descriptor 2 to nowhere for the duration."""
    kept = os.dup(2)
    nowhere = os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(kept, 2)
        os.close(nowhere)
        os.close(kept)


# While it is imported and looks for GPUs TensorFlow writes seven lines about oneDNN and CUDA to stderr
# whatever its log level; after that the level keeps it to warnings.
os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "2")
with suppress_stderr():
    import tensorflow

    tensorflow.config.list_physical_devices()
