"""Whether TensorFlow is installed: measuring with the shipped networks does without it."""

import importlib.util

from laesi_tf.common.errors import InputError


def require_tensorflow(what: str = "this command") -> None:
    """Raise InputError, which says how to install TensorFlow for `what`, if it is not installed."""
    try:
        is_installed = importlib.util.find_spec("tensorflow") is not None
    except ImportError:
        is_installed = False
    if not is_installed:
        raise InputError(
            f"{what} needs TensorFlow, which is not installed; run pip install 'laesi_tf[train]'"
        )
