"""Load a file of weights into a network that the caller has built.

Only numbers are read: a file that somebody else wrote cannot make a layer or run code.
"""

import warnings
from pathlib import Path

import keras
import numpy as np

from laesi_tf.common.errors import InputError


def load_weights(network: keras.Model, path: Path) -> None:
    """Set every variable of `network` to the value in `path`, a `.weights.h5` or `.keras` file.

    The architecture that a `.keras` file stores beside its weights is ignored. Raises InputError for a file
    that is missing, broken, or of another network.
    """
    if not path.is_file():
        raise InputError(f"file not found: {path}")
    # Keras skips layers that the file lacks and only warns, so mark every variable as missing first.
    for variable in network.variables:
        variable.assign(np.full(variable.shape, np.nan, variable.dtype))
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            network.load_weights(path)
    except Exception as error:  # h5py, zipfile and Keras each raise their own
        raise InputError(f"{path} does not hold the weights of this network") from error
    if not all(np.isfinite(variable.numpy()).all() for variable in network.variables):
        raise InputError(f"{path} does not hold all weights of this network")
