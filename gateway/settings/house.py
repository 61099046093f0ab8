"""Options of the process: who may come in, what survives it, how much it may use, what it says."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic_settings import BaseSettings

from gateway.settings.types import Names, option


class HouseSettings(BaseSettings):
    """Part of ``Settings``."""

    # --- Access
    http_certificate: Path | None = option(
        None, "Access", "PEM certificate; with --http-key HTTP, WebSocket and REST are encrypted."
    )
    http_key: Path | None = option(None, "Access", "PEM private key of --http-certificate, without a password.")
    http_token_file: Path | None = option(
        None,
        "Access",
        "File with bearer tokens, one a line: HTTP, WebSocket and REST want one of them, /healthz and /readyz apart.",
    )
    grpc_token_file: Path | None = option(
        None, "Access", "The same for the image stream: 'authorization: Bearer TOKEN' in a call's metadata."
    )
    tcpq_host: str | None = option(
        None,
        "Access",
        "Address of the TCPQ hub, which knows neither tokens nor TLS. Without it that of --host, or 127.0.0.1 where "
        "one of the others wants a token.",
    )
    trusted_hosts: Names = option(
        (),
        "Access",
        "Names that HTTP may be called by (Host header) besides numbers and localhost, separated by commas; '*' for "
        "any, '*.example.org' for those below. Without it other names are refused on connections from this machine.",
    )
    cors_origins: Names = option(
        (),
        "Access",
        "Origins whose pages may use HTTP (https://example.org), separated by commas; '*' for any. Pages of others may "
        "neither read answers nor change anything, nor show /view in a frame.",
    )

    # --- State
    state: Path | None = option(
        None,
        "State",
        "File that keeps the live tree and the stereo camera's parameters: nothing that was answered is lost when the "
        "process ends, however it ends. Made where it is missing; without it everything begins anew.",
    )

    # --- Speed and limits
    threads: int = option(0, "Speed and limits", "Threads that render; 0: one per core.", ge=0, le=1024)
    frame_threads: int = option(
        0,
        "Speed and limits",
        "Threads that may work on one picture while others are idle; 0: as many as render. Fewer leave processors to "
        "other programs when few pictures are asked for at once.",
        ge=0,
        le=1024,
    )
    render_seconds: float = option(
        30.0,
        "Speed and limits",
        "Time that reading a scene and drawing one picture of it may take, not counted while the request waits; beyond "
        "it 503, without Retry-After.",
        gt=0,
        le=86_400,
    )
    queue: int = option(
        256,
        "Speed and limits",
        "Requests that may wait for a thread. Waiting is normal, Drake's client never retries; beyond it the answer "
        "is 503 with Retry-After.",
        ge=0,
        le=100_000,
    )
    niceness: int = option(
        0,
        "Speed and limits",
        "How far threads that draw stand behind the process's own priority, so that other programs of the machine go "
        "before them. The event loop does on Linux 6.12 and later; on older kernels it may need 10 here.",
        ge=0,
        le=19,
    )
    queue_mb: int = option(
        2048, "Speed and limits", "MiB of request bodies that arrive, wait or are rendered.", ge=1, le=1 << 20
    )
    max_body_mb: int = option(256, "Speed and limits", "MiB of one request's body; beyond it 413.", ge=1, le=1 << 16)
    max_pixels: int = option(4096 * 4096, "Speed and limits", "Width times height of one picture.", ge=1, le=1 << 28)
    max_triangles: int = option(
        10_000_000,
        "Speed and limits",
        "Triangles, lines and points of one posted scene, all instances counted: 210 bytes each while drawn.",
        ge=1,
        le=1 << 31,
    )
    max_nodes: int = option(100_000, "Speed and limits", "Nodes of one posted scene.", ge=1, le=1 << 24)
    max_image_pixels: int = option(
        8192 * 8192, "Speed and limits", "Width times height of one texture of a posted scene.", ge=1, le=1 << 28
    )
    mesh_cache_mb: int = option(
        512, "Speed and limits", "MiB of geometry kept for requests that bring it again.", ge=0, le=1 << 20
    )
    scene_cache_mb: int = option(
        256, "Speed and limits", "MiB of whole posted scenes kept for requests that bring them again.", ge=0, le=1 << 20
    )
    shutdown_seconds: float = option(
        10.0,
        "Speed and limits",
        "Time that accepted requests get to finish after SIGTERM; streams end at once, nothing new is taken. The "
        "process has ended two seconds later at most.",
        ge=0,
        le=3600,
    )

    # --- Logs
    log_format: Literal["auto", "human", "json"] = option(
        "auto", "Logs", "'human' with colours, 'json' one object a line; 'auto': human in a terminal, else JSON."
    )
    log_level: Literal["debug", "info", "warning", "error"] = option("info", "Logs", "The least that is logged.")
