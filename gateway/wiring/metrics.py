"""Which figures of which room Prometheus sees. Names and units: docs/deployment.md."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from gateway import __version__
from gateway.runtime.metrics_registry import Metrics
from gateway.runtime.service_registry import ServiceRegistry, State
from gateway.runtime.worker_pool import WorkerPool
from gateway.scene.live import LiveTree
from renderers.cache import Cache

if TYPE_CHECKING:
    from gateway.render.events import RenderRecord
    from gateway.render.service import RenderService
    from gateway.stereo.service import StereoService
    from gateway.treeviewer.service import TreeViewerService
    from gateway.viewer.hub import ViewHub

BUSY: Final = "busy"
"""Outcome of renders that there was no place for."""
_OUTCOMES: Final[Mapping[int, str]] = {200: "ok", 499: "gone", 500: "failed", 503: BUSY}
"""By status; every other one is a rejected request."""


def watch_process(metrics: Metrics, registry: ServiceRegistry, workers: WorkerPool) -> None:
    """Metrics of every gateway: its version, its interfaces and the worker threads."""
    metrics.gauge(
        "scenegate_build_info",
        "Always 1; the label version is the version of this gateway.",
        lambda: {__version__: 1.0},
        label="version",
    )
    metrics.gauge(
        "scenegate_interface_ready",
        "1 while an interface can be used, else 0, by interface.",
        lambda: _ready(registry),
        label="interface",
    )
    metrics.gauge("scenegate_render_threads", "Worker threads that render and decode.", lambda: workers.threads)
    metrics.gauge("scenegate_render_running", "Calls that worker threads execute now.", lambda: workers.stats.running)
    metrics.gauge(
        "scenegate_render_slow",
        "Calls that have run in worker threads for more than half of --render-seconds.",
        lambda: workers.stats.slow,
    )
    metrics.gauge(
        "scenegate_render_waiting", "Calls that wait for a free worker thread.", lambda: workers.stats.waiting
    )
    metrics.gauge(
        "scenegate_render_waiting_limit",
        "Maximum number of calls that may wait for a worker thread (--queue).",
        lambda: workers.max_waiting,
    )
    metrics.gauge(
        "scenegate_render_waiting_bytes",
        "Bytes of the request bodies of all calls that wait for a worker thread.",
        lambda: workers.stats.waiting_bytes,
    )
    metrics.counter(
        "scenegate_calls_total",
        "Calls given to the worker threads, by end: done (returned or failed), rejected (the queue was full), "
        "abandoned (the caller disconnected before the result) or timed_out (ended at --render-seconds).",
        lambda: _calls(workers),
        label="end",
    )


def watch_tree(metrics: Metrics, tree: LiveTree) -> None:
    """Metrics of the live scene."""
    metrics.gauge("scenegate_tree_revision", "Edits of the live scene since start.", lambda: tree.snapshot.revision)
    metrics.gauge("scenegate_tree_nodes", "Nodes of the live scene.", lambda: tree.snapshot.root.node_count)
    metrics.gauge(
        "scenegate_tree_geometry_nodes",
        "Nodes of the live scene that have geometry.",
        lambda: tree.snapshot.root.geometry_count,
    )


def watch_render(metrics: Metrics, service: RenderService) -> None:
    """Metrics of the render endpoint's caches; ``count_render`` counts its requests."""
    store = service.scenes
    caches: dict[str, Cache[Any, Any]] = {
        "scenes": store.scenes,
        "documents": store.geometry.documents.cache,
        "content": store.geometry.content,
    }

    metrics.counter(
        "scenegate_cache_hits_total",
        "Look-ups of the render endpoint that a cache answered, by cache.",
        lambda: {name: cache.hits for name, cache in caches.items()},
        label="cache",
    )
    metrics.counter(
        "scenegate_cache_misses_total",
        "Look-ups of the render endpoint that a cache did not answer, by cache.",
        lambda: {name: cache.misses for name, cache in caches.items()},
        label="cache",
    )
    metrics.gauge(
        "scenegate_cache_bytes",
        "Bytes that the caches of the render endpoint hold, approximately, by cache.",
        lambda: {name: cache.nbytes for name, cache in caches.items()},
        label="cache",
    )
    metrics.gauge(
        "scenegate_render_body_bytes",
        "Bytes of render request bodies that are being received, wait or are rendered.",
        lambda: service.inflight_bytes,
    )


def count_render(metrics: Metrics, record: RenderRecord) -> None:
    """One answered request of the render endpoint."""
    kind = record.request.image_type if record.request is not None else "unknown"
    stages = (("queue", record.queue_seconds), *record.image.stages) if record.image is not None else ()
    metrics.count_render(kind, record.outcome or _OUTCOMES.get(record.status, "rejected"), stages)


def watch_stereo(metrics: Metrics, *services: StereoService) -> None:
    """Metrics of all stereo cameras together."""
    hubs, counts = [s.hub for s in services], [s.counts for s in services]
    metrics.gauge(
        "scenegate_stereo_streams", "Open gRPC image streams of the stereo cameras.", lambda: sum(map(len, hubs))
    )
    metrics.counter(
        "scenegate_stereo_sets_sent_total",
        "Stereo image sets sent, summed over all clients.",
        lambda: sum(h.sent for h in hubs),
    )
    metrics.counter(
        "scenegate_stereo_sets_skipped_total",
        "Stereo image sets that a newer one replaced because a client read too slowly, summed over all clients.",
        lambda: sum(h.skipped for h in hubs),
    )
    metrics.counter(
        "scenegate_stereo_frames_total",
        "Frames that the stereo cameras took, by kind: camera (left and right) or depth.",
        lambda: {"camera": sum(c.frames for c in counts), "depth": sum(c.depth_frames for c in counts)},
        label="kind",
    )
    metrics.counter(
        "scenegate_stereo_frames_missed_total",
        "Stereo frames that were due and not taken, by reason: in_work (too many frames unfinished) or busy (no free "
        "worker thread).",
        lambda: {"in_work": sum(c.skipped for c in counts), "busy": sum(c.busy for c in counts)},
        label="reason",
    )
    metrics.gauge(
        "scenegate_stereo_depth_duration_seconds",
        "Seconds from exposure to publication of the last stereo depth frame; of several cameras the longest.",
        lambda: max(c.depth_seconds for c in counts),
    )


def watch_treeviewer(metrics: Metrics, service: TreeViewerService) -> None:
    """Metrics of the tree viewer: its messages, and those that were lost."""
    answers = ("received", "answered", "missing", "failed", "unanswerable", "internal_errors")
    metrics.counter(
        "scenegate_lcm_messages_total",
        "Tree viewer messages, by what: requests received, answers sent (answered), those of them that report missing "
        "paths (missing) or an error (failed), answers that could not be sent (unanswerable), and internal_errors.",
        lambda: _some(service.status(), answers),
        label="what",
    )
    metrics.counter(
        "scenegate_lcm_bytes_total",
        "Bytes of tree viewer requests received over LCM and TCPQ.",
        lambda: float(service.status()["received_bytes"]),
    )
    metrics.counter(
        "scenegate_lcm_lost_total",
        "Tree viewer messages or datagrams lost, by reason: datagrams (dropped by the operating system), incomplete (a "
        "fragment is missing), refused (larger than the limit), waiting (too many unhandled) or undecodable.",
        lambda: _lost(service.status()),
        label="reason",
    )
    metrics.gauge(
        "scenegate_lcm_waiting_bytes",
        "Bytes of tree viewer requests received and not yet handled.",
        lambda: float(service.status()["waiting_bytes"]),
    )
    metrics.gauge(
        "scenegate_tree_geometry_bytes",
        "Bytes of the geometry arrays that tree viewer clients have published and the live scene holds.",
        lambda: float(service.status()["geometry_bytes"]),
    )
    metrics.gauge(
        "scenegate_tcpq_clients",
        "Clients connected to the TCPQ hub.",
        lambda: float(_part(service.status(), "tcpq", "clients")),
    )


def watch_view(metrics: Metrics, hub: ViewHub) -> None:
    """Metrics of the browser view."""
    metrics.gauge(
        "scenegate_view_browsers",
        "Browser pages connected to the view's WebSocket.",
        lambda: float(hub.status()["browsers"]),
    )


def _ready(registry: ServiceRegistry) -> dict[str, float]:
    return {name: float(entry.current() is State.READY) for name, entry in registry.entries.items()}


def _calls(workers: WorkerPool) -> dict[str, float]:
    stats = workers.stats
    return {
        "done": stats.done,
        "rejected": stats.rejected,
        "abandoned": stats.abandoned,
        "timed_out": stats.timed_out,
    }


def _some(status: Mapping[str, Any], names: tuple[str, ...]) -> dict[str, float]:
    return {name: float(status[name]) for name in names}


def _lost(status: Mapping[str, Any]) -> dict[str, float]:
    """By reason: the system dropped datagrams (rmem_max), a message's datagrams did not all come, too much waited,
    it was no viewer2_comms_t."""
    return {
        "datagrams": float(_part(status, "lcm", "lost_datagrams")),
        "incomplete": float(_part(status, "lcm", "incomplete")),
        "refused": float(_part(status, "lcm", "refused")),
        "waiting": float(status["dropped"]) + float(_part(status, "lcm", "dropped")),
        "undecodable": float(status["undecodable"]),
    }


def _part(status: Mapping[str, Any], transport: str, name: str) -> Any:
    """A transport's figure; 0 where there is no such transport or it counts no such thing."""
    described = status.get(transport)
    return described.get(name, 0) if isinstance(described, Mapping) else 0
