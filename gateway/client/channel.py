"""How a client comes to a gRPC port that asks for TLS, a token or a certificate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import grpc


@dataclass(frozen=True, slots=True)
class Credentials:
    """What the port wants to see; without any of it the connection is plain, as the device's own."""

    token: str | None = None
    """Sent with every call as ``authorization: Bearer TOKEN``."""
    tls: bool = False
    """Encrypt, and trust the system's authorities; the files below imply it."""
    ca: Path | None = None
    """PEM authorities that are trusted instead."""
    certificate: Path | None = None
    """PEM chain that this client shows of itself, with ``key``."""
    key: Path | None = None

    def __post_init__(self) -> None:
        """Raises ValueError: a token that no header can carry, or half of a certificate."""
        if self.token is not None and not (self.token.isascii() and self.token.isprintable() and self.token.strip()):
            raise ValueError("the token must be printable ASCII characters")
        if (self.certificate is None) != (self.key is None):
            raise ValueError("a certificate of the client and its key need each other")

    def channel(self, target: str, options: Sequence[tuple[str, Any]] = ()) -> grpc.Channel:
        """A channel that the caller closes.

        Raises:
            OSError: a file cannot be read.
        """
        if not (self.tls or self.ca or self.certificate):
            return grpc.insecure_channel(target, options)
        ca, key, chain = (path.read_bytes() if path else None for path in (self.ca, self.key, self.certificate))
        return grpc.secure_channel(target, grpc.ssl_channel_credentials(ca, key, chain), options)

    @property
    def metadata(self) -> tuple[tuple[str, str], ...]:
        """Of each call."""
        return () if self.token is None else (("authorization", f"Bearer {self.token.strip()}"),)


def read_token(path: Path) -> str:
    """The first token of a file as the gateway reads them: one a line, empty ones and ``#`` apart.

    Raises:
        OSError: the file cannot be read.
        ValueError: it has no token.
    """
    with path.open(encoding="utf-8", errors="replace") as file:
        for line in file:
            if line.strip() and not line.startswith("#"):
                return line.strip()
    raise ValueError(f"the token file {path} has no token")
