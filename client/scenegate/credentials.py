"""Credentials of a client of a gateway or camera: a token, and certificates."""

from __future__ import annotations

import ssl
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final

from scenegate.regular_files import errors_name, read_regular

if TYPE_CHECKING:
    import grpc

_MAX_TOKEN_FILE_BYTES: Final = 1 << 20


@dataclass(frozen=True, slots=True)
class Credentials:
    """Credentials of a client. By default the connection is not encrypted, as on a real rc_visard."""

    token: str | None = None
    """Bearer token, sent with every call in the metadata ``authorization``."""
    tls: bool = False
    """Encrypt, and trust the system's certificate authorities. ``ca`` and ``certificate`` imply it."""
    ca: Path | None = None
    """PEM file of the certificate authorities to trust instead of the system's."""
    certificate: Path | None = None
    """PEM file with the certificate chain of this client. Requires ``key``."""
    key: Path | None = None
    """PEM file with the private key of ``certificate``."""

    def __post_init__(self) -> None:
        """Check the token, and that certificate and key are given together.

        Raises ValueError for a token with invalid characters, or if only one of certificate and key is given.
        """
        if self.token is not None and not (self.token.isascii() and self.token.isprintable() and self.token.strip()):
            raise ValueError("the token must be printable ASCII characters")
        if (self.certificate is None) != (self.key is None):
            raise ValueError("a certificate of the client and its key need each other")

    @property
    def is_encrypted(self) -> bool:
        """True if connections must be encrypted."""
        return bool(self.tls or self.ca or self.certificate)

    def channel(self, target: str, options: Sequence[tuple[str, Any]] = ()) -> grpc.Channel:
        """Return a gRPC channel, without HTTP proxies of the environment, as all our clients. The caller must close it.

        Args:
            target: ``HOST:PORT``.
            options: gRPC channel arguments.

        Raises:
            OSError: a file cannot be read.
        """
        import grpc  # of the extra ``camera``

        options = [("grpc.enable_http_proxy", 0), *options]
        if not self.is_encrypted:
            return grpc.insecure_channel(target, options)
        ca, key, chain = (read_regular(path) if path else None for path in (self.ca, self.key, self.certificate))
        return grpc.secure_channel(target, grpc.ssl_channel_credentials(ca, key, chain), options)

    def context(self) -> ssl.SSLContext:
        """Return the TLS context of an HTTPS client; raise OSError if a certificate cannot be read."""
        with errors_name(self.ca or ""):
            context = ssl.create_default_context(cafile=self.ca)
        if self.certificate is not None:
            with errors_name(self.certificate):
                context.load_cert_chain(self.certificate, self.key)
        return context

    @property
    def metadata(self) -> tuple[tuple[str, str], ...]:
        """gRPC metadata, or HTTP headers, to send with every call."""
        return () if self.token is None else (("authorization", f"Bearer {self.token.strip()}"),)


def read_token(path: Path) -> str:
    """Return the first token in a file. Each line is a token; empty lines and lines that begin with ``#`` are skipped.

    Raises OSError, or ValueError if the file has no token.
    """
    text = read_regular(path, _MAX_TOKEN_FILE_BYTES).decode("utf-8", "replace")
    for line in map(str.strip, text.splitlines()):
        if line and not line.startswith("#"):
            return line
    raise ValueError(f"the token file {path} has no token")
