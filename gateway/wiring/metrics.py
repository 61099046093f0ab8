"""The metrics that Prometheus reads from each interface. Names and units: docs/deployment.md.

Each has a name, a HELP text and a function that reads it when Prometheus scrapes: a number, or one number for each
value of the label. Names that end in ``_total`` are counters, all others gauges. The metrics of single requests are in
``gateway.runtime.metrics_registry``.
"""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any

from gateway import __version__
from gateway.runtime.metrics_registry import Metrics
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


def watch_process(metrics: Metrics, registry: ServiceRegistry, workers: WorkerPool) -> None:
    """Add the metrics of the process: version, state of the interfaces, worker threads."""

    def ready() -> dict[str, float]:
        return {name: float(entry.current() is State.READY) for name, entry in registry.entries.items()}

    def calls() -> dict[str, float]:
        ends = ("done", "rejected", "abandoned", "timed_out")
        return {end: float(getattr(workers.stats, end)) for end in ends}

    watch = metrics.watch
    watch(
        "scenegate_build_info",
        "Constant 1; the label version is the version of this gateway.",
        lambda: {__version__: 1.0},
        label="version",
    )
    watch(
        "scenegate_interface_ready",
        "1 if clients can use the interface, else 0, by interface.",
        ready,
        label="interface",
    )
    watch(
        "scenegate_workers_ready",
        "Number of processes (--workers) that are ready.",
        lambda: float(registry.verdict() == "ready"),
    )
    watch(
        "scenegate_render_threads",
        "Number of worker threads.",
        lambda: workers.threads,
    )
    watch(
        "scenegate_render_running",
        "Number of calls that worker threads execute.",
        lambda: workers.stats.running,
    )
    watch(
        "scenegate_render_slow",
        "Number of running calls that have taken more than half of --render-seconds.",
        lambda: workers.stats.slow,
    )
    watch(
        "scenegate_render_waiting",
        "Number of calls that wait for a worker thread.",
        lambda: workers.stats.waiting,
    )
    watch(
        "scenegate_render_waiting_limit",
        "Maximum number of calls that may wait for a worker thread (--queue).",
        lambda: workers.max_waiting,
    )
    watch(
        "scenegate_render_waiting_bytes",
        "Bytes of the request bodies of all calls that wait for a worker thread.",
        lambda: workers.stats.waiting_bytes,
    )
    watch(
        "scenegate_calls_total",
        "Number of calls given to worker threads, by end: done (returned or raised), rejected (queue full), "
        "abandoned (client disconnected) or timed_out (--render-seconds).",
        calls,
        label="end",
    )


def watch_caches(metrics: Metrics, caches: CacheBudget) -> None:
    """Add the metrics of the caches, which share one limit."""
    watch = metrics.watch
    watch(
        "scenegate_cache_hits_total",
        "Number of cache hits, by cache.",
        lambda: {name: cache.hits for name, cache in caches.figures().items()},
        label="cache",
    )
    watch(
        "scenegate_cache_misses_total",
        "Number of cache misses, by cache.",
        lambda: {name: cache.misses for name, cache in caches.figures().items()},
        label="cache",
    )
    watch(
        "scenegate_cache_bytes",
        "Bytes held by the caches, approximately, by cache.",
        lambda: {name: cache.nbytes for name, cache in caches.figures().items()},
        label="cache",
    )
    watch(
        "scenegate_cache_limit_bytes",
        "Bytes that all caches together may hold (--cache-bytes).",
        lambda: caches.max_bytes,
    )


def watch_tree(metrics: Metrics, tree: LiveTree) -> None:
    """Add the metrics of the live scene."""
    watch = metrics.watch
    watch(
        "scenegate_tree_revision",
        "Number of edits of the live scene.",
        lambda: tree.snapshot.revision,
    )
    watch(
        "scenegate_tree_nodes",
        "Number of nodes in the live scene.",
        lambda: tree.snapshot.root.node_count,
    )
    watch(
        "scenegate_tree_geometry_nodes",
        "Number of nodes with geometry in the live scene.",
        lambda: tree.snapshot.root.nodes_with_parts,
    )


def watch_history(metrics: Metrics, history: TreeHistory) -> None:
    """Add the metrics of the live scene's history."""

    def seconds() -> float:
        first, last = history.span
        return (last - first) / 1e9

    watch = metrics.watch
    watch(
        "scenegate_history_bytes", "Bytes of earlier states of the live scene, approximately.", lambda: history.nbytes
    )
    watch("scenegate_history_duration_seconds", "Seconds from the oldest state that is kept until now.", seconds)


def watch_render(metrics: Metrics, service: RenderService) -> None:
    """Add the metrics of the render endpoint."""
    watch = metrics.watch
    watch(
        "scenegate_render_body_bytes",
        "Bytes of render request bodies that are being received, wait or are rendered.",
        lambda: service.inflight_bytes,
    )


def watch_stereo(metrics: Metrics, *services: StereoService) -> None:
    """Add the metrics of the stereo cameras, summed over all of them."""
    hubs, counts = [s.hub for s in services], [s.counts for s in services]
    watch = metrics.watch
    watch(
        "scenegate_stereo_streams",
        "Number of open gRPC image streams.",
        lambda: sum(map(len, hubs)),
    )
    watch(
        "scenegate_stereo_sets_sent_total",
        "Number of image sets sent, summed over all clients.",
        lambda: sum(h.sent for h in hubs),
    )
    watch(
        "scenegate_stereo_sets_skipped_total",
        "Number of image sets not sent because the client read too slowly, summed over all clients.",
        lambda: sum(h.skipped for h in hubs),
    )
    watch(
        "scenegate_stereo_frames_total",
        "Number of frames taken, by kind: camera (left and right) or depth.",
        lambda: {"camera": sum(c.frames for c in counts), "depth": sum(c.depth_frames for c in counts)},
        label="kind",
    )
    watch(
        "scenegate_stereo_skipped_total",
        "Number of frames that were due and not taken, by reason: in_work (late, or too many frames unfinished) or "
        "busy (the queue is full).",
        lambda: {"in_work": sum(c.skipped for c in counts), "busy": sum(c.dropped for c in counts)},
        label="reason",
    )
    watch(
        "scenegate_stereo_depth_duration_seconds",
        "Seconds from exposure to publication of the latest depth frame; the maximum over all cameras.",
        lambda: max(c.depth_seconds for c in counts),
    )


def watch_treeviewer(metrics: Metrics, service: TreeViewerService) -> None:
    """Add the metrics of the tree viewer: messages received, responses, losses."""
    outcomes = ("received", "answered", "missing", "failed", "unanswerable", "internal_errors")

    def messages() -> dict[str, float]:
        status = service.status()
        return {outcome: float(status[outcome]) for outcome in outcomes}

    def lost() -> dict[str, float]:
        status = service.status()
        return {
            "datagrams": float(_transport_figure(status, "lcm", "lost_datagrams")),
            "incomplete": float(_transport_figure(status, "lcm", "incomplete")),
            "refused": float(_transport_figure(status, "lcm", "refused")),
            "waiting": float(status["dropped"]) + float(_transport_figure(status, "lcm", "dropped")),
            "undecodable": float(status["undecodable"]),
        }

    watch = metrics.watch
    watch(
        "scenegate_lcm_messages_total",
        "Number of tree viewer messages, by what: requests received, responses sent (answered), responses "
        "that report missing paths (missing) or an error (failed), responses that could not be sent "
        "(unanswerable), and internal_errors.",
        messages,
        label="what",
    )
    watch(
        "scenegate_lcm_bytes_total",
        "Bytes of tree viewer requests received over LCM and TCPQ.",
        lambda: float(service.status()["received_bytes"]),
    )
    watch(
        "scenegate_lcm_lost_total",
        "Number of tree viewer messages or datagrams lost, by reason: datagrams (dropped by the operating "
        "system), incomplete (a fragment is missing), refused (larger than the limit), waiting (queue full) "
        "or undecodable.",
        lost,
        label="reason",
    )
    watch(
        "scenegate_lcm_foreign_datagrams_total",
        "Number of LCM datagrams of other machines that were dropped, because ttl=0 stands for this machine alone.",
        lambda: float(_transport_figure(service.status(), "lcm", "foreign_datagrams")),
    )
    watch(
        "scenegate_lcm_waiting_bytes",
        "Bytes of tree viewer requests received and not yet handled.",
        lambda: float(service.status()["waiting_bytes"]),
    )
    watch(
        "scenegate_tree_geometry_bytes",
        "Bytes of geometry arrays that tree viewer clients have published into the live scene.",
        lambda: float(service.status()["geometry_bytes"]),
    )
    watch(
        "scenegate_tcpq_clients",
        "Number of clients connected to the TCPQ hub.",
        lambda: float(_transport_figure(service.status(), "tcpq", "clients")),
    )


def watch_view(metrics: Metrics, hub: ViewHub) -> None:
    """Add the metrics of the browser view."""
    watch = metrics.watch
    watch(
        "scenegate_view_browsers",
        "Number of pages connected to the browser view's WebSocket.",
        lambda: float(hub.status()["browsers"]),
    )


def _transport_figure(status: Mapping[str, Any], transport: str, name: str) -> Any:
    """Return a figure of a transport; 0 if the transport is off or has no such figure."""
    described = status.get(transport)
    return described.get(name, 0) if isinstance(described, Mapping) else 0
