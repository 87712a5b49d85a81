"""Import TensorFlow for a command, without the lines that it writes to stderr while it starts.

A command imports at its top only what parses arguments; `main` parses, calls `load_tensorflow` and then
imports the modules that need TensorFlow, so `--help` and wrong arguments answer at once.
"""

import contextlib
import logging
import os
import sys
from collections.abc import Iterator

from laesi_tf.common.tensorflow import require_tensorflow


def load_tensorflow(
    *,
    quick_compilation: bool = False,
    is_reproducible: bool = False,
    uses_gpu: bool = True,
    threads: int | None = None,
) -> None:
    """Import TensorFlow, let it look for GPUs, and hide all messages but errors.

    With `quick_compilation`, XLA optimises less: for a few images, compiling takes longer than rendering.
    With `is_reproducible`, oneDNN is not used: it changes the seventh digit of a scale from one process
    to the next, and now and then a number in a table. Without `uses_gpu`, GPUs are left to other libraries:
    TensorFlow would take all of their memory. With `threads`, it leaves other cores to other processes; it
    must not have run anything before. Raises InputError where it is not installed.
    """
    require_tensorflow()
    # Where TensorFlow is imported already, variables would only reach processes that start from here.
    if "tensorflow" not in sys.modules:
        if is_reproducible:
            os.environ.setdefault("TF_ENABLE_ONEDNN_OPTS", "0")
        if quick_compilation:
            os.environ.setdefault("XLA_FLAGS", "--xla_backend_optimization_level=0")
        os.environ.setdefault("TF_CPP_MIN_LOG_LEVEL", "2")
    # The level alone does not silence seven lines about oneDNN and CUDA, which C++ code writes to stderr.
    # Python code of TensorFlow warns on its own, as of graphs that are traced for a further size of photo.
    logging.getLogger("tensorflow").setLevel(logging.ERROR)
    with suppress_stderr():
        import tensorflow

        tensorflow.config.list_physical_devices()
        if not uses_gpu:
            tensorflow.config.set_visible_devices([], "GPU")
        if threads is not None:
            tensorflow.config.threading.set_intra_op_parallelism_threads(threads)
            tensorflow.config.threading.set_inter_op_parallelism_threads(threads)


@contextlib.contextmanager
def suppress_stderr() -> Iterator[None]:
    """Redirect file descriptor 2 to the null device inside this context; where it is closed, for good.

    A closed descriptor would be given to the next file that is opened, and messages would be written into
    that file.
    """
    try:
        saved = os.dup(2)
    except OSError:
        _redirect_to_null_device()
        yield
        return
    try:
        _redirect_to_null_device()
        yield
    finally:
        os.dup2(saved, 2)
        os.close(saved)


def _redirect_to_null_device() -> None:
    null_device = os.open(os.devnull, os.O_WRONLY)
    if null_device != 2:
        os.dup2(null_device, 2)
        os.close(null_device)
