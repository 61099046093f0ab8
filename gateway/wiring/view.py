"""The join of the browser view with everything that it shows."""

from __future__ import annotations

from typing import Any

from gateway.assets.light_rig_file import rig_of
from gateway.render.events import RenderRecord
from gateway.viewer.config import ViewerConfig
from gateway.viewer.hub import ViewHub
from gateway.viewer.image_routes import picture_router
from gateway.viewer.routes import router
from gateway.viewer.scene_images import Pictures
from gateway.viewer.sensor import SensorView
from gateway.viewer.sources import RenderNote, ViewPorts
from gateway.wiring.context import Context
from gateway.wiring.metrics import watch_view


def setup(context: Context) -> None:
    """``/view``."""
    config = ViewerConfig(background=context.settings.background, rig=rig_of(context.settings.rig))
    eyes = context.stereo_sensor
    ports = ViewPorts(
        status=lambda: status_of(context),
        rig=eyes.rig if eyes is not None else lambda snapshot: None,
        sensor=eyes.look if eyes is not None else None,
    )
    hub = ViewHub(config, context.tree, ports)
    pictures = Pictures(
        config, context.tree, context.flattener, context.renderer, context.workers, lambda: context.stereo_camera()
    )
    sensor = SensorView(ports.sensor, config.sensor_seconds) if ports.sensor is not None else None
    context.on_render = lambda record: hub.renders.add(note_of(record))
    watch_view(context.metrics, hub)
    context.app.include_router(router(hub))
    context.app.include_router(picture_router(pictures, sensor, hub.renders))
    context.run_service("view", hub, where="/view")


def status_of(context: Context) -> dict[str, Any]:
    """For the status bar: which interfaces are up, and what users of them should know."""
    interfaces: dict[str, dict[str, str]] = {}
    figures: dict[str, dict[str, Any]] = {}
    for name, entry in context.services.entries.items():
        described = entry.describe()
        problem = described.get("problem") or described.get("warning")
        interfaces[name] = {"state": described["state"], **({"problem": str(problem)} if problem else {})}
        figures[name] = described
    stats = context.workers.stats
    facts: list[dict[str, Any]] = [{"name": "queue", "value": stats.waiting, "warn": stats.rejected > 0}]
    lost = lost_messages(figures.get("treeviewer", {}))
    if lost is not None:
        facts.append({"name": "lost LCM", "value": lost, "warn": lost > 0})
    clients = figures.get("stereo", {}).get("clients")
    if clients is not None:
        facts.append({"name": "streams", "value": clients})
    return {"interfaces": interfaces, "facts": facts}


def lost_messages(treeviewer: dict[str, Any]) -> int | None:
    """Datagrams that the kernel dropped and messages that did not fit the waiting room; None: there is no LCM."""
    lcm = treeviewer.get("lcm")
    if not isinstance(lcm, dict) or "dropped" not in lcm:
        return None
    return int(lcm["dropped"]) + int(lcm.get("lost_datagrams", 0))


def note_of(record: RenderRecord) -> RenderNote:
    """A render request for the list of the view; the scene itself is let go."""
    request, picture = record.request, record.picture
    what, scene = "not understood", ""
    if request is not None:
        what = f"{request.image_type}, {request.width} × {request.height}"
        size = len(request.scene)
        scene = f"scene of {size / 1e6:.1f} MB" if size >= 1e6 else f"scene of {size / 1e3:.1f} kB"
    if picture is not None:
        by = f" by {picture.generator}" if picture.generator else ""
        scene = f"{scene}{by[:80]}, {picture.elements} elements"
    return RenderNote(
        status=record.status,
        seconds=record.seconds,
        queued=record.queued,
        what=what,
        scene=scene,
        kind=request.image_type if request is not None else "",
        body=picture.body if picture is not None else b"",
        media_type=picture.media_type if picture is not None else "",
        error=record.error,
    )
