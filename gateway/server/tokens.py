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
COOKIE_SECONDS: Final = 7 * 24 * 3600
"""Age at which a browser's cookie is refused, and the token is asked for again: a week."""
_FILE_BYTES: Final = 64 << 10


class TokenError(ValueError):
    """A token file cannot be used; one sentence, without any token in it."""


class Tokens:
    """Those that are accepted; several, so that they can be changed without a gap."""

    __slots__ = ("_tokens",)

    def __init__(self, *tokens: str) -> None:
        self._tokens = tuple(token.encode() for token in tokens)

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

    @staticmethod
    def cookie(token: str, now: float) -> str:
        """The cookie that a browser is given instead of ``token``: the time at which it ends, signed with the token.

        It ends with its token, when that is taken out of the file, or after ``COOKIE_SECONDS``.

        Args:
            now: seconds since 1970.
        """
        end = str(int(now) + COOKIE_SECONDS)
        return f"{end}.{_signature(token.encode(), end)}"

    def accept_cookie(self, value: str, now: float) -> bool:
        """Return whether a cookie belongs to one of the tokens and has not expired at ``now`` (Unix time, seconds)."""
        end, _, signature = value.partition(".")
        if len(value) > MOST_CHARS or not (end.isascii() and end.isdecimal()) or int(end) <= now:
            return False
        sent = signature.encode("utf-8", "replace")
        return sum([hmac.compare_digest(_signature(token, end).encode(), sent) for token in self._tokens]) > 0


def _signature(token: bytes, end: str) -> str:
    return hmac.digest(token, f"scenegate cookie until {end}".encode(), hashlib.sha256).hex()


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
