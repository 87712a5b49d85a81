"""Text for terminals and captions."""


def sanitise_text(text: object) -> str:
    """`text` with control characters and undecodable bytes replaced, fit for a terminal or a caption."""
    return "".join(letter if letter.isprintable() else "\N{REPLACEMENT CHARACTER}" for letter in str(text))
