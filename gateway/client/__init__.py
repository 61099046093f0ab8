"""Python clients of Scenegate, for users' programs. They do not import the server.

``stream`` receives the images of a stereo camera, ``dataset`` reads rendered datasets, and ``tree`` publishes to a tree
viewer. This package exports the public names of ``tree``, and imports their modules at first use.
"""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from gateway.client.tree.aio import AsyncTreeViewer
    from gateway.client.tree.answer import Answer, TreeViewerError
    from gateway.client.tree.clicks import Click
    from gateway.client.tree.geometry import (
        Box,
        Capsule,
        Cylinder,
        Ellipsoid,
        Geometry,
        Line,
        Mesh,
        MeshFile,
        PlanarLidar,
        PointCloud,
        Sphere,
        Transform,
        Triad,
    )
    from gateway.client.tree.image_geometry import CameraFrustum, Heightmap, ImagePlane, Text
    from gateway.client.tree.nodes import Batch, Node
    from gateway.client.tree.robot import PublishedRobot
    from gateway.client.tree.viewer import TreeViewer

__all__ = [
    "Answer",
    "AsyncTreeViewer",
    "Batch",
    "Box",
    "CameraFrustum",
    "Capsule",
    "Click",
    "Cylinder",
    "Ellipsoid",
    "Geometry",
    "Heightmap",
    "ImagePlane",
    "Line",
    "Mesh",
    "MeshFile",
    "Node",
    "PlanarLidar",
    "PointCloud",
    "PublishedRobot",
    "Sphere",
    "Text",
    "Transform",
    "TreeViewer",
    "TreeViewerError",
    "Triad",
]


def __getattr__(name: str) -> Any:
    """Return a public name of ``tree``."""
    if name not in __all__:
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    from gateway.client.tree import aio, answer, clicks, geometry, image_geometry, nodes, robot, viewer

    for module in (viewer, geometry, image_geometry, robot, aio, clicks, nodes, answer):
        if hasattr(module, name):
            return getattr(module, name)
    raise AttributeError(name)
