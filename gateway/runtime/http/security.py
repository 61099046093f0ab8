"""Access settings applied to the interfaces, and log lines at start about interfaces open to other machines."""

from __future__ import annotations

import os
import socket
import ssl
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from urllib.parse import parse_qs, urlsplit

import structlog
from fastapi import FastAPI
from starlette.middleware.cors import CORSMiddleware

from gateway.runtime.http import health
from gateway.runtime.http.access import CORS_EXPOSED, Access, is_loopback
from gateway.runtime.http.edge import Edge
from gateway.runtime.http.protection import Protection
from gateway.runtime.http.start_gate import StartGate
from gateway.runtime.http.tokens import TokenError, Tokens, read_tokens
from gateway.runtime.logs.metrics_registry import Metrics
from gateway.runtime.settings import Settings, SettingsError

_log = structlog.get_logger("gateway")


@dataclass(frozen=True, slots=True)
class Security:
    """Tokens and TLS of all interfaces, read before any port is opened."""

    settings: Settings
    http: Tokens | None
    grpc: Tokens | None

    @classmethod
    def from_settings(cls, settings: Settings) -> Security:
        """Read the files that the settings name.

        Raises:
            SettingsError: a token file or certificate cannot be used.
        """
        try:
            http, grpc = (
                read_tokens(path) if path is not None else None
                for path in (settings.http_token_file, settings.grpc_token_file)
            )
        except TokenError as error:
            raise SettingsError(str(error)) from None
        security = cls(settings, http, grpc)
        if security.tls is not None:
            try:
                ssl.SSLContext(ssl.PROTOCOL_TLS_SERVER).load_cert_chain(*security.tls, password=lambda: "")
            except OSError as error:
                files, reason = " with ".join(map(str, security.tls)), error.strerror or str(error)
                raise SettingsError(f"TLS of HTTP cannot use {files}: {reason}.") from None
        return security

    @property
    def tls(self) -> tuple[Path, Path] | None:
        """Paths of HTTP's certificate and key, or None."""
        if self.settings.http_certificate is None or self.settings.http_key is None:
            return None
        return self.settings.http_certificate, self.settings.http_key

    def protect(
        self,
        app: FastAPI,
        *,
        metrics: Metrics | None = None,
        quiet_paths: Collection[str] = (),
        gate: StartGate | None = None,
    ) -> None:
        """Add the edge to an application, with token, CORS, and protection from pages of other sites.

        Args:
            metrics, quiet_paths, gate: see ``Edge``.
        """
        settings, access, cors = self.settings, None, None
        if self.http is not None:
            access = Access(tokens=self.http, open_paths=health.OPEN_PATHS, cookie_path=settings.root_path or "/")
        if settings.cors_origins:
            cors = partial(
                CORSMiddleware,
                allow_origins=list(settings.cors_origins),
                allow_methods=["GET", "HEAD", "POST", "PUT", "DELETE"],
                allow_headers=["*"],
                expose_headers=list(CORS_EXPOSED),
            )
        protection = Protection(
            hosts=settings.trusted_hosts, origins=settings.cors_origins, frame_origins=settings.frame_origins
        )
        app.add_middleware(
            Edge, metrics=metrics, quiet_paths=quiet_paths, protection=protection, cors=cors, access=access, gate=gate
        )

    def log_exposure(self) -> None:
        """Log the interfaces that other machines reach, with a warning if they lack TLS or a token."""
        for name, address, missing in self.exposed():
            if missing:
                _log.warning(f"{name} is open to other machines ({address}) without {missing}; see docs/security.md")
            else:
                _log.info(f"{name} is open to other machines ({address}), with TLS and a token")

    def exposed(self) -> Iterator[tuple[str, str, str]]:
        """Yield name, address and missing protection of each interface that other machines reach."""
        s = self.settings
        if _is_reachable(s.host):
            http_missing = _missing_protection(self.tls is not None, self.http is not None)
            yield "HTTP", f"{s.host} port {s.http_port}", http_missing
            if s.is_enabled("stereo"):
                if s.rest_port is not None:
                    yield "The device's REST interface", f"{s.host} port {s.rest_port}", http_missing
                grpc_missing = _missing_protection(
                    s.grpc_certificate is not None, self.grpc is not None or s.grpc_client_ca is not None
                )
                # gRPC listens on IPv4 and IPv6 for the wildcard address of either.
                grpc_host = "0.0.0.0 and ::" if s.host in ("0.0.0.0", "::") else s.host  # noqa: S104 - a message
                yield "The stereo camera's gRPC", f"{grpc_host} port {s.grpc_port}", grpc_missing
        if not s.is_enabled("treeviewer"):
            return
        if s.tcpq_port is not None and _is_reachable(self.tcpq_host):
            yield "TCPQ", f"{self.tcpq_host} port {s.tcpq_port}", "TLS or a token, which its protocol does not have"
        url = s.lcm_url or os.environ.get("LCM_DEFAULT_URL") or ""
        if _multicast_ttl(url) > 0:
            yield "LCM", url, "TLS or a token, which its protocol does not have"

    @property
    def tcpq_host(self) -> str:
        """Address of the TCPQ hub: that of the other interfaces, or loopback if they have tokens: TCPQ has none."""
        if self.settings.tcpq_host is not None:
            return self.settings.tcpq_host
        return self.settings.host if self.http is None and self.grpc is None else "127.0.0.1"


def _missing_protection(tls: bool, token: bool) -> str:
    return " and ".join([*([] if tls else ["TLS"]), *([] if token else ["a token"])])


def _is_reachable(host: str) -> bool:
    """Return whether other machines reach a server on this address."""
    if is_loopback(host):
        return False
    try:
        addresses = socket.getaddrinfo(host, None, type=socket.SOCK_STREAM)
    except OSError:
        return True
    return not all(is_loopback(str(address[0])) for *_, address in addresses)


def _multicast_ttl(url: str) -> int:
    """Return the hops that LCM's multicast may take; 0 stays on this machine."""
    parts = urlsplit(url)
    try:
        return int(parse_qs(parts.query).get("ttl", ["0"])[0]) if parts.scheme == "udpm" else 0
    except ValueError:
        return 0
