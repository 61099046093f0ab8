"""Drake's render endpoint, ``POST /render``."""

from collections.abc import Callable
from dataclasses import replace

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.routes import render_router
from gateway.adapters.render.service import RenderService
from gateway.files.gltf import GltfLimits
from gateway.runtime.settings import MIB, Settings
from gateway.scene.draw.style import Style
from gateway.scene.tree.nodes import Node
from gateway.wiring import metrics
from gateway.wiring.context import Context, Provided
from gateway.wiring.scene_setting import read_scene_setting


async def setup(context: Context, provided: Provided) -> Provided:
    """Add the render endpoint."""

    config = _config(context.settings, context.style)
    if not context.settings.is_enabled("view"):
        config = replace(config, recent_count=0)
    service = RenderService(
        context.renderer, context.workers, config, backdrop=await _backdrop(context), metrics=context.metrics
    )
    context.app.router.routes[:0] = render_router(service).routes  # found before all others
    metrics.watch_render(context.metrics, service)
    context.registry.ready("render", where=context.settings.render_path, figures=service.status)
    return replace(provided, recent_renders=service.recent)


def _config(settings: Settings, style: Style) -> RenderConfig:
    default = GltfLimits()
    return RenderConfig(
        path=settings.render_path,
        style=style,
        depth_format=settings.depth_format,
        max_body_bytes=settings.max_body_mb * MIB,
        max_inflight_bytes=settings.queue_mb * MIB,
        max_pixels=settings.max_pixels,
        gltf=replace(
            default,
            max_nodes=settings.max_nodes,
            max_elements=min(default.max_elements, settings.max_triangles),
            max_drawn_elements=settings.max_triangles,
            max_image_pixels=settings.max_image_pixels,
        ),
        strict=settings.strict,
        keep_failures=settings.keep_failures,
    )


async def _backdrop(context: Context) -> Callable[[], Node] | None:
    """Return a function that returns the root of ``--backdrop``, or None without that setting."""
    settings = context.settings
    if settings.backdrop is None:
        return None
    if settings.backdrop == "live":
        return lambda: context.tree.snapshot.root
    scene = await read_scene_setting(settings.backdrop, settings)
    context.registry.warn("render", settings.backdrop, *scene.warnings)
    return lambda: scene.root
