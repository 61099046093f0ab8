"""The metrics that Prometheus reads from each interface. Names and units: docs/deployment.md.

A function for each source of figures. The metrics of single requests are in ``gateway.runtime.logs.metrics_registry``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Final

from gateway import __version__
from gateway.replay.history import TreeHistory
from gateway.runtime.logs.metrics_registry import Metrics
from gateway.runtime.service_registry import InterfaceState, ServiceRegistry
from gateway.runtime.workers.worker_pool import WorkerPool
from gateway.scene.tree.live import LiveTree
from renderers.cache import CacheBudget

if TYPE_CHECKING:
    from gateway.adapters.render.service import RenderService
    from gateway.adapters.stereo.service import StereoService
    from gateway.adapters.treeviewer.service import TreeViewerService
    from gateway.adapters.viewer.hub import ViewHub

_CALL_ENDS: Final = ("done", "rejected", "abandoned", "timed_out")
_MESSAGE_OUTCOMES: Final = ("received", "answered", "missing", "failed", "unanswerable", "internal_errors")


def watch_registry(metrics: Metrics, registry: ServiceRegistry) -> None:
    metrics.watch(
        "scenegate_build_info",
        "Constant 1; the label version is the version of this gateway.",
        lambda: {__version__: 1.0},
        label="version",
    )
    metrics.watch(
        "scenegate_interface_ready",
        "1 if clients can use the interface, else 0, by interface.",
        lambda: {name: entry.current() is InterfaceState.READY for name, entry in registry.entries.items()},
        label="interface",
    )
    metrics.watch(
        "scenegate_workers_ready",
        "Number of processes (--workers) that are ready.",
        lambda: registry.verdict() == "ready",
    )


def watch_workers(metrics: Metrics, pool: WorkerPool) -> None:
    metrics.watch("scenegate_render_threads", "Number of worker threads.", lambda: pool.threads)
    metrics.watch(
        "scenegate_render_running", "Number of calls that worker threads execute.", lambda: pool.stats.running
    )
    metrics.watch(
        "scenegate_render_slow",
        "Number of running calls that have taken more than half of --render-seconds.",
        lambda: pool.stats.slow,
    )
    metrics.watch(
        "scenegate_render_waiting", "Number of calls that wait for a worker thread.", lambda: pool.stats.waiting
    )
    metrics.watch(
        "scenegate_render_waiting_limit",
        "Maximum number of calls that may wait for a worker thread (--queue).",
        lambda: pool.max_waiting,
    )
    metrics.watch(
        "scenegate_render_waiting_bytes",
        "Bytes of the request bodies of all calls that wait for a worker thread.",
        lambda: pool.stats.waiting_bytes,
    )
    metrics.watch(
        "scenegate_calls_total",
        "Number of calls given to worker threads, by end: done (returned or raised), rejected (queue full), "
        "abandoned (client disconnected) or timed_out (--render-seconds).",
        lambda: {end: getattr(pool.stats, end) for end in _CALL_ENDS},
        label="end",
    )


def watch_caches(metrics: Metrics, caches: CacheBudget) -> None:
    metrics.watch(
        "scenegate_cache_hits_total",
        "Number of cache hits, by cache.",
        lambda: {name: cache.hits for name, cache in caches.figures().items()},
        label="cache",
    )
    metrics.watch(
        "scenegate_cache_misses_total",
        "Number of cache misses, by cache.",
        lambda: {name: cache.misses for name, cache in caches.figures().items()},
        label="cache",
    )
    metrics.watch(
        "scenegate_cache_bytes",
        "Bytes held by the caches, approximately, by cache.",
        lambda: {name: cache.nbytes for name, cache in caches.figures().items()},
        label="cache",
    )
    metrics.watch(
        "scenegate_cache_limit_bytes",
        "Bytes that all caches together may hold (--cache-bytes).",
        lambda: caches.max_bytes,
    )


def watch_tree(metrics: Metrics, tree: LiveTree) -> None:
    metrics.watch("scenegate_tree_revision", "Number of edits of the live scene.", lambda: tree.snapshot.revision)
    metrics.watch("scenegate_tree_nodes", "Number of nodes in the live scene.", lambda: tree.snapshot.root.node_count)
    metrics.watch(
        "scenegate_tree_geometry_nodes",
        "Number of nodes with geometry in the live scene.",
        lambda: tree.snapshot.root.nodes_with_parts,
    )


def watch_history(metrics: Metrics, history: TreeHistory) -> None:
    metrics.watch(
        "scenegate_history_bytes", "Bytes of earlier states of the live scene, approximately.", lambda: history.nbytes
    )
    metrics.watch(
        "scenegate_history_duration_seconds",
        "Seconds from the oldest state that is kept until now.",
        lambda: (history.span[1] - history.span[0]) / 1e9,
    )


def watch_render(metrics: Metrics, service: RenderService) -> None:
    metrics.watch(
        "scenegate_render_body_bytes",
        "Bytes of render request bodies that are being received, wait or are rendered.",
        lambda: service.inflight_bytes,
    )


def watch_stereo(metrics: Metrics, cameras: list[StereoService]) -> None:
    """Sums over all cameras."""
    metrics.watch(
        "scenegate_stereo_streams", "Number of open gRPC image streams.", lambda: sum(len(each.hub) for each in cameras)
    )
    metrics.watch(
        "scenegate_stereo_sets_sent_total",
        "Number of image sets sent, summed over all clients.",
        lambda: sum(each.hub.sent for each in cameras),
    )
    metrics.watch(
        "scenegate_stereo_sets_skipped_total",
        "Number of image sets not sent because a set of a later frame was there, as with a client that reads slowly, "
        "summed over all clients.",
        lambda: sum(each.hub.skipped for each in cameras),
    )
    metrics.watch(
        "scenegate_stereo_frames_total",
        "Number of frames taken, by kind: camera (left and right) or depth.",
        lambda: {
            "camera": sum(each.counts.frames for each in cameras),
            "depth": sum(each.counts.depth_frames for each in cameras),
        },
        label="kind",
    )
    metrics.watch(
        "scenegate_stereo_skipped_total",
        "Number of frames that were due and not taken, by reason: in_work (late, or too many frames unfinished) or "
        "busy (the queue is full).",
        lambda: {
            "in_work": sum(each.counts.skipped for each in cameras),
            "busy": sum(each.counts.dropped for each in cameras),
        },
        label="reason",
    )
    metrics.watch(
        "scenegate_stereo_depth_duration_seconds",
        "Seconds from exposure to publication of the latest depth frame; the maximum over all cameras.",
        lambda: max(each.counts.depth_seconds for each in cameras),
    )


def watch_tree_viewer(metrics: Metrics, service: TreeViewerService) -> None:
    def transport_figure(transport: str, name: str) -> float:
        """Return a figure of a transport; 0 if the transport is off or has no such figure."""
        figures = service.status().get(transport)
        return float(figures.get(name, 0)) if isinstance(figures, Mapping) else 0.0

    metrics.watch(
        "scenegate_lcm_messages_total",
        "Number of tree viewer messages, by what: requests received, responses sent (answered), responses "
        "that report missing paths (missing) or an error (failed), responses that could not be sent "
        "(unanswerable), and internal_errors.",
        lambda: {name: service.status()[name] for name in _MESSAGE_OUTCOMES},
        label="what",
    )
    metrics.watch(
        "scenegate_lcm_bytes_total",
        "Bytes of tree viewer requests received over LCM and TCPQ.",
        lambda: service.status()["received_bytes"],
    )
    metrics.watch(
        "scenegate_lcm_lost_total",
        "Number of tree viewer messages or datagrams lost, by reason: datagrams (dropped by the operating "
        "system), incomplete (a fragment is missing), refused (larger than the limit), waiting (queue full) "
        "or undecodable.",
        lambda: {
            "datagrams": transport_figure("lcm", "lost_datagrams"),
            "incomplete": transport_figure("lcm", "incomplete"),
            "refused": transport_figure("lcm", "refused"),
            "waiting": service.status()["dropped"] + transport_figure("lcm", "dropped"),
            "undecodable": service.status()["undecodable"],
        },
        label="reason",
    )
    metrics.watch(
        "scenegate_lcm_foreign_datagrams_total",
        "Number of LCM datagrams of other machines that were dropped, because ttl=0 stands for this machine alone.",
        lambda: transport_figure("lcm", "foreign_datagrams"),
    )
    metrics.watch(
        "scenegate_lcm_waiting_bytes",
        "Bytes of tree viewer requests received and not yet handled.",
        lambda: service.status()["waiting_bytes"],
    )
    metrics.watch(
        "scenegate_tree_geometry_bytes",
        "Bytes of geometry arrays that tree viewer clients have published into the live scene.",
        lambda: service.status()["geometry_bytes"],
    )
    metrics.watch(
        "scenegate_tcpq_clients",
        "Number of clients connected to the TCPQ hub.",
        lambda: transport_figure("tcpq", "clients"),
    )


def watch_view(metrics: Metrics, hub: ViewHub) -> None:
    metrics.watch(
        "scenegate_view_browsers",
        "Number of pages connected to the browser view's WebSocket.",
        lambda: hub.status()["browsers"],
    )
