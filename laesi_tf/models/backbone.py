"""MobileNetV3 (Howard et al., 2019) without its classifier, and where its weights come from.

Images are [B, H, W, 3] with values 0..255, uint8 or float; scaling to [-1, 1] is the network's first layer.
"""

import socket
import warnings
from pathlib import Path

import keras
import numpy as np

from laesi_tf.common.atomic_files import short_sha256
from laesi_tf.common.errors import InputError

# "Minimalistic" has no squeeze-excite, hard-swish or 5x5 kernels: another network with other weights.
BACKBONES = {
    "small": ("MobileNetV3Small", False),
    "large": ("MobileNetV3Large", False),
    "large_minimalistic": ("MobileNetV3Large", True),
}
FROM_SCRATCH = "none"
_DOWNLOAD_TIMEOUT_S = 30.0


def build_backbone(
    kind: str, *, size: tuple[int, int], alpha: float = 1.0, weights: str = "auto"
) -> tuple[keras.Model, str]:
    """The network to its last 1x1 convolution, [B, H, W, 3] -> [B, H/32, W/32, C], and the weights' origin.

    `size` is (height, width) in pixels, each at least 32 (sides are rounded up at each stride); `alpha`
    scales the number of channels. `weights` is "imagenet" (Keras's own ImageNet-1k file, downloaded once),
    "auto" (the same where it can be had, else from scratch with a warning), "none", or the path of a file
    saved with `save_weights` from this very network.
    Raises InputError for weights that cannot be had, read, or fitted.
    """
    if weights == "none":
        return _build_network(kind, size, alpha), FROM_SCRATCH
    if weights not in ("auto", "imagenet"):
        return load_weights_file(
            _build_network(kind, size, alpha), Path(weights), f"MobileNetV3 {kind} of width {alpha:g}"
        )
    try:
        return _build_network(kind, size, alpha, weights="imagenet"), "imagenet, Keras"
    except Exception as error:  # Keras wraps what the network throws in bare Exception
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
    """The last activation of `base` at `stride` 2, 4, 8 or 16: [B, ~H/stride, ~W/stride, C].

    It is the expansion that feeds the next strided depthwise convolution, where the MobileNetV3 paper too
    attaches its detection heads ("C4", section 6.3). Keras pads before each of those four convolutions.
    """
    padded = [layer.input for layer in base.layers if layer.name.endswith("depthwise_pad")]
    return padded[(2, 4, 8, 16).index(stride)]


def _build_network(kind: str, size: tuple[int, int], alpha: float, weights: str | None = None) -> keras.Model:
    constructor, minimalistic = BACKBONES[kind]
    patience = socket.getdefaulttimeout()
    socket.setdefaulttimeout(_DOWNLOAD_TIMEOUT_S)  # Keras sets none: a silent host would hang for ever
    try:
        with warnings.catch_warnings():
            # Weights are convolutional and fit any size; Keras warns for every size but 224.
            warnings.filterwarnings("ignore", message="`input_shape` is undefined")
            return getattr(keras.applications, constructor)(
                input_shape=(*size, 3),
                alpha=alpha,
                minimalistic=minimalistic,
                include_top=False,
                weights=weights,
            )
    finally:
        socket.setdefaulttimeout(patience)


def load_weights_file(base: keras.Model, path: Path, name: str) -> tuple[keras.Model, str]:
    """`base`, called `name` for people, with the weights in the file `path`, and their origin.

    Raises InputError for a file that is missing, broken, or of another network.
    """
    if not path.is_file():
        raise InputError(
            f"no weights file {path}; pass auto, imagenet, none or the path of a .weights.h5 file"
        )
    try:
        told = short_sha256(path)
        fitted = _load_all_variables(base, path)
    except Exception as error:  # whatever h5py, zipfile and Keras throw at a file that is not theirs
        raise InputError(_mismatch_message(path, name)) from error
    if not fitted:
        raise InputError(_mismatch_message(path, name))
    return base, f"file {path.name}, sha256 {told}"


def _load_all_variables(base: keras.Model, path: Path) -> bool:
    """Load `path` into `base`; true if every variable got finite values.

    Keras passes over layers that a file lacks and only warns, so all variables are NaN beforehand.
    """
    for variable in base.variables:
        variable.assign(np.full(variable.shape, np.nan, variable.dtype))
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        base.load_weights(path)
    return all(bool(np.isfinite(variable.numpy()).all()) for variable in base.variables)


def _mismatch_message(path: Path, name: str) -> str:
    return (
        f"{path} does not hold weights of {name} (include_top=False); save them with "
        "model.save_weights, or name the network and its --alpha that they belong to"
    )
