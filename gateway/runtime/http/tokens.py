"""Bearer tokens: read from a file, compared in constant time, never logged."""

import hashlib
import hmac
from pathlib import Path
from typing import Final

from scenegate.regular_files import read_regular

MIN_CHARS: Final = 16
"""Minimum length of a token; ``openssl rand -hex 32`` makes one of 64."""
MAX_CHARS: Final = 1024
"""Maximum length of a token; longer ones from clients are rejected without a comparison."""
COOKIE_SECONDS: Final = 7 * 24 * 3600
"""Lifetime of a browser's cookie: a week."""
_MAX_FILE_BYTES: Final = 64 << 10


class TokenError(ValueError):
    """A token file cannot be used; the message is one sentence without a token."""


class Tokens:
    """Accepted tokens; several, so that they can be replaced without an interruption."""

    __slots__ = ("_tokens",)

    def __init__(self, *tokens: str) -> None:
        self._tokens = tuple(token.encode() for token in tokens)

    def __repr__(self) -> str:
        return f"<{len(self._tokens)} tokens>"

    def accept(self, sent: str) -> bool:
        """Return whether ``sent`` is one of the tokens, in constant time."""
        if len(sent) > MAX_CHARS:
            return False
        data = sent.encode("utf-8", "surrogateescape")
        return sum([hmac.compare_digest(token, data) for token in self._tokens]) > 0

    def accept_header(self, value: str) -> bool:
        """Return whether an Authorization header has one of the tokens (``Bearer <token>``, RFC 6750)."""
        scheme, _, token = value.partition(" ")
        return scheme.lower() == "bearer" and self.accept(token.strip())

    @staticmethod
    def cookie(token: str, now: float) -> str:
        """Return the cookie for a browser that sent ``token``: its expiry time, signed with the token.

        It is valid for ``COOKIE_SECONDS``, or until its token is removed from the file.

        Args:
            now: Unix time, seconds.
        """
        expiry = str(int(now) + COOKIE_SECONDS)
        return f"{expiry}.{_signature(token.encode(), expiry)}"

    def accept_cookie(self, value: str, now: float) -> bool:
        """Return whether a cookie belongs to one of the tokens and has not expired at ``now`` (Unix time, seconds)."""
        expiry, _, signature = value.partition(".")
        if len(value) > MAX_CHARS or not (expiry.isascii() and expiry.isdecimal()) or int(expiry) <= now:
            return False
        received = signature.encode("utf-8", "replace")
        return sum([hmac.compare_digest(_signature(token, expiry).encode(), received) for token in self._tokens]) > 0


def _signature(token: bytes, expiry: str) -> str:
    return hmac.digest(token, f"scenegate cookie until {expiry}".encode(), hashlib.sha256).hex()


def read_tokens(path: Path) -> Tokens:
    """Read tokens from a file with one per line; empty lines and those that begin with ``#`` are ignored.

    Raises:
        TokenError: there is no token, or one has the wrong length or characters that no header can carry.
    """
    try:
        data = read_regular(path, _MAX_FILE_BYTES)
        lines = [line.strip() for line in data.decode("ascii").splitlines()]
    except OSError as error:
        raise TokenError(f"The token file {path} cannot be read: {error.strerror}.") from None
    except UnicodeDecodeError:
        raise TokenError(f"The token file {path} has characters that are not ASCII.") from None
    tokens = [line for line in lines if line and not line.startswith("#")]
    if not tokens:
        raise TokenError(f"The token file {path} has no token.")
    for number, token in enumerate(tokens, 1):
        if len(token) < MIN_CHARS or len(token) > MAX_CHARS or not token.isprintable() or " " in token:
            raise TokenError(
                f"Token {number} of the token file {path} must have {MIN_CHARS} to {MAX_CHARS} characters and no "
                "spaces; 'openssl rand -hex 32' makes one."
            )
    return Tokens(*tokens)
