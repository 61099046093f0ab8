"""The metrics that Prometheus reads from each interface. Names and units: docs/deployment.md.

A table for each source, with a row for each metric. Names that end in ``_total`` are counters, all others gauges. The
metrics of single requests are in ``gateway.runtime.metrics_registry``.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Final, Generic, NamedTuple, TypeVar

from gateway import __version__
from gateway.runtime.metrics_registry import Metrics, Reading
from gateway.runtime.service_registry import ServiceRegistry, State
from gateway.runtime.worker_pool import WorkerPool
from gateway.scene.history import TreeHistory
from gateway.scene.live import LiveTree
from renderers.cache import CacheBudget

if TYPE_CHECKING:
    from gateway.render.service import RenderService
    from gateway.stereo.service import StereoService
    from gateway.treeviewer.service import TreeViewerService
    from gateway.viewer.hub import ViewHub

Source = TypeVar("Source")


class Row(NamedTuple, Generic[Source]):
    """A metric of a source."""

    name: str
    help: str
    read: Callable[[Source], Reading]
    """Called when Prometheus scrapes. Returns a number, or one for each value of the label."""
    label: str = ""


def watch(metrics: Metrics, table: Sequence[Row[Source]], source: Source) -> None:
    """Add the metrics of a source."""
    for row in table:
        metrics.watch(row.name, row.help, partial(row.read, source), label=row.label)


def _seconds(history: TreeHistory) -> float:
    first, last = history.span
    return (last - first) / 1e9


def _figures(service: TreeViewerService, *names: str) -> dict[str, float]:
    status = service.status()
    return {name: status[name] for name in names}


def _transport_figure(service: TreeViewerService, transport: str, name: str) -> float:
    """Return a figure of a transport; 0 if the transport is off or has no such figure."""
    figures = service.status().get(transport)
    return float(figures.get(name, 0)) if isinstance(figures, Mapping) else 0.0


_CALL_ENDS: Final = ("done", "rejected", "abandoned", "timed_out")
_MESSAGE_OUTCOMES: Final = ("received", "answered", "missing", "failed", "unanswerable", "internal_errors")

REGISTRY: Final[Sequence[Row[ServiceRegistry]]] = (
    Row(
        "scenegate_build_info",
        "Constant 1; the label version is the version of this gateway.",
        lambda registry: {__version__: 1.0},
        "version",
    ),
    Row(
        "scenegate_interface_ready",
        "1 if clients can use the interface, else 0, by interface.",
        lambda registry: {name: entry.current() is State.READY for name, entry in registry.entries.items()},
        "interface",
    ),
    Row(
        "scenegate_workers_ready",
        "Number of processes (--workers) that are ready.",
        lambda registry: registry.verdict() == "ready",
    ),
)
WORKERS: Final[Sequence[Row[WorkerPool]]] = (
    Row("scenegate_render_threads", "Number of worker threads.", lambda pool: pool.threads),
    Row("scenegate_render_running", "Number of calls that worker threads execute.", lambda pool: pool.stats.running),
    Row(
        "scenegate_render_slow",
        "Number of running calls that have taken more than half of --render-seconds.",
        lambda pool: pool.stats.slow,
    ),
    Row("scenegate_render_waiting", "Number of calls that wait for a worker thread.", lambda pool: pool.stats.waiting),
    Row(
        "scenegate_render_waiting_limit",
        "Maximum number of calls that may wait for a worker thread (--queue).",
        lambda pool: pool.max_waiting,
    ),
    Row(
        "scenegate_render_waiting_bytes",
        "Bytes of the request bodies of all calls that wait for a worker thread.",
        lambda pool: pool.stats.waiting_bytes,
    ),
    Row(
        "scenegate_calls_total",
        "Number of calls given to worker threads, by end: done (returned or raised), rejected (queue full), "
        "abandoned (client disconnected) or timed_out (--render-seconds).",
        lambda pool: {end: getattr(pool.stats, end) for end in _CALL_ENDS},
        "end",
    ),
)
CACHES: Final[Sequence[Row[CacheBudget]]] = (
    Row(
        "scenegate_cache_hits_total",
        "Number of cache hits, by cache.",
        lambda caches: {name: cache.hits for name, cache in caches.figures().items()},
        "cache",
    ),
    Row(
        "scenegate_cache_misses_total",
        "Number of cache misses, by cache.",
        lambda caches: {name: cache.misses for name, cache in caches.figures().items()},
        "cache",
    ),
    Row(
        "scenegate_cache_bytes",
        "Bytes held by the caches, approximately, by cache.",
        lambda caches: {name: cache.nbytes for name, cache in caches.figures().items()},
        "cache",
    ),
    Row(
        "scenegate_cache_limit_bytes",
        "Bytes that all caches together may hold (--cache-bytes).",
        lambda caches: caches.max_bytes,
    ),
)
TREE: Final[Sequence[Row[LiveTree]]] = (
    Row("scenegate_tree_revision", "Number of edits of the live scene.", lambda tree: tree.snapshot.revision),
    Row("scenegate_tree_nodes", "Number of nodes in the live scene.", lambda tree: tree.snapshot.root.node_count),
    Row(
        "scenegate_tree_geometry_nodes",
        "Number of nodes with geometry in the live scene.",
        lambda tree: tree.snapshot.root.nodes_with_parts,
    ),
)
HISTORY: Final[Sequence[Row[TreeHistory]]] = (
    Row(
        "scenegate_history_bytes",
        "Bytes of earlier states of the live scene, approximately.",
        lambda history: history.nbytes,
    ),
    Row("scenegate_history_duration_seconds", "Seconds from the oldest state that is kept until now.", _seconds),
)
RENDER: Final[Sequence[Row[RenderService]]] = (
    Row(
        "scenegate_render_body_bytes",
        "Bytes of render request bodies that are being received, wait or are rendered.",
        lambda service: service.inflight_bytes,
    ),
)
STEREO: Final[Sequence[Row[list[StereoService]]]] = (  # summed over all cameras
    Row(
        "scenegate_stereo_streams",
        "Number of open gRPC image streams.",
        lambda cameras: sum(len(each.hub) for each in cameras),
    ),
    Row(
        "scenegate_stereo_sets_sent_total",
        "Number of image sets sent, summed over all clients.",
        lambda cameras: sum(each.hub.sent for each in cameras),
    ),
    Row(
        "scenegate_stereo_sets_skipped_total",
        "Number of image sets not sent because a set of a later frame was there, as with a client that reads slowly, "
        "summed over all clients.",
        lambda cameras: sum(each.hub.skipped for each in cameras),
    ),
    Row(
        "scenegate_stereo_frames_total",
        "Number of frames taken, by kind: camera (left and right) or depth.",
        lambda cameras: {
            "camera": sum(each.counts.frames for each in cameras),
            "depth": sum(each.counts.depth_frames for each in cameras),
        },
        "kind",
    ),
    Row(
        "scenegate_stereo_skipped_total",
        "Number of frames that were due and not taken, by reason: in_work (late, or too many frames unfinished) or "
        "busy (the queue is full).",
        lambda cameras: {
            "in_work": sum(each.counts.skipped for each in cameras),
            "busy": sum(each.counts.dropped for each in cameras),
        },
        "reason",
    ),
    Row(
        "scenegate_stereo_depth_duration_seconds",
        "Seconds from exposure to publication of the latest depth frame; the maximum over all cameras.",
        lambda cameras: max(each.counts.depth_seconds for each in cameras),
    ),
)
TREE_VIEWER: Final[Sequence[Row[TreeViewerService]]] = (
    Row(
        "scenegate_lcm_messages_total",
        "Number of tree viewer messages, by what: requests received, responses sent (answered), responses "
        "that report missing paths (missing) or an error (failed), responses that could not be sent "
        "(unanswerable), and internal_errors.",
        lambda service: _figures(service, *_MESSAGE_OUTCOMES),
        "what",
    ),
    Row(
        "scenegate_lcm_bytes_total",
        "Bytes of tree viewer requests received over LCM and TCPQ.",
        lambda service: service.status()["received_bytes"],
    ),
    Row(
        "scenegate_lcm_lost_total",
        "Number of tree viewer messages or datagrams lost, by reason: datagrams (dropped by the operating "
        "system), incomplete (a fragment is missing), refused (larger than the limit), waiting (queue full) "
        "or undecodable.",
        lambda service: {
            "datagrams": _transport_figure(service, "lcm", "lost_datagrams"),
            "incomplete": _transport_figure(service, "lcm", "incomplete"),
            "refused": _transport_figure(service, "lcm", "refused"),
            "waiting": service.status()["dropped"] + _transport_figure(service, "lcm", "dropped"),
            "undecodable": service.status()["undecodable"],
        },
        "reason",
    ),
    Row(
        "scenegate_lcm_foreign_datagrams_total",
        "Number of LCM datagrams of other machines that were dropped, because ttl=0 stands for this machine alone.",
        lambda service: _transport_figure(service, "lcm", "foreign_datagrams"),
    ),
    Row(
        "scenegate_lcm_waiting_bytes",
        "Bytes of tree viewer requests received and not yet handled.",
        lambda service: service.status()["waiting_bytes"],
    ),
    Row(
        "scenegate_tree_geometry_bytes",
        "Bytes of geometry arrays that tree viewer clients have published into the live scene.",
        lambda service: service.status()["geometry_bytes"],
    ),
    Row(
        "scenegate_tcpq_clients",
        "Number of clients connected to the TCPQ hub.",
        lambda service: _transport_figure(service, "tcpq", "clients"),
    ),
)
VIEW: Final[Sequence[Row[ViewHub]]] = (
    Row(
        "scenegate_view_browsers",
        "Number of pages connected to the browser view's WebSocket.",
        lambda hub: hub.status()["browsers"],
    ),
)
