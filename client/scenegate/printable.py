"""Text of files, messages and clients as a terminal may show it, and as UTF-8 can encode it."""


def printable(text: str) -> str:
    """Return text with control characters, line breaks and other invisible characters as backslash escapes.

    A terminal does not act on them then, and a name cannot begin a line of its own.
    """
    return text if text.isprintable() else "".join(c if c.isprintable() else repr(c)[1:-1] for c in text)


def encodable(text: str) -> str:
    """Return text with ``?`` in place of lone surrogates, which file names and JSON strings may contain."""
    return text.encode("utf-8", "replace").decode()
