"""Connects the browser view to the interfaces that it shows; content of the page's status bar."""

import asyncio
from dataclasses import replace
from typing import Any

from gateway.adapters.viewer.config import ViewerConfig
from gateway.adapters.viewer.hub import ViewHub
from gateway.adapters.viewer.image_routes import image_router
from gateway.adapters.viewer.light import encode_light
from gateway.adapters.viewer.messages import Fact, InterfaceState, Status
from gateway.adapters.viewer.routes import router
from gateway.adapters.viewer.scene_images import SceneImages
from gateway.adapters.viewer.sensor_images import SensorImages
from gateway.replay.share_routes import share_router
from gateway.runtime.http.interface_names import documentation_of, title_of
from gateway.runtime.service_registry import ServiceRegistry
from gateway.runtime.workers.worker_pool import PoolStats
from gateway.wiring import metrics
from gateway.wiring.context import Context, Provided


async def setup(context: Context, provided: Provided) -> Provided:
    """Add ``/view`` to the application."""
    config = ViewerConfig(style=replace(context.style, look="auto", samples=0))
    await asyncio.to_thread(encode_light, config.style.rig)  # kept for the pages: an environment map takes seconds
    stereo = provided.stereo.sensor if provided.stereo is not None else None
    hub = ViewHub(
        config,
        context.tree,
        status=lambda: gateway_status(context.registry, context.workers.stats),
        stereo=stereo,
        renders=provided.recent_renders,
        live_page=context.page,
        timeline=context.timeline,
        has_live=context.log is None,
    )
    images = SceneImages(config, context.live_scene(provided), context.renderer, context.workers)
    sensor = SensorImages(stereo.capture, config.capture_seconds) if stereo is not None else None
    metrics.watch_view(context.metrics, hub)
    context.app.include_router(router(hub))
    context.app.include_router(image_router(images, sensor, provided.recent_renders))
    context.app.include_router(share_router(context.tree, context.page, context.timeline, rig=config.style.rig))
    context.run_service("view", hub, where="/view")
    if context.log is not None:
        context.run_service("log", context.log, where=str(context.log.timeline.path))
    return provided


def gateway_status(registry: ServiceRegistry, workers: PoolStats) -> Status:
    """Return the interfaces' states, the time of Drake's simulation, the queue, lost messages and streams."""
    details: dict[str, dict[str, Any]] = {name: entry.describe() for name, entry in registry.entries.items()}
    interfaces = {
        name: InterfaceState(
            state=described["state"],
            title=title_of(name),
            documentation=documentation_of(name),
            problem=described.get("problem", ""),
            warnings=described.get("warnings", []),
        )
        for name, described in details.items()
    }
    facts: list[Fact] = []
    seconds = details.get("drakeviewer", {}).get("simulation_seconds")
    if seconds is not None:
        facts.append(Fact(name="simulation", value=f"{seconds:.2f} s"))
    indexed = details.get("log", {}).get("indexed", 1.0)
    if indexed < 1.0:
        facts.append(Fact(name="indexed", value=f"{100 * indexed:.0f} %"))
    facts.append(Fact(name="queue", value=workers.waiting, warn=workers.rejected > 0))
    lcm = details.get("treeviewer", {}).get("lcm")
    if isinstance(lcm, dict) and "dropped" in lcm:  # by a full queue, and by the kernel
        lost = lcm["dropped"] + lcm.get("lost_datagrams", 0)
        facts.append(Fact(name="lost LCM", value=lost, warn=lost > 0))
    clients = details.get("stereo", {}).get("clients")
    if clients is not None:
        facts.append(Fact(name="streams", value=clients))
    return Status(interfaces=interfaces, facts=facts)
