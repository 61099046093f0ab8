"""One small function a room: settings to its configuration, its routes or its service to the house.

Each imports its room itself: that loads compiled kernels, which must be cached before, and a room that cannot be
imported (a system library is missing) is a sentence on the board instead of the end of the process.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

from gateway.house import House
from gateway.scene.gltf import GltfLimits
from gateway.scene.scenefile import read_scene_file
from gateway.scene.tree import Node
from gateway.settings import MIB, InterfaceName, Settings


def join_render(house: House) -> None:
    """``POST /render``."""
    from gateway.render.config import RenderConfig
    from gateway.render.routes import router
    from gateway.render.service import RenderService

    settings = house.settings
    config = RenderConfig(
        path=settings.render_path,
        look=settings.look,
        background=settings.background,
        depth_format="png16" if settings.depth_format == "png" else "tiff32f",
        max_body_bytes=settings.max_body_mb * MIB,
        max_inflight_bytes=settings.queue_mb * MIB,
        max_pixels=settings.max_pixels,
        gltf=gltf_limits(settings),
        mesh_cache_bytes=settings.mesh_cache_mb * MIB,
        scene_cache_bytes=settings.scene_cache_mb * MIB,
        keep_failures=settings.keep_failures,
    )
    service = RenderService(house.renderer, house.workers, config, backdrop=_backdrop(house))
    house.app.include_router(router(service))
    house.board.ready("render", where=settings.render_path, figures=service.status)


def _backdrop(house: House) -> Callable[[], Node] | None:
    named = house.settings.backdrop
    if named is None:
        return None
    if named == "live":
        return lambda: house.tree.snapshot.root
    scene = read_scene_file(Path(named), up=house.settings.up)
    return lambda: scene.root


def gltf_limits(settings: Settings) -> GltfLimits:
    """Bounds of scenes that clients send."""
    default = GltfLimits()
    return replace(
        default,
        max_nodes=settings.max_nodes,
        max_elements=min(default.max_elements, settings.max_triangles),
        max_drawn_elements=settings.max_triangles,
        max_image_pixels=settings.max_image_pixels,
    )


JOINS: dict[InterfaceName, Callable[[House], None]] = {"render": join_render}
"""In the order of joining."""
