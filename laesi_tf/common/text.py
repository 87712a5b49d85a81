"""Clean text for terminals and captions."""


def sanitise_text(text: object) -> str:
    """Return `text` with control characters and undecodable bytes replaced, for terminals and captions."""
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in str(text))
