"""The error that stands for bad input."""


class InputError(ValueError):
    """Bad input: the message is one line that says what, where, and what to do instead.

    Commands print it and exit with status 2; every other exception is a fault of ours and keeps its
    traceback.
    """
