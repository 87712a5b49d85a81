"""MobileNetV3 (Howard et al., 2019) without its classifier, and the origin of its weights.

Images are [B, H, W, 3] with values 0..255, uint8 or float; scaling to [-1, 1] is the network's first layer.
"""

import contextlib
import socket
import warnings
from collections.abc import Iterator
from pathlib import Path

import keras

from laesi_tf.common.atomic_files import short_sha256
from laesi_tf.common.errors import InputError
from laesi_tf.models.weights_file import load_weights

# Name -> (constructor, minimalistic). "Minimalistic" has no squeeze-excite, hard-swish or 5x5 kernels: it is
# another network with other weights.
BACKBONES = {
    "small": ("MobileNetV3Small", False),
    "large": ("MobileNetV3Large", False),
    "large_minimalistic": ("MobileNetV3Large", True),
}
FROM_SCRATCH = "none"
_DOWNLOAD_TIMEOUT_S = 30.0


@contextlib.contextmanager
def compute_in(precision: str) -> Iterator[None]:
    """Build layers inside this context that compute in a Keras dtype policy, such as mixed_float16."""
    before = keras.config.dtype_policy()
    keras.config.set_dtype_policy(precision)
    try:
        yield
    finally:
        keras.config.set_dtype_policy(before)


def build_backbone(
    kind: str, *, size: tuple[int, int], alpha: float = 1.0, weights: str = "auto"
) -> tuple[keras.Model, str]:
    """Build the network up to its last 1x1 convolution; return it and the origin of its weights.

    The network maps [B, H, W, 3] to [B, H/32, W/32, C], sides rounded up at each stride. `kind` is a key of
    BACKBONES, `size` (height, width) in pixels, each at least 32, and `alpha` a factor on the number of
    channels. `weights` is "imagenet" (Keras's own ImageNet-1k file, downloaded once), "auto" (the same if it
    is available, else random weights and a warning), "none" (random weights), or the path of a file that
    `save_weights` wrote from the same network. Raises InputError for weights that are not available, not
    readable, or of another network.
    """
    if weights == FROM_SCRATCH:
        return _build_network(kind, size, alpha), FROM_SCRATCH
    if weights not in ("auto", "imagenet"):
        base = _build_network(kind, size, alpha)
        return base, load_weights_file(base, Path(weights), f"MobileNetV3 {kind} of width {alpha:g}")
    try:
        return _build_network(kind, size, alpha, weights="imagenet"), "imagenet, Keras"
    except Exception as error:  # Keras wraps network errors in a bare Exception
        reason = str(error).split("\n")[0].removeprefix("URL fetch failure on ")
        if weights == "imagenet":
            raise InputError(
                f"no ImageNet weights for {kind} of width {alpha:g} ({reason}); "
                "pass --weights PATH of a file you have, or --weights none"
            ) from error
        warnings.warn(
            f"no ImageNet weights for {kind} of width {alpha:g} ({reason}): training from scratch, "
            "which takes several times as many steps; --weights PATH starts from a file you have",
            stacklevel=2,
        )
        return _build_network(kind, size, alpha), FROM_SCRATCH


def features_at_stride(base: keras.Model, stride: int) -> keras.KerasTensor:
    """Return the last activation of `base` at `stride` 2, 4, 8 or 16: [B, ~H/stride, ~W/stride, C].

    It is the expansion that feeds the next strided depthwise convolution, where the MobileNetV3 paper also
    attaches its detection heads ("C4", section 6.3). Keras pads before each of these four convolutions.
    """
    padded = [layer.input for layer in base.layers if layer.name.endswith("depthwise_pad")]
    return padded[(2, 4, 8, 16).index(stride)]


def load_weights_file(network: keras.Model, path: Path, name: str) -> str:
    """Load the weights in `path`, saved with `save_weights`, into `network`; return their origin.

    `name` is what a user calls the network. Raises InputError for a file that is missing, broken, or of
    another network.
    """
    if not path.is_file():
        raise InputError(
            f"no weights file {path}; pass auto, imagenet, none or the path of a .weights.h5 file"
        )
    try:
        load_weights(network, path)
    except InputError as error:
        raise InputError(
            f"{path} does not hold weights of {name} (include_top=False); save them with "
            "model.save_weights, or name the network and its --alpha that they belong to"
        ) from error
    return f"file {path.name}, sha256 {short_sha256(path)}"


def _build_network(kind: str, size: tuple[int, int], alpha: float, weights: str | None = None) -> keras.Model:
    constructor, is_minimalistic = BACKBONES[kind]
    with _download_timeout(), warnings.catch_warnings():
        # Weights are convolutional and fit any size; Keras warns for every size but 224.
        warnings.filterwarnings("ignore", message="`input_shape` is undefined")
        return getattr(keras.applications, constructor)(
            input_shape=(*size, 3),
            alpha=alpha,
            minimalistic=is_minimalistic,
            include_top=False,
            weights=weights,
        )


@contextlib.contextmanager
def _download_timeout() -> Iterator[None]:
    """Limit how long a download waits for a silent server: Keras sets no limit of its own."""
    before = socket.getdefaulttimeout()
    socket.setdefaulttimeout(_DOWNLOAD_TIMEOUT_S)
    try:
        yield
    finally:
        socket.setdefaulttimeout(before)
