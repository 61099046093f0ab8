"""Connects the browser view to the interfaces that it shows."""

import asyncio
from dataclasses import replace

from gateway.adapters.viewer.config import ViewerConfig
from gateway.adapters.viewer.gateway_status import gateway_status
from gateway.adapters.viewer.hub import ViewHub
from gateway.adapters.viewer.image_routes import image_router
from gateway.adapters.viewer.light import encode_light
from gateway.adapters.viewer.routes import router
from gateway.adapters.viewer.scene_images import SceneImages
from gateway.adapters.viewer.sensor_images import SensorImages
from gateway.replay.share_routes import share_router
from gateway.wiring import metrics
from gateway.wiring.context import Context
from gateway.wiring.provided import Provided


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
