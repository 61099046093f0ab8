"""Small scenes and cameras for the rasterizer's tests."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from renderers.camera import Camera
from renderers.drawlist import DrawList, Instance, Material, Mesh
from renderers.interface import Frame


def camera(width: int = 97, height: int = 71, **changes: Any) -> Camera:
    """At the origin, looking along +Z; odd sizes, principal point off the middle, fx != fy."""
    values: dict[str, Any] = {
        "width": width,
        "height": height,
        "fx": 0.9 * width,
        "fy": 0.95 * width,
        "cx": 0.48 * width,
        "cy": 0.53 * height,
        "near": 0.1,
        "far": 10.0,
        "X_world_camera": np.eye(4),
    }
    return Camera(**{**values, **changes})


def images(frame: Frame) -> dict[str, NDArray[Any]]:
    """The frame's images by name, without those that were not rendered."""
    names = ("color", "depth", "label", "instance", "normal")
    return {name: getattr(frame, name) for name in names if getattr(frame, name) is not None}


def mesh(positions: Any, elements: Any, normals: Any = None) -> Mesh:
    """A mesh from nested lists or arrays."""
    return Mesh(
        np.ascontiguousarray(positions, dtype=np.float32),
        np.ascontiguousarray(elements, dtype=np.uint32),
        None if normals is None else np.ascontiguousarray(normals, dtype=np.float32),
    )


def draw_list(*meshes: Mesh | Instance, **material: Any) -> DrawList:
    """One instance per mesh, labels and instance ids in order from 1 and 100."""
    return DrawList(
        tuple(
            m
            if isinstance(m, Instance)
            else Instance(m, Material(**material), np.eye(4), label=1 + i, instance_id=100 + i)
            for i, m in enumerate(meshes)
        )
    )


def pose(rng: np.random.Generator, *, z: float = 0.0, scale: float = 1.0) -> NDArray[np.float64]:
    """A random rotation, mirrored half of the time, at (0, 0, z)."""
    q, _ = np.linalg.qr(rng.normal(size=(3, 3)))
    X = np.eye(4)
    X[:3, :3] = q * scale
    X[2, 3] = z
    return X


def soup(rng: np.random.Generator, count: int, *, size: float, low: Any, high: Any) -> Mesh:
    """Triangles around random centres in a box."""
    centres = rng.uniform(low, high, size=(count, 1, 3))
    corners = centres + rng.normal(scale=size, size=(count, 3, 3))
    return mesh(corners.reshape(-1, 3), np.arange(3 * count).reshape(-1, 3))


def sphere(columns: int, rows: int, radius: float = 1.0, *, smooth: bool = True) -> Mesh:
    """Around the origin, counter-clockwise seen from outside, with shared vertices and exact normals."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, columns + 1), np.linspace(0, np.pi, rows + 1))
    normals = np.stack((np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)), axis=-1).reshape(-1, 3)
    a = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    below = a + columns + 1
    elements = np.concatenate((np.stack((a, below, a + 1), 1), np.stack((a + 1, below, below + 1), 1)))
    return mesh(radius * normals, elements, normals if smooth else None)


def grid(columns: int, rows: int, corners: Any) -> Mesh:
    """A quadrilateral (4, 3) cut into columns x rows cells of two triangles."""
    (a, b, c, d) = np.asarray(corners, dtype=np.float64)
    s, t = np.meshgrid(np.linspace(0, 1, columns + 1), np.linspace(0, 1, rows + 1))
    s, t = s[..., None], t[..., None]
    points = (1 - s) * (1 - t) * a + s * (1 - t) * b + s * t * c + (1 - s) * t * d
    k = (np.arange(rows)[:, None] * (columns + 1) + np.arange(columns)).ravel()
    below = k + columns + 1
    return mesh(
        points.reshape(-1, 3), np.concatenate((np.stack((k, k + 1, below), 1), np.stack((k + 1, below + 1, below), 1)))
    )
