"""Geometry and materials of the demo scene, with procedural meshes and textures, and its poses over time."""

import math
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.draw.image_meshes import rectangle
from gateway.scene.tree.geometry import Line, Part, PointCloud, Shape, Surface
from gateway.scene.tree.nodes import Path, Pose
from gateway.scene.tree.transforms import Matrix, from_pose, translation
from renderers import primitives
from renderers.drawlist import AlphaMode, Image, Material, Mesh, Texture
from renderers.tubes import tube
from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere, Triad


@cache
def scene_parts() -> dict[Path, tuple[Part, ...]]:
    """Return the parts of each node by its path below the demo's root. Every call returns the same objects."""
    return {
        ("floor",): (Part(Surface(tile(3.0, 6)), _textured(_checker())),),
        ("table",): _table(),
        **_robot(),
        **_tabletop_objects(),
        **_drone(),
        **_scanner(),
    }


def _material(color: str, *, roughness: float = 0.5, metallic: float = 0.0, alpha: float = 1.0) -> Material:
    """Return a material with an sRGB colour (``rrggbb``)."""
    r, g, b = (int(color[k : k + 2], 16) / 255.0 for k in (0, 2, 4))
    return Material(
        base_color=(r**2.2, g**2.2, b**2.2, alpha),
        metallic=metallic,
        roughness=roughness,
        alpha_mode=AlphaMode.OPAQUE if alpha == 1.0 else AlphaMode.BLEND,
        double_sided=True,
    )


def _textured(image: Image, roughness: float = 0.6) -> Material:
    return Material(base_color_texture=Texture(image), metallic=0.0, roughness=roughness, double_sided=True)


def _at(x: float, y: float, z: float, shape: Shape, material: Material) -> Part:
    return Part(shape, material, translation(x, y, z))


def _table() -> tuple[Part, ...]:
    steel = _material("aab4c0", roughness=0.35, metallic=0.3)
    top = Part(Surface(textured_box(1.5, 1.1, 0.04)), _textured(_wood(), 0.45), translation(0.0, 0.0, 0.73))
    legs = [_at(x, y, 0.355, Cylinder(0.03, 0.71), steel) for x in (-0.68, 0.68) for y in (-0.48, 0.48)]
    return (top, *legs)


def _robot() -> dict[Path, tuple[Part, ...]]:
    shell, joint = _material("ffa531", roughness=0.3), _material("4b5563", roughness=0.35)
    metal = _material("dfe6ec", roughness=0.3, metallic=0.5)
    sideways = from_pose((0.0, 0.0, 0.0), (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0))

    def joint_hub(radius: float, length: float) -> Part:
        return Part(Cylinder(radius, length), joint, sideways)

    turret: Path = ("robot", "turret")
    upper_arm: Path = (*turret, "upper arm")
    forearm: Path = (*upper_arm, "forearm")
    wrist: Path = (*forearm, "wrist")
    finger = (_at(0.0, 0.0, 0.04, Box((0.03, 0.012, 0.09)), joint),)
    return {
        ("robot",): (
            _at(0.0, 0.0, 0.015, Cylinder(0.15, 0.03), joint),
            _at(0.0, 0.0, 0.07, Cylinder(0.11, 0.1), shell),
        ),
        turret: (_at(0.0, 0.0, 0.05, Cylinder(0.10, 0.1), shell),),
        upper_arm: (joint_hub(0.085, 0.18), _at(0.0, 0.0, 0.20, Capsule(0.06, 0.34), shell)),
        forearm: (joint_hub(0.07, 0.15), _at(0.0, 0.0, 0.18, Capsule(0.045, 0.30), shell)),
        wrist: (
            joint_hub(0.05, 0.11),
            _at(0.0, 0.0, 0.06, Cylinder(0.035, 0.06), metal),
            _at(0.0, 0.0, 0.095, Box((0.06, 0.14, 0.02)), joint),
        ),
        (*wrist, "left finger"): finger,
        (*wrist, "right finger"): finger,
        (*wrist, "tool frame"): (Part(Triad(0.12, tube=True), joint, translation(0.0, 0.0, 0.19)),),
    }


def _tabletop_objects() -> dict[Path, tuple[Part, ...]]:
    plate = _material("5fb0e0", roughness=0.3)
    return {
        ("turntable",): (
            _at(0.0, 0.0, 0.0, Cylinder(0.18, 0.02), plate),
            Part(Surface(textured_box(0.12, 0.12, 0.12)), _textured(_target(), 0.5), translation(0.07, 0.0, 0.07)),
            _at(-0.08, 0.05, 0.08, Cylinder(0.04, 0.14), _material("f0545a", roughness=0.3)),
            _at(-0.06, -0.08, 0.05, Ellipsoid((0.05, 0.035, 0.04)), _material("9bd67f", roughness=0.4)),
        ),
        ("crystal ball",): (
            Part(Sphere(0.11), _material("9ad1ff", roughness=0.05, alpha=0.35)),
            Part(Surface(knot()), _material("ffd166", roughness=0.25, metallic=0.6)),
            _at(0.0, 0.0, -0.115, Cylinder(0.06, 0.012), _material("4b5563")),
            _at(0.0, 0.0, -0.371, Cylinder(0.025, 0.498), _material("aab4c0", roughness=0.35, metallic=0.3)),
            _at(0.0, 0.0, -0.61, Cylinder(0.12, 0.02), _material("4b5563")),
        ),
        ("satellite",): (Part(Sphere(0.02), _material("ef476f", roughness=0.3)),),
        ("bouncing ball",): (Part(Surface(globe()), _textured(_stripes(), 0.35)),),
        ("orbit",): (Part(Line(ring(CRYSTAL_BALL, ORBIT_RADIUS), radius=0.004, closed=True), _material("06d6a0")),),
        ("arrow",): (
            Part(
                Line(
                    np.array(((-0.68, -0.45, 0.751), (-0.38, -0.45, 0.751)), np.float32),
                    radius=0.006,
                    end_head=True,
                    head_radius=0.018,
                    head_length=0.05,
                ),
                _material("ffd166"),
            ),
        ),
        ("origin",): (Part(Triad(0.25, tube=True), plate, translation(-0.95, -0.75, 0.001)),),
    }


def _drone() -> dict[Path, tuple[Part, ...]]:
    body, blade = _material("e9edf2", roughness=0.3), _material("4b5563", alpha=0.6)
    arms = [Part(Capsule(0.008, 0.2), body, _rotation_to(0.11 * x, 0.11 * y)) for x, y in ((1, 1), (1, -1))]
    status_light = Material(base_color=(0.0, 0.0, 0.0, 1.0), emissive=(0.1, 0.9, 0.3), metallic=0.0)
    parts: dict[Path, tuple[Part, ...]] = {
        ("drone",): (
            Part(Ellipsoid((0.09, 0.05, 0.03)), body),
            *arms,
            _at(0.085, 0.0, 0.0, Sphere(0.012), status_light),
        )
    }
    for index in range(1, 5):
        parts["drone", f"rotor {index}"] = (Part(Box((0.15, 0.012, 0.003)), blade),)
    return parts


def _rotation_to(x: float, y: float) -> Matrix:
    """Return the rotation of the z axis into the horizontal direction (x, y), (4, 4)."""
    length = math.hypot(x, y)
    return from_pose((0.0, 0.0, 0.0), (math.sqrt(0.5), -math.sqrt(0.5) * y / length, math.sqrt(0.5) * x / length, 0.0))


def _scanner() -> dict[Path, tuple[Part, ...]]:
    """Return a wall behind the table and a point cloud on it, coloured by height."""
    random = np.random.default_rng(2026)
    u, v = random.uniform(-1.0, 1.0, 6000), random.uniform(0.0, 1.0, 6000)
    waves = relief(u, v)
    points = np.stack((-0.25 - waves, u, 1.3 * v), axis=1).astype(np.float32)
    colors = np.stack((v, 0.5 + 0.5 * np.sin(4.0 * waves / 0.1), 1.0 - v), axis=1).astype(np.float32)
    cloud = PointCloud(points, {"rgb": np.clip(colors, 0.0, 1.0)})
    return {
        ("scanner",): (Part(cloud, Material(metallic=0.0, point_size=3.0)),),
        ("scanner", "wall"): (Part(Surface(wall()), _material("8b95a1", roughness=0.9)),),
    }


def _image(name: str, rgb: NDArray[np.floating]) -> Image:
    """Return an opaque image of sRGB values from 0 to 1, (H, W, 3)."""
    pixels = np.full((*rgb.shape[:2], 4), 255, np.uint8)
    pixels[:, :, :3] = np.clip(rgb * 255.0 + 0.5, 0.0, 255.0).astype(np.uint8)
    pixels.flags.writeable = False
    return Image(f"scenegate demo {name}".encode(), lambda: pixels)


def _checker() -> Image:
    """Return a checkerboard with dark seams."""
    y, x = np.mgrid[0:128, 0:128]
    dark = ((x // 64 + y // 64) % 2).astype(float)
    seam = np.minimum(np.minimum(x % 64, y % 64), 3) / 3.0
    grey = (0.97 - 0.17 * dark) * (0.9 + 0.1 * seam)
    return _image("floor", grey[:, :, None] * np.array((0.98, 0.99, 1.0)))


def _wood() -> Image:
    """Return wooden planks with grain."""
    y, x = np.mgrid[0:256, 0:512] / 256.0
    rings = 18.0 * np.hypot(0.35 * (y - 0.4), 0.04 * (x + 3.0)) + 0.8 * np.sin(3.0 * x + 2.0 * np.sin(5.0 * y))
    grain = 0.5 + 0.5 * np.sin(2.0 * np.pi * rings)
    fibre = np.random.default_rng(7).uniform(-1.0, 1.0, (256, 1)) * 0.03
    plank = np.where((y * 4.0) % 1.0 < 0.02, 0.75, 1.0)
    tone = (1.0 - 0.16 * grain + fibre) * plank
    return _image("wood", tone[:, :, None] * np.array((1.0, 0.83, 0.62)))


def _target() -> Image:
    """Return a calibration target: circles, a wedge and a frame, which show orientation and filtering."""
    y, x = np.mgrid[0:128, 0:128] / 127.0 * 2.0 - 1.0
    radius = np.hypot(x, y)
    circles = np.sin(18.0 * radius) > 0.0
    wedge = (np.abs(y) < x) & (radius < 0.85)
    color = np.where(circles[:, :, None], np.array((0.97, 0.96, 0.92)), np.array((0.16, 0.20, 0.36)))
    color = np.where(wedge[:, :, None], color * np.array((1.0, 0.55, 0.25)), color)
    frame = np.maximum(np.abs(x), np.abs(y)) > 0.92
    return _image("target", np.where(frame[:, :, None], np.array((0.85, 0.2, 0.25)), color))


def _stripes() -> Image:
    """Return blue and white stripes."""
    y, x = np.mgrid[0:64, 0:128] / 64.0
    band = (np.floor(x * 4.0) % 2 == 0) ^ (np.abs(y - 0.5) < 0.12)
    return _image("ball", np.where(band[:, :, None], np.array((0.95, 0.95, 0.98)), np.array((0.10, 0.45, 0.85))))


def tile(half_side: float, repeats: float) -> Mesh:
    """Return a square at z = 0, centred on the origin, with copies of the texture along each side."""
    return rectangle(2.0 * half_side, 2.0 * half_side, repeats)


def textured_box(x: float, y: float, z: float) -> Mesh:
    """Return a box with these side lengths in metres, and the whole texture on each face."""
    unit = primitives.box()
    uv = np.tile(np.array(((0, 1), (1, 1), (1, 0), (0, 0)), np.float32), (6, 1))
    return Mesh(unit.positions * np.array((x, y, z), np.float32), unit.elements, normals=unit.normals, uv0=uv)


def globe(radius: float = 0.05, segments: int = 32, rings: int = 16) -> Mesh:
    """Return a sphere with a seam of doubled vertices, so that a texture wraps around it. ``radius`` is in metres."""
    azimuth, polar = np.meshgrid(np.linspace(0.0, math.tau, segments + 1), np.linspace(0.0, math.pi, rings + 1))
    normals = np.stack(
        (np.sin(polar) * np.cos(azimuth), np.sin(polar) * np.sin(azimuth), np.cos(polar)), axis=2
    ).reshape(-1, 3)
    uv = np.stack((azimuth / math.tau, polar / math.pi), axis=2).reshape(-1, 2)
    index = np.arange((rings + 1) * (segments + 1)).reshape(rings + 1, segments + 1)
    above, below = index[:-1], index[1:]
    return Mesh(
        (normals * radius).astype(np.float32),
        _triangles_between(below, above),
        normals=normals.astype(np.float32),
        uv0=uv.astype(np.float32),
    )


def knot() -> Mesh:
    """Return a trefoil knot."""
    t = np.linspace(0.0, math.tau, 120, endpoint=False)
    points = np.stack((np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)), axis=1)
    mesh = tube(points * 0.022, 0.009, closed=True)
    assert mesh is not None
    return mesh


def relief(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Return the depth of the wall's waves in metres; u runs across the wall (-1 to 1), v up (0 to 1)."""
    waves: NDArray[np.float64] = 0.08 * np.sin(5.0 * u) * np.cos(7.0 * v) + 0.05 * np.cos(9.0 * u + 4.0 * v)
    return waves


def wall(columns: int = 64, rows: int = 40) -> Mesh:
    """Return the wall that the demo's point cloud samples, 8 mm behind the points so that it does not cover them."""
    u, v = np.meshgrid(np.linspace(-1.0, 1.0, columns), np.linspace(0.0, 1.0, rows))
    slope_across = (relief(u + 1e-4, v) - relief(u - 1e-4, v)) / 2e-4
    slope_up = (relief(u, v + 1e-4) - relief(u, v - 1e-4)) / 2.6e-4  # the wall is 1.3 m high
    positions = np.stack((-0.258 - relief(u, v), u, 1.3 * v), axis=2).reshape(-1, 3)
    normals = np.stack((np.ones_like(u), slope_across, slope_up), axis=2).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    below, above = index[:-1], index[1:]
    return Mesh(
        positions.astype(np.float32),
        _triangles_between(below, above),
        normals=(normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
    )


def _triangles_between(below: NDArray[np.int64], above: NDArray[np.int64]) -> NDArray[np.uint32]:
    """Return the triangles between rows of vertices with (R, C) indices, (2 R (C - 1), 3) uint32."""
    quads = np.stack((below[:, :-1], below[:, 1:], above[:, 1:], below[:, :-1], above[:, 1:], above[:, :-1]), axis=2)
    return np.ascontiguousarray(quads.reshape(-1, 3), np.uint32)


def ring(centre: tuple[float, float, float], radius: float) -> NDArray[np.float32]:
    """Return points of a horizontal circle, (96, 3) float32, metres."""
    angle = np.linspace(0.0, math.tau, 96, endpoint=False)
    points = np.stack((np.cos(angle), np.sin(angle), np.zeros(96)), axis=1) * radius + np.array(centre)
    return np.asarray(points, np.float32)


PERIOD: Final = 24.0
"""Period of the whole scene, seconds: a recording of this length can be looped."""
CRYSTAL_BALL: Final = (0.72, -1.0, 0.62)
"""Position of the crystal ball, metres. It is below the default view of the stereo camera: stereo matching fails on
transparent objects."""
ORBIT_RADIUS: Final = 0.17
"""Radius of the ring around the crystal ball, metres."""
_X: Final = (1.0, 0.0, 0.0)
_Y: Final = (0.0, 1.0, 0.0)
_Z: Final = (0.0, 0.0, 1.0)


def poses(t: float) -> dict[Path, Pose]:
    """Return the pose of every moving node, relative to its parent, at time ``t`` in seconds."""
    phase = 2.0 * math.pi * (t / PERIOD)
    shoulder, elbow = 0.55 + 0.25 * math.sin(2 * phase), 1.15 + 0.35 * math.sin(2 * phase + 1.2)
    wrist = math.pi - shoulder - elbow + 0.2 * math.sin(4 * phase)
    grip = 0.035 + 0.02 * math.sin(6 * phase)
    base: Path = ("robot",)
    upper_arm: Path = (*base, "turret", "upper arm")
    hand: Path = (*upper_arm, "forearm", "wrist")
    roll = 3 * phase
    bounce = abs(math.sin(4 * phase))
    return {
        base: _pose((-0.35, 0.0, 0.75)),
        (*base, "turret"): _pose((0.0, 0.0, 0.12), _Z, 0.9 * math.sin(phase)),
        upper_arm: _pose((0.0, 0.0, 0.14), _Y, shoulder),
        (*upper_arm, "forearm"): _pose((0.0, 0.0, 0.40), _Y, elbow),
        hand: _pose((0.0, 0.0, 0.36), _Y, wrist),
        (*hand, "left finger"): _pose((0.0, grip, 0.10)),
        (*hand, "right finger"): _pose((0.0, -grip, 0.10)),
        ("turntable",): _pose((0.30, -0.28, 0.76), _Z, 2 * phase),
        ("crystal ball",): _pose((*CRYSTAL_BALL,), _Z, -phase),
        ("bouncing ball",): _pose((0.02, 0.36, 0.80 + 0.22 * bounce), _X, roll),
        ("satellite",): _pose(
            (
                CRYSTAL_BALL[0] + ORBIT_RADIUS * math.cos(3 * phase),
                CRYSTAL_BALL[1] + ORBIT_RADIUS * math.sin(3 * phase),
                CRYSTAL_BALL[2],
            )
        ),
        ("drone",): _pose(
            (0.9 * math.cos(phase), 0.9 * math.sin(phase), 1.75 + 0.06 * math.sin(5 * phase)), _Z, phase + 0.5 * math.pi
        ),
        ("drone", "rotor 1"): _pose((0.11, 0.11, 0.03), _Z, 40 * phase),
        ("drone", "rotor 2"): _pose((-0.11, 0.11, 0.03), _Z, -40 * phase),
        ("drone", "rotor 3"): _pose((-0.11, -0.11, 0.03), _Z, 40 * phase),
        ("drone", "rotor 4"): _pose((0.11, -0.11, 0.03), _Z, -40 * phase),
        ("scanner",): _pose((0.0, 0.95, 0.0), _Z, -0.5 * math.pi),
    }


def _pose(position: tuple[float, float, float], axis: tuple[float, float, float] = _Z, angle: float = 0.0) -> Pose:
    """Return a pose from a position in metres and a rotation about a unit axis in radians."""
    sine = math.sin(0.5 * angle)
    return (*position, math.cos(0.5 * angle), sine * axis[0], sine * axis[1], sine * axis[2])
