"""Channels to gRPC ports, with TLS, token and client certificate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import grpc


@dataclass(frozen=True, slots=True)
class Credentials:
    """Credentials of a client. By default the connection is plaintext, as on the device."""

    token: str | None = None
    """Bearer token, sent with every call in the metadata ``authorization``."""
    tls: bool = False
    """Encrypt, and trust the system's authorities. ``ca`` and ``certificate`` imply it."""
    ca: Path | None = None
    """Trusted authorities in place of the system's, PEM."""
    certificate: Path | None = None
    """Certificate chain of this client, PEM; needs ``key``."""
    key: Path | None = None
    """Private key of ``certificate``, PEM."""

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ValueError: invalid characters in the token, or a certificate without key or vice versa.
        """
        if self.token is not None and not (self.token.isascii() and self.token.isprintable() and self.token.strip()):
            raise ValueError("the token must be printable ASCII characters")
        if (self.certificate is None) != (self.key is None):
            raise ValueError("a certificate of the client and its key need each other")

    def channel(self, target: str, options: Sequence[tuple[str, Any]] = ()) -> grpc.Channel:
        """Return a channel, which the caller closes.

        Raises:
            OSError: a file cannot be read.
        """
        if not (self.tls or self.ca or self.certificate):
            return grpc.insecure_channel(target, options)
        ca, key, chain = (path.read_bytes() if path else None for path in (self.ca, self.key, self.certificate))
        return grpc.secure_channel(target, grpc.ssl_channel_credentials(ca, key, chain), options)

    @property
    def metadata(self) -> tuple[tuple[str, str], ...]:
        """Metadata of every call."""
        return () if self.token is None else (("authorization", f"Bearer {self.token.strip()}"),)


def read_token(path: Path) -> str:
    """Return the first token of a file with one token per line, without empty lines and those that begin with ``#``.

    Raises:
        OSError: the file cannot be read.
        ValueError: it has no token.
    """
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in map(str.strip, file):
            if line and not line.startswith("#"):
                return line
    raise ValueError(f"the token file {path} has no token")
