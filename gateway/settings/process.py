"""Settings of the process: access, stored state, limits, logs."""

from __future__ import annotations

from pathlib import Path
from typing import Literal

from pydantic_settings import BaseSettings

from gateway.settings.option import option
from gateway.settings.types import FrameOrigins, Names, ProcessCount, RootPath


class ProcessSettings(BaseSettings):
    """Part of ``Settings``."""

    # --- Access
    http_certificate: Path | None = option(
        None, "Access", "PEM certificate. With --http-key it turns on TLS for HTTP, WebSocket and REST."
    )
    http_key: Path | None = option(None, "Access", "PEM private key of --http-certificate, without a password.")
    http_token_file: Path | None = option(
        None,
        "Access",
        "File with bearer tokens, one per line. HTTP, WebSocket and REST then require one of them; only /healthz and "
        "/readyz do not.",
    )
    grpc_token_file: Path | None = option(
        None,
        "Access",
        "File with bearer tokens for the image stream. Calls send 'authorization: Bearer TOKEN' as metadata.",
    )
    tcpq_host: str | None = option(
        None,
        "Access",
        "Address of the TCPQ hub, whose protocol has neither tokens nor TLS. Default: the address of --host, or "
        "127.0.0.1 if HTTP or gRPC requires a token.",
    )
    trusted_hosts: Names = option(
        (),
        "Access",
        "Host names that HTTP requests may use (Host header) besides IP addresses and localhost, separated by commas; "
        "'*' allows all, '*.example.org' all names below example.org. By default, connections from this machine are "
        "rejected if they use any other name.",
    )
    cors_origins: Names = option(
        (),
        "Access",
        "Web origins (https://example.org) whose pages may use the HTTP interface, separated by commas; '*' allows "
        "all. Pages of other origins can neither read responses nor change anything, nor show /view in a frame.",
    )
    frame_origins: FrameOrigins = option(
        (),
        "Access",
        "Web origins whose pages may show /view in a frame besides those of http://localhost and http://127.0.0.1, "
        "separated by commas, such as a notebook's https://hub.example.org; '*' allows all. Unlike pages of "
        "--cors-origins, they can read nothing else.",
    )
    root_path: RootPath = option(
        "",
        "Access",
        "Path prefix that a proxy serves the gateway below and keeps in its requests, such as /user/ann/proxy/8000. A "
        "proxy that removes the prefix needs no setting.",
    )

    # --- State
    state: Path | None = option(
        None,
        "State",
        "File that stores the live tree and the stereo camera's parameters. A confirmed change survives any end of the "
        "process. The file is created if missing; without this setting, every start is empty.",
    )
    history_seconds: float = option(
        60.0,
        "State",
        "Time for which earlier states of the live tree are kept: for the time bar of the browser view, and for "
        "'time' of GET /scene, /scene/render, /view/frame.jpg and /cameras/NAME/…. 0: none.",
        ge=0,
        le=86400,
    )
    history_mb: int = option(
        256,
        "State",
        "Maximum memory of these states, in MiB; the oldest go first. A minute of 1000 nodes that move at 60 Hz needs "
        "245 MiB.",
        ge=1,
        le=1 << 16,
    )

    # --- Speed and limits
    workers: ProcessCount = option(
        1,
        "Speed and limits",
        "Number of processes that serve the HTTP port, for machines with more cores than one process can use; auto: "
        "half of the cores. Other numbers than 1 need --only render. All limits of this group hold for each process.",
        ge=0,
        le=256,
    )
    unresponsive_seconds: float = option(
        30.0,
        "Speed and limits",
        "Time after which a process of --workers that does not respond is killed and replaced.",
        ge=1,
        le=3600,
    )
    threads: int = option(
        0,
        "Speed and limits",
        "Number of worker threads of each process; 0: one per core, or the cores divided by --workers. Stereo cameras "
        "have as many of their own.",
        ge=0,
        le=1024,
    )
    frame_threads: int = option(
        0,
        "Speed and limits",
        "Maximum number of threads for one image, used while other worker threads are idle; 0: as many as --threads. A "
        "lower number leaves cores to other programs when there are few requests.",
        ge=0,
        le=1024,
    )
    render_seconds: float = option(
        30.0,
        "Speed and limits",
        "Maximum time for reading a scene and rendering one image, without waiting in the queue or for kernels. "
        "Beyond it the response is 503 without Retry-After.",
        gt=0,
        le=86_400,
    )
    queue: int = option(
        256,
        "Speed and limits",
        "Maximum number of requests that wait for a worker thread. Beyond it the response is 503 with Retry-After. "
        "Waiting is normal; Drake's client never retries.",
        ge=0,
        le=100_000,
    )
    niceness: int = option(
        0,
        "Speed and limits",
        "Niceness of the worker threads relative to the process, so that other programs on the machine come first. The "
        "event loop is scheduled before the worker threads anyway on Linux 6.12 and later; older kernels may need 10. "
        "While a stereo camera streams, the threads of other work have 10 at least.",
        ge=0,
        le=19,
    )
    queue_mb: int = option(
        2048,
        "Speed and limits",
        "Maximum size of all request bodies that are being received, wait or are rendered, in MiB.",
        ge=1,
        le=1 << 20,
    )
    max_body_mb: int = option(
        256, "Speed and limits", "Maximum size of one request body, in MiB; beyond it 413.", ge=1, le=1 << 16
    )
    max_pixels: int = option(
        4096 * 4096, "Speed and limits", "Maximum width times height of one image.", ge=1, le=1 << 28
    )
    max_triangles: int = option(
        10_000_000,
        "Speed and limits",
        "Maximum number of triangles, lines and points in one posted scene, counting all instances. Each takes 210 "
        "bytes while it is rendered.",
        ge=1,
        le=1 << 31,
    )
    max_nodes: int = option(
        100_000, "Speed and limits", "Maximum number of nodes in one posted scene.", ge=1, le=1 << 24
    )
    max_image_pixels: int = option(
        8192 * 8192,
        "Speed and limits",
        "Maximum width times height of one texture of a posted scene.",
        ge=1,
        le=1 << 28,
    )
    cache_bytes: int = option(
        1 << 30,
        "Speed and limits",
        "Maximum size in bytes of all caches of a process together: posted scenes, mesh files, and what is derived "
        "from them. /metrics and /healthz have the size of each.",
        ge=0,
        le=1 << 40,
    )
    shutdown_seconds: float = option(
        10.0,
        "Speed and limits",
        "Time for accepted requests to finish after SIGTERM. Streams end at once, and new requests are rejected. The "
        "process ends at most two seconds later.",
        ge=0,
        le=3600,
    )

    # --- Logs
    log_format: Literal["auto", "human", "json"] = option(
        "auto",
        "Logs",
        "'human': lines, coloured in a terminal unless NO_COLOR is set; 'json': one object per line; 'auto': human in "
        "a terminal, else JSON.",
    )
    log_level: Literal["debug", "info", "warning", "error"] = option("info", "Logs", "Lowest level that is logged.")
