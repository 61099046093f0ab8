"""Whole images of ``CpuRenderer``: golden images, thread counts, degenerate scenes.

``SCENEGATE_REGENERATE_PICTURES=1 pytest ...`` writes the golden images anew; look at them before committing them.
"""

from dataclasses import replace

import cv2
import numpy as np
import pytest

from renderers.camera import Camera
from renderers.drawlist import AlphaMode, DrawList, Instance, Material, Mesh, Sampler, Texture, Wrap
from renderers.interface import Look, Output
from renderers.raster import CpuRenderer
from tests.renderers.golden_images import GOLDEN_FOLDER, regenerates_golden_images
from tests.renderers.shading.reference import Array, ball, camera, image_of, painted, placed, quad

LOOKS = (Look("phong"), Look("pbr"), Look("gltf"))


def pose(x: float, y: float, z: float, linear: Array | None = None) -> Array:
    X = np.eye(4)
    X[:3, :3] = np.eye(3) if linear is None else linear
    X[:3, 3] = x, y, z
    return X


def checks(cells: int = 8, texels: int = 4, low: int = 40) -> np.ndarray:
    n = cells * texels
    i, j = np.meshgrid(np.arange(n) // texels, np.arange(n) // texels)
    pixels = np.where(((i + j) % 2 == 0)[..., None], (240, 200, 40, 255), (low, 60, 160, 255)).astype(np.uint8)
    pixels[: texels * 2, : texels * 2] = (255, 0, 0, 255)  # marks one corner
    return pixels


def bumps(n: int = 32) -> np.ndarray:
    x, y = np.meshgrid(np.arange(n), np.arange(n))
    slope = np.stack((np.cos(x * 0.6) * 0.5, np.sin(y * 0.6) * 0.5, np.ones((n, n))), axis=-1)
    slope /= np.linalg.norm(slope, axis=-1, keepdims=True)
    return np.dstack((np.round((slope + 1) * 127.5), np.full((n, n), 255))).astype(np.uint8)


def everything() -> DrawList:
    """A scene with one of each: textures, normal map, vertex colours, glass, cut-out, back faces, lines, points."""
    rotation = np.array(((0.8, 0.0, 0.6), (0.36, 0.8, -0.48), (-0.48, 0.6, 0.64)))
    textured = Material(base_color_texture=Texture(image_of(checks())), metallic=0.0, roughness=0.5)
    bumpy = Material((0.9, 0.7, 0.4, 1.0), metallic=0.7, roughness=0.35, normal_texture=Texture(image_of(bumps())))
    holes = checks(6, 3)
    holes[..., 3] = np.where(holes[..., 2] > 100, 0, 255)
    fence = Material(
        base_color_texture=Texture(image_of(holes), Sampler(Wrap.MIRRORED_REPEAT, Wrap.REPEAT, mag_linear=False)),
        metallic=0.0,
        alpha_mode=AlphaMode.MASK,
        double_sided=True,
    )
    glass = Material((0.2, 0.8, 0.4, 0.35), metallic=0.0, alpha_mode=AlphaMode.BLEND, double_sided=True)
    lamp = Material((0.1, 0.1, 0.1, 1.0), metallic=0.0, emissive=(0.8, 0.5, 0.1))
    corners = np.array([(x, y, z) for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], np.float32) * 0.5
    edges = [(a, b) for a in range(8) for b in range(a) if (a ^ b).bit_count() == 1]
    rainbow = np.hstack((corners + 0.5, np.ones((8, 1), np.float32))).astype(np.float32)
    frame = Mesh(corners, np.array(edges, np.uint32), colors=rainbow)
    dots = Mesh(corners, np.arange(8, dtype=np.uint32)[:, None], colors=rainbow)
    sphere = ball(16, 0.8)
    faceted = replace(ball(5, 0.5), normals=None, colors=np.abs(ball(5).positions @ np.eye(3, 4, dtype=np.float32)) + 0)
    faceted.colors[:, 3] = 1.0
    return DrawList(
        (
            Instance(sphere, textured, pose(-1.6, -0.8, 5.0, rotation)),
            Instance(sphere, bumpy, pose(0.2, -0.9, 5.0, rotation)),
            Instance(replace(sphere, tangents=None), bumpy, pose(1.9, -0.9, 5.0, rotation @ np.diag((1.0, -1.0, 1.0)))),
            Instance(quad(0.8, 0.0), fence, pose(-1.5, 0.9, 4.2, rotation)),
            Instance(ball(12, 0.5), glass, pose(0.1, 0.7, 4.0)),
            Instance(ball(8, 0.35), lamp, pose(0.3, 0.9, 5.0)),
            Instance(faceted, Material(metallic=0.0), pose(1.4, 0.8, 4.5, rotation)),
            Instance(frame, replace(Material(), line_width=2.0), pose(-0.5, 0.3, 5.0, rotation)),
            Instance(dots, replace(Material(), point_size=4.0), pose(-0.5, 0.3, 5.0, rotation)),
        )
    )


def wide_view() -> Camera:
    return Camera(203, 151, 190.0, 185.0, 99.0, 76.0, 0.1, 50.0, np.eye(4))


def rendered(renderer: CpuRenderer, scene: DrawList, view: Camera, look: Look) -> np.ndarray:
    frame = renderer.render(scene, view, Output.COLOR, look)
    return frame.color.copy()


@pytest.mark.parametrize("look", LOOKS, ids=lambda look: look.name)
def test_golden_image(renderer: CpuRenderer, look: Look) -> None:
    path = GOLDEN_FOLDER / f"shading_{look.name}.png"
    color = rendered(renderer, everything(), wide_view(), look)
    if regenerates_golden_images():
        cv2.imwrite(str(path), color[..., ::-1])
    golden = cv2.imread(str(path))
    wrong = np.argwhere((color != golden[..., ::-1]).any(axis=-1))
    assert len(wrong) == 0, f"{len(wrong)} pixels differ, the first at (row, column) {wrong[:4].tolist()}"


@pytest.mark.parametrize("look", LOOKS, ids=lambda look: look.name)
def test_order_of_bands_does_not_change_the_image(look: Look, monkeypatch: pytest.MonkeyPatch) -> None:
    """Any order of bands gives the same bytes."""
    view = Camera(40, 75, 40.0, 40.0, 20.0, 37.0, 0.1, 50.0, np.eye(4))
    glass = Material((0.2, 0.8, 0.4, 0.35), metallic=0.0, alpha_mode=AlphaMode.BLEND)
    scene = DrawList((placed(ball(6), z=3.0), placed(quad(0.7, 1.5), glass)))
    backwards = CpuRenderer(threads=1)
    monkeypatch.setattr(backwards, "parallel", lambda units, work: [work(unit) for unit in reversed(range(units))])
    assert (painted(scene, view, look) == painted(scene, view, look, backwards)).all()


def test_degenerate_meshes_give_finite_colors(renderer: CpuRenderer) -> None:
    """Without area, length or normals. The mesh may be drawn or not, but without errors or non-finite colours."""
    rng = np.random.default_rng(2)
    sliver = quad()
    thin = sliver.positions.copy()
    thin[2:] = thin[:2] + np.float32(1e-7)
    flat = np.diag((1.0, 1.0, 0.0))
    odd = [
        placed(replace(sliver, positions=thin)),
        placed(quad(z=0.0), z=2.0, linear=flat),
        placed(ball(), z=3.0, linear=np.diag((1e-12, 1.0, 1.0))),
        placed(ball(), z=3.0, linear=np.zeros((3, 3))),
        placed(replace(quad(), normals=np.zeros((4, 3), np.float32))),
        placed(replace(quad(), normals=np.full((4, 3), np.nan, np.float32), uv0=np.full((4, 2), np.inf, np.float32))),
        placed(Mesh(rng.normal(size=(60, 3)).astype(np.float32), rng.integers(0, 60, (90, 3)).astype(np.uint32))),
    ]
    material = Material(
        base_color_texture=Texture(image_of(checks())), normal_texture=Texture(image_of(bumps())), double_sided=True
    )
    for look in LOOKS:
        for instance in odd:
            color = rendered(renderer, DrawList((replace(instance, material=material),)), camera(), look)
            assert color.shape == (36, 48, 3)
    nowhere = np.full((4, 4), np.nan)
    nowhere[0] = np.inf
    for look in LOOKS:
        color = rendered(renderer, DrawList((Instance(ball(), material, nowhere),)), camera(), look)
        assert (color == look.background).all()
    # A normal without direction is black, not random; the base colour is not NaN.
    black = rendered(renderer, DrawList((odd[4],)), camera(), Look("phong"))
    assert {tuple(c) for c in black.reshape(-1, 3)} == {(0, 0, 0), (204, 229, 255)}


def test_small_triangles_do_not_extrapolate(renderer: CpuRenderer) -> None:
    """Coverage is exact in 1/256 pixel, so a centre may lie beside a tiny triangle: its colours bound the pixel."""
    rng = np.random.default_rng(4)
    centers = rng.uniform(-1, 1, (4000, 1, 2))
    positions = np.concatenate(
        (centers + rng.normal(scale=0.02, size=(4000, 3, 2)), np.full((4000, 3, 1), 2.0)), axis=-1
    )
    colors = np.tile(np.array(((0.2, 0.5, 0.5, 1), (0.6, 0.5, 0.5, 1), (0.4, 0.5, 0.5, 1)), np.float32), (4000, 1))
    mesh = Mesh(
        positions.reshape(-1, 3).astype(np.float32), np.arange(12000, dtype=np.uint32).reshape(-1, 3), colors=colors
    )
    material = Material(unlit=True, double_sided=True)
    color = rendered(renderer, DrawList((Instance(mesh, material, np.eye(4)),)), camera(), Look("phong")).reshape(-1, 3)
    visible = color[(color != (204, 229, 255)).any(axis=-1)]
    assert len(visible) > 200
    assert visible[:, 0].min() >= 51
    assert visible[:, 0].max() <= 153
    assert (visible[:, 1:] == 128).all()
