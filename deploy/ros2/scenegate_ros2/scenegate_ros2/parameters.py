"""Parameters of the node; config/scenegate.yaml explains them."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from scenegate.credentials import Credentials, read_token


@dataclass(frozen=True)
class NodeParameters:
    """Parameters and their defaults, which config/scenegate.yaml repeats."""

    camera: str = "127.0.0.1:50051"
    url: str = "http://127.0.0.1:8000"
    token: str = ""
    token_file: str = ""
    tls: bool = False
    ca: str = ""
    certificate: str = ""
    key: str = ""
    color: bool = False
    scene: bool = True
    reliability: str = "reliable"
    tf_rate: float = 10.0
    publish_clock: bool = False

    def __post_init__(self) -> None:
        """Check the values.

        Raises:
            ValueError: one is out of range.
        """
        if self.reliability not in ("reliable", "best_effort"):
            raise ValueError(f"reliability is {self.reliability!r}; it must be reliable or best_effort")
        if not 0.0 < self.tf_rate <= 1000.0:
            raise ValueError(f"tf_rate is {self.tf_rate} Hz; it must be above 0 and at most 1000")

    def credentials(self) -> Credentials:
        """Return token and certificates.

        Raises:
            ValueError: a token is invalid, or a certificate has no key.
            OSError: the file of the token cannot be read.
        """
        token = read_token(Path(self.token_file)) if self.token_file else self.token
        ca, certificate, key = (Path(name) if name else None for name in (self.ca, self.certificate, self.key))
        return Credentials(token or None, self.tls, ca, certificate, key)
