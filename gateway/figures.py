"""Which figures of which room Prometheus sees. Names and units: docs/deployment.md."""

from __future__ import annotations

from collections.abc import Mapping
from typing import TYPE_CHECKING, Any, Final

from gateway import __version__
from gateway.ops.board import Board, State
from gateway.ops.metrics import Metrics
from gateway.scene.live import LiveTree
from gateway.workers import Workers

if TYPE_CHECKING:
    from gateway.render.records import RenderRecord
    from gateway.render.service import RenderService
    from gateway.stereo.service import StereoService
    from gateway.treeviewer.service import TreeViewerService
    from gateway.viewer.hub import ViewHub

BUSY: Final = "busy"
"""Outcome of renders that there was no place for."""
_OUTCOMES: Final[Mapping[int, str]] = {200: "ok", 499: "gone", 500: "failed", 503: BUSY}
"""By status; every other one is a rejected request."""


def watch_process(metrics: Metrics, board: Board, workers: Workers) -> None:
    """What every gateway has: its version, its interfaces and the threads that render."""
    metrics.watch("scenegate_build_info", "Always 1", lambda: {__version__: 1.0}, label="version")
    metrics.watch("scenegate_interface_ready", "1: it can be used", lambda: _ready(board), label="interface")
    metrics.watch("scenegate_render_threads", "Worker threads", lambda: workers.threads)
    metrics.watch("scenegate_render_running", "Calls that worker threads run", lambda: workers.stats.running)
    metrics.watch(
        "scenegate_render_slow",
        "Calls that have run in worker threads for more than half of --render-seconds",
        lambda: workers.stats.slow,
    )
    metrics.watch("scenegate_render_waiting", "Calls that wait for a worker thread", lambda: workers.stats.waiting)
    metrics.watch("scenegate_render_waiting_limit", "Calls that may wait (--queue)", lambda: workers.max_waiting)
    metrics.watch("scenegate_render_waiting_bytes", "Their request bodies", lambda: workers.stats.waiting_bytes)
    metrics.watch_total("scenegate_calls_total", "Calls of worker threads by end", lambda: _calls(workers), label="end")


def watch_tree(metrics: Metrics, tree: LiveTree) -> None:
    """The live scene."""
    metrics.watch("scenegate_tree_revision", "Edits since start", lambda: tree.snapshot.revision)
    metrics.watch("scenegate_tree_nodes", "Nodes of the live scene", lambda: tree.snapshot.root.node_count)
    metrics.watch("scenegate_tree_geometry_nodes", "Those with geometry", lambda: tree.snapshot.root.geometry_count)


def watch_render(metrics: Metrics, service: RenderService) -> None:
    """The render endpoint's caches; its requests come by ``count_render``."""

    def hits() -> dict[str, float]:
        stats = service.scenes.geometry
        return {
            "scenes": service.scenes.hits,
            "documents": stats.document_hits,
            "buffers": stats.buffer_hits,
            "meshes": stats.mesh_hits,
        }

    def misses() -> dict[str, float]:
        stats = service.scenes.geometry
        return {"scenes": service.scenes.misses, "buffers": stats.buffer_misses, "meshes": stats.mesh_misses}

    def nbytes() -> dict[str, float]:
        stats = service.scenes.geometry
        return {"scenes": service.scenes.nbytes, "geometry": stats.nbytes, "documents": stats.text_bytes}

    metrics.watch_total("scenegate_cache_hits_total", "What was found in a cache", hits, label="cache")
    metrics.watch_total("scenegate_cache_misses_total", "What had to be made", misses, label="cache")
    metrics.watch("scenegate_cache_bytes", "What the caches hold, about", nbytes, label="cache")
    metrics.watch("scenegate_render_body_bytes", "Bodies being received or rendered", lambda: service.inflight_bytes)


def count_render(metrics: Metrics, record: RenderRecord) -> None:
    """One answered request of the render endpoint."""
    kind = record.request.image_type if record.request is not None else "unknown"
    stages = (("queue", record.queued), *record.picture.stages) if record.picture is not None else ()
    metrics.rendered(kind, record.outcome or _OUTCOMES.get(record.status, "rejected"), stages)


def watch_stereo(metrics: Metrics, *services: StereoService) -> None:
    """The streams of all stereo cameras."""
    hubs, counts = [s.hub for s in services], [s.counts for s in services]
    metrics.watch("scenegate_stereo_streams", "Open streams", lambda: sum(map(len, hubs)))
    metrics.watch_total(
        "scenegate_stereo_sets_sent_total", "Image sets sent to all clients", lambda: sum(h.sent for h in hubs)
    )
    metrics.watch_total(
        "scenegate_stereo_sets_skipped_total",
        "Image sets that slow clients did not take",
        lambda: sum(h.skipped for h in hubs),
    )
    metrics.watch_total(
        "scenegate_stereo_frames_total",
        "Frames taken by kind",
        lambda: {"camera": sum(c.frames for c in counts), "depth": sum(c.depth_frames for c in counts)},
        label="kind",
    )
    metrics.watch_total(
        "scenegate_stereo_frames_missed_total",
        "Frames that were due, but too many were in work, or the threads had too much to do",
        lambda: {"in_work": sum(c.skipped for c in counts), "busy": sum(c.busy for c in counts)},
        label="reason",
    )
    metrics.watch(
        "scenegate_stereo_depth_seconds", "From taking to publishing", lambda: max(c.depth_seconds for c in counts)
    )


def watch_treeviewer(metrics: Metrics, service: TreeViewerService) -> None:
    """The tree viewer's messages, and those that were lost."""
    answers = ("received", "answered", "missing", "failed", "unanswerable", "internal_errors")
    metrics.watch_total(
        "scenegate_lcm_messages_total",
        "Requests received; answered, of them with missing paths or failed; answers that could not be sent",
        lambda: _some(service.status(), answers),
        label="what",
    )
    metrics.watch_total("scenegate_lcm_bytes_total", "Received", lambda: float(service.status()["received_bytes"]))
    metrics.watch_total("scenegate_lcm_lost_total", "Lost, by reason", lambda: _lost(service.status()), label="reason")
    metrics.watch("scenegate_lcm_waiting_bytes", "Not handled yet", lambda: float(service.status()["waiting_bytes"]))
    metrics.watch(
        "scenegate_tree_geometry_bytes",
        "Arrays of published geometry in use",
        lambda: float(service.status()["geometry_bytes"]),
    )
    metrics.watch(
        "scenegate_tcpq_clients", "Connections to the hub", lambda: float(_part(service.status(), "tcpq", "clients"))
    )


def watch_view(metrics: Metrics, hub: ViewHub) -> None:
    """The browser view."""
    metrics.watch("scenegate_view_browsers", "Browsers connected", lambda: float(hub.status()["browsers"]))


def _ready(board: Board) -> dict[str, float]:
    return {name: float(entry.current() is State.READY) for name, entry in board.entries.items()}


def _calls(workers: Workers) -> dict[str, float]:
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
