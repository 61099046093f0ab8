"""What is wrong with a request, in a sentence that is read inside Drake's exception."""

from __future__ import annotations

import re
from typing import Final

MAX_MESSAGE_BYTES: Final = 8000
"""Drake's client drops error bodies of 8192 bytes and more ("Server Message: None.")."""
_MAX_ECHO: Final = 120
"""Characters of a client's value that are repeated to it."""
_CONTROL: Final = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")
"""Control characters, line breaks other than \\n, and surrogates, which UTF-8 cannot carry."""


class RequestError(Exception):
    """The request cannot be answered with a picture, and the client is the one who can change that."""

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status
        """HTTP status: 400 bad request, 408 too slow, 413 too large."""
        self.sentence = sentence
        """Names the field or glTF element, and why."""


def quoted(value: str | bytes) -> str:
    """A client's value as it may be repeated in a message: quoted, control characters escaped, shortened."""
    text = value.decode("utf-8", "backslashreplace") if isinstance(value, bytes) else value
    return repr(text) if len(text) <= _MAX_ECHO else f"{text[:_MAX_ECHO]!r}… ({len(text)} characters)"


def message_bytes(sentence: str) -> bytes:
    """The sentence as the body of a text/plain answer: valid UTF-8, no control characters but newlines, short enough.

    pydrake raises UnicodeDecodeError in place of the message when the body is not UTF-8.
    """
    clean = _CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode("ascii"), sentence)
    body = clean.encode()
    if len(body) > MAX_MESSAGE_BYTES:
        body = body[: MAX_MESSAGE_BYTES - 4].decode("utf-8", "ignore").encode() + "…".encode()
    return body
