"""Bearer tokens: read from a file, compared in constant time, never shown."""

from __future__ import annotations

import hashlib
import hmac
from pathlib import Path
from typing import Final

LEAST_CHARS: Final = 16
"""Shorter ones can be guessed; ``openssl rand -hex 32`` makes one of 64."""
MOST_CHARS: Final = 1024
"""Of what a client sends; longer ones are wrong without a look."""
_FILE_BYTES: Final = 64 << 10


class TokenError(ValueError):
    """A token file cannot be used; one sentence, without any token in it."""


class Tokens:
    """Those that are accepted; several, so that they can be changed without a gap."""

    __slots__ = ("_tokens", "cookie")

    def __init__(self, *tokens: str) -> None:
        self._tokens = tuple(token.encode() for token in tokens)
        self.cookie = hmac.digest(self._tokens[0], b"scenegate cookie", hashlib.sha256).hex()
        """What a browser is given instead of the token: made from it, good for this gateway alone."""

    def __repr__(self) -> str:
        return f"<{len(self._tokens)} tokens>"

    def accept(self, sent: str) -> bool:
        """Whether it is one of them; takes the same time for every wrong one."""
        if len(sent) > MOST_CHARS:
            return False
        data = sent.encode("utf-8", "surrogateescape")
        return sum([hmac.compare_digest(token, data) for token in self._tokens]) > 0

    def accept_header(self, value: str) -> bool:
        """``Authorization: Bearer <token>`` (RFC 6750)."""
        scheme, _, token = value.partition(" ")
        return scheme.lower() == "bearer" and self.accept(token.strip())

    def accept_cookie(self, value: str) -> bool:
        """The value of the cookie."""
        return len(value) <= MOST_CHARS and hmac.compare_digest(self.cookie.encode(), value.encode("utf-8", "replace"))


def read_tokens(path: Path) -> Tokens:
    """One token a line; empty lines and those that begin with ``#`` do not count.

    Raises:
        TokenError: there is no token, or one that is too short or has characters that no header can carry.
    """
    try:
        with path.open("rb") as file:
            data = file.read(_FILE_BYTES)
        lines = [line.strip() for line in data.decode("ascii").splitlines()]
    except OSError as error:
        raise TokenError(f"The token file {path} cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise TokenError(f"The token file {path} has characters that are not ASCII.") from None
    tokens = [line for line in lines if line and not line.startswith("#")]
    if not tokens:
        raise TokenError(f"The token file {path} has no token.")
    for number, token in enumerate(tokens, 1):
        if len(token) < LEAST_CHARS or len(token) > MOST_CHARS or not token.isprintable() or " " in token:
            raise TokenError(
                f"Token {number} of the token file {path} must have {LEAST_CHARS} to {MOST_CHARS} characters and no "
                "spaces; 'openssl rand -hex 32' makes one."
            )
    return Tokens(*tokens)
