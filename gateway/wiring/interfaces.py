"""One small function a room: settings to its configuration, its routes or its service to the house.

Each imports its room itself: that loads compiled kernels, which must be cached before, and a room that cannot be
imported (a system library is missing) is a sentence on the registry instead of the end of the process.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from gateway.settings import MIB, Settings
from gateway.settings.types import InterfaceName
from gateway.wiring import metrics
from gateway.wiring.context import House

if TYPE_CHECKING:
    from gateway.gltf import GltfLimits
    from gateway.render.events import RenderRecord
    from gateway.scene.tree import Node

Join = Callable[[House], None]


def join_render(house: House) -> None:
    """``POST /render``."""
    from gateway.render.config import RenderConfig
    from gateway.render.routes import router
    from gateway.render.service import RenderService

    settings = house.settings
    config = RenderConfig(
        path=settings.render_path,
        look=settings.look,
        samples=settings.samples,
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

    def done(record: RenderRecord) -> None:
        metrics.count_render(house.metrics, record)
        house.on_render(record)

    service = RenderService(house.renderer, house.workers, config, backdrop=_backdrop(house), on_finished=done)
    metrics.watch_render(house.metrics, service)
    house.app.include_router(router(service))
    house.registry.ready("render", where=settings.render_path, figures=service.status)


def _backdrop(house: House) -> Callable[[], Node] | None:
    named = house.settings.backdrop
    if named is None:
        return None
    if named == "live":
        return lambda: house.tree.snapshot.root
    from gateway.assets.scene_file import read_scene_file

    scene = read_scene_file(Path(named), up=house.settings.up)
    return lambda: scene.root


def gltf_limits(settings: Settings) -> GltfLimits:
    """Bounds of scenes that clients send."""
    from gateway.gltf import GltfLimits

    default = GltfLimits()
    return replace(
        default,
        max_nodes=settings.max_nodes,
        max_elements=min(default.max_elements, settings.max_triangles),
        max_drawn_elements=settings.max_triangles,
        max_image_pixels=settings.max_image_pixels,
    )


def join_scene(house: House) -> None:
    """``GET /scene``, ``/scene.glb``, ``/scene/render``."""
    from gateway.assets.light_rig_file import rig_of
    from gateway.sceneapi.config import SceneApiConfig
    from gateway.sceneapi.routes import router
    from gateway.sceneapi.service import SceneApi

    settings = house.settings
    service = SceneApi(
        house.tree,
        house.renderer,
        house.workers,
        SceneApiConfig(background=settings.background, max_pixels=settings.max_pixels, rig=rig_of(settings.rig)),
        labels=house.labels,
        flattener=house.flattener,
        stereo_camera=lambda: house.stereo_camera(),
    )
    house.app.include_router(router(service))
    house.registry.ready("scene", where="/scene", figures=service.status)


def join_treeviewer(house: House) -> None:
    """Director's tree viewer over LCM and TCPQ."""
    from gateway.assets.mesh_files import MeshFiles
    from gateway.lcm.config import LcmConfig
    from gateway.treeviewer.config import TreeViewerConfig
    from gateway.treeviewer.service import TreeViewerService

    settings = house.settings
    lcm = LcmConfig(url=settings.lcm_url, tcpq_host=house.security.tcpq_host, tcpq_port=settings.tcpq_port)
    durable = house.state.commits if house.state is not None else None
    service = TreeViewerService(TreeViewerConfig(lcm=lcm), house.tree, MeshFiles(settings.mesh_root), durable=durable)
    metrics.watch_treeviewer(house.metrics, service)
    where = settings.lcm_url or "LCM"
    house.serve("treeviewer", service, where="TCPQ" if where == "off" and settings.tcpq_port is not None else where)


def join_stereo(house: House) -> None:
    """The stereo camera's image stream over gRPC and the device's REST interface."""
    from gateway.wiring.stereo import join_stereo as join

    join(house)


def join_view(house: House) -> None:
    """The browser view."""
    from gateway.wiring.view import join_view as join

    join(house)


def join_demo(house: House) -> None:
    """The moving demo scene in the live tree."""
    from gateway.wiring.demo import DemoRun

    house.serve("demo", DemoRun(house.tree))


JOINS: dict[InterfaceName, Join] = {
    "render": join_render,
    "scene": join_scene,
    "treeviewer": join_treeviewer,
    "stereo": join_stereo,
    "view": join_view,
}
"""In the order of joining; the view shows what the others have left in the house."""
