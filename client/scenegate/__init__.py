"""Scenegate's client: publish geometry and robots, receive a stereo camera's images, read datasets.

This package exports the names of the tree viewer's client, and imports their modules at first use. ``scenegate.camera``
receives images, ``scenegate.datasets`` reads datasets, ``scenegate.robots`` reads robot files, ``scenegate.lcm`` has
transports and logs of LCM, and ``scenegate.testing`` starts gateways for tests.
"""

from __future__ import annotations

from importlib import import_module
from typing import TYPE_CHECKING, Any, Final

if TYPE_CHECKING:
    from scenegate.messages.clicks import Click as Click
    from scenegate.messages.geometry import Box as Box
    from scenegate.messages.geometry import Capsule as Capsule
    from scenegate.messages.geometry import Cylinder as Cylinder
    from scenegate.messages.geometry import Ellipsoid as Ellipsoid
    from scenegate.messages.geometry import Geometry as Geometry
    from scenegate.messages.geometry import Line as Line
    from scenegate.messages.geometry import MeshGeometry as MeshGeometry
    from scenegate.messages.geometry import PlanarLidar as PlanarLidar
    from scenegate.messages.geometry import PointCloud as PointCloud
    from scenegate.messages.geometry import Sphere as Sphere
    from scenegate.messages.geometry import Transform as Transform
    from scenegate.messages.geometry import Triad as Triad
    from scenegate.messages.image_geometry import CameraFrustum as CameraFrustum
    from scenegate.messages.image_geometry import Heightmap as Heightmap
    from scenegate.messages.image_geometry import ImagePlane as ImagePlane
    from scenegate.messages.image_geometry import Text as Text
    from scenegate.messages.mesh_file import MeshFile as MeshFile
    from scenegate.tree.aio import AsyncTreeViewer as AsyncTreeViewer
    from scenegate.tree.answer import Answer as Answer
    from scenegate.tree.answer import TreeViewerError as TreeViewerError
    from scenegate.tree.node_handles import Batch as Batch
    from scenegate.tree.node_handles import NodeHandle as NodeHandle
    from scenegate.tree.node_handles import PublishedRobot as PublishedRobot
    from scenegate.tree.viewer import TreeViewer as TreeViewer

__version__: Final = "0.1.0"

_MODULES: Final = {
    "messages.clicks": ("Click",),
    "messages.geometry": (
        *("Box", "Capsule", "Cylinder", "Ellipsoid", "Geometry", "Line"),
        *("MeshGeometry", "PlanarLidar", "PointCloud", "Sphere", "Transform", "Triad"),
    ),
    "messages.image_geometry": ("CameraFrustum", "Heightmap", "ImagePlane", "Text"),
    "messages.mesh_file": ("MeshFile",),
    "tree.aio": ("AsyncTreeViewer",),
    "tree.answer": ("Answer", "TreeViewerError"),
    "tree.node_handles": ("Batch", "NodeHandle", "PublishedRobot"),
    "tree.viewer": ("TreeViewer",),
}
"""Exported names by module."""

__all__ = sorted(name for names in _MODULES.values() for name in names)


if not TYPE_CHECKING:  # type checkers would accept every name

    def __getattr__(name: str) -> Any:
        for module, names in _MODULES.items():
            if name in names:
                return getattr(import_module(f"scenegate.{module}"), name)
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")


def __dir__() -> list[str]:
    return sorted([*__all__, *(name for name in globals() if name.startswith("__"))])
