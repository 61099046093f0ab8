"""Settings of the process: access, stored state, limits, logs."""

from functools import partial
from pathlib import Path
from typing import Literal

from pydantic_settings import BaseSettings

from gateway.runtime.settings.option import option
from gateway.runtime.settings.types import FrameOrigins, Names, ProcessCount, RootPath

access = partial(option, "Access")
state_option = partial(option, "State")
limit = partial(option, "Speed and limits")
log_option = partial(option, "Logs")


class ProcessSettings(BaseSettings):
    """Part of ``Settings``."""

    http_certificate: Path | None = access(
        None, "PEM certificate. With --http-key it turns on TLS for HTTP, WebSocket and REST."
    )
    http_key: Path | None = access(None, "PEM private key of --http-certificate, without a password.")
    http_token_file: Path | None = access(
        None,
        "File with bearer tokens, one per line. HTTP, WebSocket and REST then require one of them; only /healthz and "
        "/readyz do not.",
    )
    grpc_token_file: Path | None = access(
        None, "File with bearer tokens for the image stream. Calls send 'authorization: Bearer TOKEN' as metadata."
    )
    tcpq_host: str | None = access(
        None,
        "Address of the TCPQ hub, whose protocol has neither tokens nor TLS. Default: the address of --host, or "
        "127.0.0.1 if HTTP or gRPC requires a token.",
    )
    trusted_hosts: Names = access(
        (),
        "Host names that HTTP requests may use (Host header) besides IP addresses and localhost, separated by commas; "
        "'*' allows all, '*.example.org' all names below example.org. By default, connections from this machine are "
        "rejected if they use any other name.",
    )
    cors_origins: Names = access(
        (),
        "Web origins (https://example.org) whose pages may use the HTTP interface, separated by commas; '*' allows "
        "all. Pages of other origins can neither read responses nor change anything, nor show /view in a frame.",
    )
    frame_origins: FrameOrigins = access(
        (),
        "Web origins whose pages may show /view in a frame besides those of http://localhost and http://127.0.0.1, "
        "separated by commas, such as a notebook's https://hub.example.org; '*' allows all. Unlike pages of "
        "--cors-origins, they can read nothing else.",
    )
    root_path: RootPath = access(
        "",
        "Path prefix that a proxy serves the gateway below and keeps in its requests, such as /user/ann/proxy/8000. A "
        "proxy that removes the prefix needs no setting.",
    )

    state: Path | None = state_option(
        None,
        "File that stores the live tree and the stereo camera's parameters. A confirmed change survives any end of the "
        "process. The file is created if missing; without this setting, every start is empty.",
    )
    history_seconds: float = state_option(
        60.0,
        "Time for which earlier states of the live tree are kept: for the time bar of the browser view, and for "
        "'time' of GET /scene, /scene/render, /view/frame.jpg and /cameras/NAME/…. 0: none.",
        ge=0,
        le=86400,
    )
    history_mb: int = state_option(
        256,
        "Maximum memory of these states, in MiB; the oldest go first. A minute of 1000 nodes that move at 60 Hz needs "
        "245 MiB.",
        ge=1,
        le=1 << 16,
    )

    workers: ProcessCount = limit(
        1,
        "Number of processes that serve the HTTP port, for machines with more cores than one process can use; auto: "
        "half of the cores. Other numbers than 1 need --only render. All limits of this group hold for each process.",
        ge=0,
        le=256,
    )
    unresponsive_seconds: float = limit(
        30.0, "Time after which a process of --workers that does not respond is killed and replaced.", ge=1, le=3600
    )
    threads: int = limit(
        0,
        "Number of worker threads of each process; 0: one per core, or the cores divided by --workers. Stereo cameras "
        "have as many of their own.",
        ge=0,
        le=1024,
    )
    frame_threads: int = limit(
        0,
        "Maximum number of threads for one image, used while other worker threads are idle; 0: as many as --threads. A "
        "lower number leaves cores to other programs when there are few requests.",
        ge=0,
        le=1024,
    )
    render_seconds: float = limit(
        30.0,
        "Maximum time for reading a scene and rendering one image, without waiting in the queue or for kernels. "
        "Beyond it the response is 503 without Retry-After.",
        gt=0,
        le=86_400,
    )
    queue: int = limit(
        256,
        "Maximum number of requests that wait for a worker thread. Beyond it the response is 503 with Retry-After. "
        "Waiting is normal; Drake's client never retries.",
        ge=0,
        le=100_000,
    )
    niceness: int = limit(
        0,
        "Niceness of the worker threads relative to the process, so that other programs on the machine come first. The "
        "event loop is scheduled before the worker threads anyway on Linux 6.12 and later; older kernels may need 10. "
        "While a stereo camera streams, the threads of other work have 10 at least.",
        ge=0,
        le=19,
    )
    queue_mb: int = limit(
        2048,
        "Maximum size of all request bodies that are being received, wait or are rendered, in MiB.",
        ge=1,
        le=1 << 20,
    )
    max_body_mb: int = limit(256, "Maximum size of one request body, in MiB; beyond it 413.", ge=1, le=1 << 16)
    max_pixels: int = limit(4096 * 4096, "Maximum width times height of one image.", ge=1, le=1 << 28)
    max_triangles: int = limit(
        10_000_000,
        "Maximum number of triangles, lines and points in one posted scene, counting all instances. Each takes 210 "
        "bytes while it is rendered.",
        ge=1,
        le=1 << 31,
    )
    max_nodes: int = limit(100_000, "Maximum number of nodes in one posted scene.", ge=1, le=1 << 24)
    max_image_pixels: int = limit(
        8192 * 8192, "Maximum width times height of one texture of a posted scene.", ge=1, le=1 << 28
    )
    cache_bytes: int = limit(
        1 << 30,
        "Maximum size in bytes of all caches of a process together: posted scenes, mesh files, and what is derived "
        "from them. /metrics and /healthz have the size of each.",
        ge=0,
        le=1 << 40,
    )
    shutdown_seconds: float = limit(
        10.0,
        "Time for accepted requests to finish after SIGTERM. Streams end at once, and new requests are rejected. The "
        "process ends at most four seconds later.",
        ge=0,
        le=3600,
    )

    log_format: Literal["auto", "human", "json"] = log_option(
        "auto",
        "'human': lines, coloured in a terminal unless NO_COLOR is set; 'json': one object per line; 'auto': human in "
        "a terminal, else JSON.",
    )
    log_level: Literal["debug", "info", "warning", "error"] = log_option("info", "Lowest level that is logged.")
