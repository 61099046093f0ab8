"""A small moving scene to look at: a workcell with a robot arm, objects on a table and a scanner.

Everything is a pure function of time, so that pictures of it can be made again.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gateway.scene.geometry import (
    Box,
    Capsule,
    Cylinder,
    Ellipsoid,
    Line,
    Part,
    PointCloud,
    Shape,
    Sphere,
    Surface,
    Triad,
)
from gateway.scene.live import LiveTree
from gateway.scene.transforms import Matrix, from_pose, translation
from gateway.scene.tree import Path, Pose, TreeEdit
from renderers import primitives
from renderers.drawlist import AlphaMode, Image, Material, Mesh, Texture
from renderers.tubes import tube

ROOT: Final = ("demo",)
RATE: Final = 30.0
"""Edits per second that look smooth."""
PERIOD: Final = 24.0
"""Seconds after which everything is as at the beginning, so that films of it can be looped."""
_TURN: Final = 2.0 * math.pi
_BALL: Final = (0.72, -1.0, 0.62)
"""Beside the table, below what the stereo camera sees by default: no camera can match what one looks through."""
_ORBIT: Final = 0.17
"""Radius of the ring around the ball, metres."""

X_AXIS: Final = (1.0, 0.0, 0.0)
Y_AXIS: Final = (0.0, 1.0, 0.0)
Z_AXIS: Final = (0.0, 0.0, 1.0)


class Demo:
    """The scene in a live tree."""

    def __init__(self, tree: LiveTree) -> None:
        self._tree = tree

    def populate(self) -> None:
        """Puts everything at its place for time 0."""
        with self._tree.edit() as edit:
            edit.delete(ROOT)
            for path, parts in furniture().items():
                edit.set_parts((*ROOT, *path), parts)
            _put(edit, 0.0)

    def edit(self, t: float) -> None:
        """Moves everything to its place at time ``t``, seconds. One revision; geometry stays the same."""
        with self._tree.edit() as edit:
            _put(edit, t)

    def clear(self) -> None:
        """Takes the scene out of the tree."""
        with self._tree.edit() as edit:
            edit.delete(ROOT)


def _put(edit: TreeEdit, t: float) -> None:
    for path, pose in poses(t).items():
        edit.set_pose((*ROOT, *path), pose)


def poses(t: float) -> dict[Path, Pose]:
    """Every moving frame's pose in its parent at time ``t``, seconds."""
    phase = _TURN * (t / PERIOD)
    shoulder, elbow = 0.55 + 0.25 * math.sin(2 * phase), 1.15 + 0.35 * math.sin(2 * phase + 1.2)
    wrist = math.pi - shoulder - elbow + 0.2 * math.sin(4 * phase)
    grip = 0.035 + 0.02 * math.sin(6 * phase)
    base: Path = ("robot",)
    upper: Path = (*base, "turret", "upper arm")
    hand: Path = (*upper, "forearm", "wrist")
    ball = 3 * phase
    hop = abs(math.sin(4 * phase))
    return {
        base: _pose((-0.35, 0.0, 0.75)),
        (*base, "turret"): _pose((0.0, 0.0, 0.12), Z_AXIS, 0.9 * math.sin(phase)),
        upper: _pose((0.0, 0.0, 0.14), Y_AXIS, shoulder),
        (*upper, "forearm"): _pose((0.0, 0.0, 0.40), Y_AXIS, elbow),
        hand: _pose((0.0, 0.0, 0.36), Y_AXIS, wrist),
        (*hand, "left finger"): _pose((0.0, grip, 0.10)),
        (*hand, "right finger"): _pose((0.0, -grip, 0.10)),
        ("turntable",): _pose((0.30, -0.28, 0.76), Z_AXIS, 2 * phase),
        ("crystal ball",): _pose((*_BALL,), Z_AXIS, -phase),
        ("bouncing ball",): _pose((0.02, 0.36, 0.80 + 0.22 * hop), X_AXIS, ball),
        ("satellite",): _pose(
            (_BALL[0] + _ORBIT * math.cos(3 * phase), _BALL[1] + _ORBIT * math.sin(3 * phase), _BALL[2])
        ),
        ("drone",): _pose(
            (0.9 * math.cos(phase), 0.9 * math.sin(phase), 1.75 + 0.06 * math.sin(5 * phase)),
            Z_AXIS,
            phase + 0.5 * math.pi,
        ),
        ("drone", "rotor 1"): _pose((0.11, 0.11, 0.03), Z_AXIS, 40 * phase),
        ("drone", "rotor 2"): _pose((-0.11, 0.11, 0.03), Z_AXIS, -40 * phase),
        ("drone", "rotor 3"): _pose((-0.11, -0.11, 0.03), Z_AXIS, 40 * phase),
        ("drone", "rotor 4"): _pose((0.11, -0.11, 0.03), Z_AXIS, -40 * phase),
        ("scanner",): _pose((0.0, 0.95, 0.0), Z_AXIS, -0.5 * math.pi),
    }


def _pose(position: tuple[float, float, float], axis: tuple[float, float, float] = Z_AXIS, angle: float = 0.0) -> Pose:
    s = math.sin(0.5 * angle)
    return (*position, math.cos(0.5 * angle), s * axis[0], s * axis[1], s * axis[2])


@cache
def furniture() -> dict[Path, tuple[Part, ...]]:
    """What is drawn at every path; the same objects whenever it is asked for."""
    return {
        ("floor",): (Part(Surface(_tile(3.0, 6)), _textured(_checker())),),
        ("table",): _table(),
        **_robot(),
        **_still_life(),
        **_drone(),
        **_scanner(),
    }


def _matter(color: str, *, roughness: float = 0.5, metallic: float = 0.0, alpha: float = 1.0) -> Material:
    """A material of a colour as displays show it (``rrggbb``)."""
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
    steel = _matter("aab4c0", roughness=0.35, metallic=0.3)
    top = Part(Surface(_textured_box(1.5, 1.1, 0.04)), _textured(_wood(), 0.45), translation(0.0, 0.0, 0.73))
    legs = [_at(x, y, 0.355, Cylinder(0.03, 0.71), steel) for x in (-0.68, 0.68) for y in (-0.48, 0.48)]
    return (top, *legs)


def _robot() -> dict[Path, tuple[Part, ...]]:
    shell, joint = _matter("ffa531", roughness=0.3), _matter("4b5563", roughness=0.35)
    metal = _matter("dfe6ec", roughness=0.3, metallic=0.5)
    sideways = from_pose((0.0, 0.0, 0.0), (math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0))

    def hub(radius: float, length: float) -> Part:
        return Part(Cylinder(radius, length), joint, sideways)

    turret: Path = ("robot", "turret")
    upper: Path = (*turret, "upper arm")
    forearm: Path = (*upper, "forearm")
    wrist: Path = (*forearm, "wrist")
    finger = (_at(0.0, 0.0, 0.04, Box((0.03, 0.012, 0.09)), joint),)
    return {
        ("robot",): (
            _at(0.0, 0.0, 0.015, Cylinder(0.15, 0.03), joint),
            _at(0.0, 0.0, 0.07, Cylinder(0.11, 0.1), shell),
        ),
        turret: (_at(0.0, 0.0, 0.05, Cylinder(0.10, 0.1), shell),),
        upper: (hub(0.085, 0.18), _at(0.0, 0.0, 0.20, Capsule(0.06, 0.34), shell)),
        forearm: (hub(0.07, 0.15), _at(0.0, 0.0, 0.18, Capsule(0.045, 0.30), shell)),
        wrist: (
            hub(0.05, 0.11),
            _at(0.0, 0.0, 0.06, Cylinder(0.035, 0.06), metal),
            _at(0.0, 0.0, 0.095, Box((0.06, 0.14, 0.02)), joint),
        ),
        (*wrist, "left finger"): finger,
        (*wrist, "right finger"): finger,
        (*wrist, "tool frame"): (Part(Triad(0.12, tube=True), joint, translation(0.0, 0.0, 0.19)),),
    }


def _still_life() -> dict[Path, tuple[Part, ...]]:
    plate = _matter("5fb0e0", roughness=0.3)
    return {
        ("turntable",): (
            _at(0.0, 0.0, 0.0, Cylinder(0.18, 0.02), plate),
            Part(Surface(_textured_box(0.12, 0.12, 0.12)), _textured(_letters(), 0.5), translation(0.07, 0.0, 0.07)),
            _at(-0.08, 0.05, 0.08, Cylinder(0.04, 0.14), _matter("f0545a", roughness=0.3)),
            _at(-0.06, -0.08, 0.05, Ellipsoid((0.05, 0.035, 0.04)), _matter("9bd67f", roughness=0.4)),
        ),
        ("crystal ball",): (
            Part(Sphere(0.11), _matter("9ad1ff", roughness=0.05, alpha=0.35)),
            Part(Surface(_knot()), _matter("ffd166", roughness=0.25, metallic=0.6)),
            _at(0.0, 0.0, -0.115, Cylinder(0.06, 0.012), _matter("4b5563")),
            _at(0.0, 0.0, -0.371, Cylinder(0.025, 0.498), _matter("aab4c0", roughness=0.35, metallic=0.3)),
            _at(0.0, 0.0, -0.61, Cylinder(0.12, 0.02), _matter("4b5563")),
        ),
        ("satellite",): (Part(Sphere(0.02), _matter("ef476f", roughness=0.3)),),
        ("bouncing ball",): (Part(Surface(_globe()), _textured(_stripes(), 0.35)),),
        ("orbit",): (Part(Line(_orbit(), radius=0.004, closed=True), _matter("06d6a0")),),
        ("arrow",): (
            Part(
                Line(
                    np.array(((-0.68, -0.45, 0.751), (-0.38, -0.45, 0.751)), np.float32),
                    radius=0.006,
                    end_head=True,
                    head_radius=0.018,
                    head_length=0.05,
                ),
                _matter("ffd166"),
            ),
        ),
        ("origin",): (Part(Triad(0.25, tube=True), plate, translation(-0.95, -0.75, 0.001)),),
    }


def _drone() -> dict[Path, tuple[Part, ...]]:
    body, blade = _matter("e9edf2", roughness=0.3), _matter("4b5563", alpha=0.6)
    arms = [Part(Capsule(0.008, 0.2), body, _along((0.11 * i, 0.11 * j, 0.0))) for i, j in ((1, 1), (1, -1))]
    lamp = Material(base_color=(0.0, 0.0, 0.0, 1.0), emissive=(0.1, 0.9, 0.3), metallic=0.0)
    parts: dict[Path, tuple[Part, ...]] = {
        ("drone",): (
            Part(Ellipsoid((0.09, 0.05, 0.03)), body),
            *arms,
            _at(0.085, 0.0, 0.0, Sphere(0.012), lamp),
        )
    }
    for index in range(1, 5):
        parts["drone", f"rotor {index}"] = (Part(Box((0.15, 0.012, 0.003)), blade),)
    return parts


def _along(direction: tuple[float, float, float]) -> Matrix:
    """(4, 4): turns the z axis to a horizontal direction."""
    x, y, _ = direction
    length = math.hypot(x, y)
    return from_pose((0.0, 0.0, 0.0), (math.sqrt(0.5), -math.sqrt(0.5) * y / length, math.sqrt(0.5) * x / length, 0.0))


def _scanner() -> dict[Path, tuple[Part, ...]]:
    """A wall behind the table and the points that were scanned on it, coloured by height."""
    random = np.random.default_rng(2026)
    u, v = random.uniform(-1.0, 1.0, 6000), random.uniform(0.0, 1.0, 6000)
    relief = _relief(u, v)
    points = np.stack((-0.25 - relief, u, 1.3 * v), axis=1).astype(np.float32)
    hue = np.stack((v, 0.5 + 0.5 * np.sin(4.0 * relief / 0.1), 1.0 - v), axis=1).astype(np.float32)
    cloud = PointCloud(points, {"rgb": np.clip(hue, 0.0, 1.0)})
    return {
        ("scanner",): (Part(cloud, Material(metallic=0.0, point_size=3.0)),),
        ("scanner", "wall"): (Part(Surface(_wall()), _matter("8b95a1", roughness=0.9)),),
    }


def _relief(u: NDArray[np.float64], v: NDArray[np.float64]) -> NDArray[np.float64]:
    """Depth of the wall's waves, metres, across (-1 to 1) and up (0 to 1)."""
    waves: NDArray[np.float64] = 0.08 * np.sin(5.0 * u) * np.cos(7.0 * v) + 0.05 * np.cos(9.0 * u + 4.0 * v)
    return waves


# --- meshes with texture coordinates


def _tile(half: float, repeats: float) -> Mesh:
    """A square at z = 0 with the texture repeated."""
    corners = np.array(((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)), np.float32)
    return Mesh(
        corners * np.float32(half),
        np.array(((0, 1, 2), (0, 2, 3)), np.uint32),
        normals=np.tile(np.array(Z_AXIS, np.float32), (4, 1)),
        uv0=(corners[:, :2] * np.array((0.5, -0.5), np.float32) + np.float32(0.5)) * np.float32(repeats),
    )


def _textured_box(x: float, y: float, z: float) -> Mesh:
    """A box with the whole texture on each face."""
    unit = primitives.box()
    uv = np.tile(np.array(((0, 1), (1, 1), (1, 0), (0, 0)), np.float32), (6, 1))
    return Mesh(unit.positions * np.array((x, y, z), np.float32), unit.elements, normals=unit.normals, uv0=uv)


def _globe(radius: float = 0.05, segments: int = 32, rings: int = 16) -> Mesh:
    """A sphere with a seam, so that a texture wraps around it."""
    azimuth = np.linspace(0.0, _TURN, segments + 1)
    polar = np.linspace(0.0, math.pi, rings + 1)
    a, p = np.meshgrid(azimuth, polar)
    normals = np.stack((np.sin(p) * np.cos(a), np.sin(p) * np.sin(a), np.cos(p)), axis=2).reshape(-1, 3)
    uv = np.stack((a / _TURN, p / math.pi), axis=2).reshape(-1, 2)
    index = np.arange((rings + 1) * (segments + 1)).reshape(rings + 1, segments + 1)
    above, below = index[:-1], index[1:]
    quads = np.stack((below[:, :-1], below[:, 1:], above[:, 1:], below[:, :-1], above[:, 1:], above[:, :-1]), axis=2)
    return Mesh(
        (normals * radius).astype(np.float32),
        np.ascontiguousarray(quads.reshape(-1, 3), np.uint32),
        normals=normals.astype(np.float32),
        uv0=uv.astype(np.float32),
    )


def _knot() -> Mesh:
    """A trefoil inside of the crystal ball."""
    t = np.linspace(0.0, _TURN, 120, endpoint=False)
    points = np.stack((np.sin(t) + 2 * np.sin(2 * t), np.cos(t) - 2 * np.cos(2 * t), -np.sin(3 * t)), axis=1)
    mesh = tube(points * 0.022, 0.009, closed=True)
    assert mesh is not None
    return mesh


def _wall(columns: int = 64, rows: int = 40) -> Mesh:
    """The scanned surface, a little behind its points."""
    u, v = np.meshgrid(np.linspace(-1.0, 1.0, columns), np.linspace(0.0, 1.0, rows))
    across = (_relief(u + 1e-4, v) - _relief(u - 1e-4, v)) / 2e-4
    up = (_relief(u, v + 1e-4) - _relief(u, v - 1e-4)) / 2.6e-4
    positions = np.stack((-0.258 - _relief(u, v), u, 1.3 * v), axis=2).reshape(-1, 3)
    normals = np.stack((np.ones_like(u), across, up), axis=2).reshape(-1, 3)
    index = np.arange(rows * columns).reshape(rows, columns)
    below, above = index[:-1], index[1:]
    quads = np.stack((below[:, :-1], below[:, 1:], above[:, 1:], below[:, :-1], above[:, 1:], above[:, :-1]), axis=2)
    return Mesh(
        positions.astype(np.float32),
        np.ascontiguousarray(quads.reshape(-1, 3), np.uint32),
        normals=(normals / np.linalg.norm(normals, axis=1, keepdims=True)).astype(np.float32),
    )


def _orbit() -> NDArray[np.float32]:
    angle = np.linspace(0.0, _TURN, 96, endpoint=False)
    ring = np.stack((np.cos(angle), np.sin(angle), np.zeros(96)), axis=1) * _ORBIT + np.array(_BALL)
    return np.asarray(ring, np.float32)


# --- textures, made of arithmetic


def _image(name: str, rgb: NDArray[np.floating]) -> Image:
    """An image of (H, W, 3) values in 0..1 as displays show them."""
    pixels = np.full((*rgb.shape[:2], 4), 255, np.uint8)
    pixels[:, :, :3] = np.clip(rgb * 255.0 + 0.5, 0.0, 255.0).astype(np.uint8)
    pixels.flags.writeable = False
    return Image(f"scenegate demo {name}".encode(), lambda: pixels, name)


def _checker() -> Image:
    y, x = np.mgrid[0:128, 0:128]
    dark = ((x // 64 + y // 64) % 2).astype(float)
    seam = np.minimum(np.minimum(x % 64, y % 64), 3) / 3.0
    grey = (0.97 - 0.17 * dark) * (0.9 + 0.1 * seam)
    return _image("floor", grey[:, :, None] * np.array((0.98, 0.99, 1.0)))


def _wood() -> Image:
    y, x = np.mgrid[0:256, 0:512] / 256.0
    rings = 18.0 * np.hypot(0.35 * (y - 0.4), 0.04 * (x + 3.0)) + 0.8 * np.sin(3.0 * x + 2.0 * np.sin(5.0 * y))
    grain = 0.5 + 0.5 * np.sin(_TURN * rings)
    fibre = np.random.default_rng(7).uniform(-1.0, 1.0, (256, 1)) * 0.03
    plank = np.where((y * 4.0) % 1.0 < 0.02, 0.75, 1.0)
    tone = (1.0 - 0.16 * grain + fibre) * plank
    return _image("wood", tone[:, :, None] * np.array((1.0, 0.83, 0.62)))


def _letters() -> Image:
    """A calibration target: circles and a frame, so that orientation and filtering can be judged."""
    y, x = np.mgrid[0:128, 0:128] / 127.0 * 2.0 - 1.0
    radius = np.hypot(x, y)
    target = np.sin(18.0 * radius) > 0.0
    wedge = (np.abs(y) < x) & (radius < 0.85)
    color = np.where(target[:, :, None], np.array((0.97, 0.96, 0.92)), np.array((0.16, 0.20, 0.36)))
    color = np.where(wedge[:, :, None], color * np.array((1.0, 0.55, 0.25)), color)
    frame = np.maximum(np.abs(x), np.abs(y)) > 0.92
    return _image("target", np.where(frame[:, :, None], np.array((0.85, 0.2, 0.25)), color))


def _stripes() -> Image:
    y, x = np.mgrid[0:64, 0:128] / 64.0
    band = (np.floor(x * 4.0) % 2 == 0) ^ (np.abs(y - 0.5) < 0.12)
    return _image("ball", np.where(band[:, :, None], np.array((0.95, 0.95, 0.98)), np.array((0.10, 0.45, 0.85))))
