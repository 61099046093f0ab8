"""Errors of render requests. Each message is one sentence, which Drake's client shows in its exception."""

import re
from typing import Final

MAX_MESSAGE_BYTES: Final = 8000
"""Maximum size of an error body. Drake's client drops bodies of 8192 bytes and more ("Server Message: None.")."""
_MAX_ECHO: Final = 120
"""Maximum number of characters of a client's value in an error message."""
_CONTROL: Final = re.compile("[\x00-\x09\x0b-\x1f\x7f-\x9f\u2028\u2029\ud800-\udfff]")
"""Control characters, line breaks other than \\n, and surrogates, which UTF-8 cannot encode."""


class RequestError(Exception):
    """The request cannot be served as it is: its content is invalid, too large, or incomplete."""

    def __init__(self, status: int, sentence: str) -> None:
        super().__init__(sentence)
        self.status = status
        """HTTP status: 400 (bad request), 408 (upload stalled), 413 (body too large) or 415 (compressed)."""
        self.sentence = sentence
        """Error message, which names the field or glTF element and the reason."""


def quoted(value: str | bytes) -> str:
    """Return a client's value for an error message: quoted, control characters escaped, shortened."""
    text = value.decode("utf-8", "backslashreplace") if isinstance(value, bytes) else value
    return repr(text) if len(text) <= _MAX_ECHO else f"{text[:_MAX_ECHO]!r}… ({len(text)} characters)"


def message_bytes(sentence: str) -> bytes:
    """Return a sentence as the body of a text/plain response, at most ``MAX_MESSAGE_BYTES`` long.

    Control characters except newlines are escaped. The body is valid UTF-8, because pydrake raises UnicodeDecodeError
    instead of showing any other message.
    """
    clean = _CONTROL.sub(lambda match: match[0].encode("unicode_escape").decode("ascii"), sentence)
    body = clean.encode()
    if len(body) > MAX_MESSAGE_BYTES:
        body = body[: MAX_MESSAGE_BYTES - 4].decode("utf-8", "ignore").encode() + "…".encode()
    return body
