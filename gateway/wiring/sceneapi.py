"""The live scene over HTTP: ``GET /scene``, ``/scene.glb`` and ``/scene/render``."""

from dataclasses import replace

from gateway.adapters.sceneapi.config import SceneApiConfig
from gateway.adapters.sceneapi.routes import router
from gateway.adapters.sceneapi.service import SceneApi
from gateway.wiring.context import Context, Provided


async def setup(context: Context, provided: Provided) -> Provided:
    """Add the scene's routes."""
    style = replace(context.style, look="auto", samples=0)
    config = SceneApiConfig(style=style, max_pixels=context.settings.max_pixels)
    service = SceneApi(context.live_scene(provided), context.renderer, context.workers, config)
    context.app.include_router(router(service))
    context.registry.ready("scene", where="/scene", figures=service.status)
    return provided
