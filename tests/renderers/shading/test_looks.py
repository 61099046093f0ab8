"""The phong and pbr looks against the reference, within one level of 255."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from renderers.camera import Camera
from renderers.drawlist import DrawList, Image, Material, Mesh, Sampler, Texture
from renderers.interface import Look, LookName
from renderers.shading import paint, prepare
from renderers.shading.materials import COLORS_DECODE, COLORS_REPLACE, look_material, vertex_color_rule
from tests.renderers.shading.reference import (
    UNFILTERED,
    Array,
    BruteForce,
    ball,
    camera,
    image_of,
    painted,
    placed,
    quad,
    reference_color,
)

RNG = np.random.default_rng(7)
ROTATED = np.array(((0.8, -0.6, 0.0), (0.48, 0.64, -0.6), (0.36, 0.48, 0.8)))
"""A rotation."""
SQUASHED = ROTATED @ np.diag((1.0, 0.4, 0.7))
MIRRORED = ROTATED @ np.diag((1.0, -0.6, 1.0))


def noise(size: int = 8, lowest: int = 0) -> Texture:
    pixels = RNG.integers(lowest, 256, (size, size + 3, 4)).astype(np.uint8)
    pixels[..., 3] = 255
    return Texture(image_of(pixels), UNFILTERED)


def colored(mesh: Mesh) -> Mesh:
    colors = RNG.random((len(mesh.positions), 4)).astype(np.float32)
    colors[:, 3] = 1
    return replace(mesh, colors=colors)


def assert_same(scene: DrawList, look: Look, view: Camera | None = None, *, max_wrong: float = 0.0) -> Array:
    """Compare every channel with the reference, within one level, half of which is rounding.

    Args:
        max_wrong: share of pixels that may differ: at edges, float32 depth may pick the other triangle.
    """
    view = view or camera()
    ours, expected = painted(scene, view, look), reference_color(scene, view, look)
    wrong = (np.abs(ours - expected) > 1.0).any(axis=-1)
    assert wrong.mean() <= max_wrong, (wrong.sum(), ours[wrong][:3], expected[wrong][:3])
    assert (expected != np.array(look.background)).any(), "nothing was drawn"
    return expected


FULL = Material(
    base_color=(0.9, 0.7, 0.8, 1.0),
    base_color_texture=noise(),
    metallic=0.8,
    roughness=0.7,
    metallic_roughness_texture=noise(),
    normal_texture=noise(lowest=96),
    normal_scale=0.6,
    occlusion_texture=noise(),
    occlusion_strength=0.5,
    emissive=(0.1, 0.02, 0.05),
    emissive_texture=noise(),
)
MATERIALS = {
    "plain": Material(base_color=(0.9, 0.5, 0.2, 1.0), metallic=0.0, roughness=0.6),
    "metal": Material(base_color=(0.9, 0.8, 0.4, 1.0), metallic=1.0, roughness=0.3),
    "mirror": Material(base_color=(0.9, 0.8, 0.4, 1.0), metallic=1.0, roughness=0.0),
    "half metal, double sided": Material(metallic=0.5, roughness=0.4, double_sided=True),
    "vtk": Material(base_color=(0.3, 0.6, 0.9, 1.0), metallic=0.0, roughness=1.0, double_sided=True, vtk_export=True),
    "unlit": Material(base_color=(0.3, 0.6, 0.9, 1.0), base_color_texture=noise(), unlit=True, emissive=(1, 1, 1)),
    "textures": FULL,
    "base texture": Material(base_color_texture=noise(), metallic=0.0),
    "second coordinates": Material(base_color_texture=replace(noise(), uv_set=1), metallic=0.0),
    "transformed": Material(
        base_color_texture=replace(noise(), uv_transform=(1.5, 0.4, -0.3, -0.7, 1.2, 0.1)), metallic=0.0
    ),
}


@pytest.mark.parametrize("look", ["phong", "pbr", "gltf"])
@pytest.mark.parametrize("name", MATERIALS)
def test_ball_matches_the_reference(look: LookName, name: str) -> None:
    mesh = ball()
    mesh = replace(mesh, uv1=np.ascontiguousarray(mesh.uv0[:, ::-1]))
    assert_same(DrawList((placed(mesh, MATERIALS[name], z=3.0, linear=ROTATED),)), Look(look))


@pytest.mark.parametrize("linear", [ROTATED, SQUASHED, MIRRORED], ids=["rotated", "squashed", "mirrored"])
@pytest.mark.parametrize("look", ["phong", "pbr", "gltf"])
def test_affine_transforms_of_normals_and_tangents(look: LookName, linear: Array) -> None:
    assert_same(DrawList((placed(ball(), FULL, z=3.0, linear=linear),)), Look(look))


def test_a_mirrored_ball_is_lit_as_bright_as_its_original() -> None:
    original = painted(DrawList((placed(ball(16), z=3.0),)), camera(), Look("gltf"))
    mirrored = painted(DrawList((placed(ball(16), z=3.0, linear=np.diag((1.0, 1.0, -1.0))),)), camera(), Look("gltf"))
    assert np.abs(original - mirrored).mean() < 1.0


@pytest.mark.parametrize("look", ["phong", "pbr"])
def test_vtk_shows_a_mirrored_ball_black(look: LookName) -> None:
    mirrored = DrawList((placed(ball(16), z=3.0, linear=np.diag((1.0, 1.0, -1.0))),))
    assert painted(mirrored, camera(), Look(look))[18, 24].max() <= 20


@pytest.mark.parametrize("look", ["phong", "pbr"])
def test_triangles_without_normals_are_flat(look: LookName) -> None:
    mesh = replace(ball(), normals=None)
    assert_same(DrawList((placed(mesh, z=3.0, linear=SQUASHED),)), Look(look))
    assert_same(DrawList((placed(mesh, z=3.0, linear=MIRRORED),)), Look(look))


@pytest.mark.parametrize("normals", [True, False])
def test_a_back_face_is_lit_from_behind_when_both_sides_show(normals: bool) -> None:
    mesh = quad() if normals else replace(quad(), normals=None)
    material = Material(base_color=(1.0, 0.5, 0.25, 1.0), double_sided=True)
    front = painted(DrawList((placed(mesh, material),)), camera(), Look("phong"))
    turned = placed(mesh, material, z=4.0, linear=np.diag((-1.0, 1.0, -1.0)))
    back = painted(DrawList((turned,)), camera(), Look("phong"))
    assert (front[18, 24] == (255, 128, 64)).all()
    assert (front == back).all()


def test_a_back_face_of_a_single_sided_material_is_not_seen() -> None:
    turned = placed(quad(), z=4.0, linear=np.diag((-1.0, 1.0, -1.0)))
    assert (painted(DrawList((turned,)), camera(), Look()) == (204, 229, 255)).all()


@pytest.mark.parametrize("look", ["phong", "pbr", "gltf"])
@pytest.mark.parametrize("unlit", [False, True])
def test_vertex_colors(look: LookName, unlit: bool) -> None:
    material = Material(base_color=(1.0, 0.5, 0.25, 1.0), metallic=0.0, unlit=unlit)
    assert_same(DrawList((placed(colored(ball()), material, z=3.0, linear=ROTATED),)), Look(look))


def test_triangles_clipped_by_the_near_plane() -> None:
    """Some vertices lie behind the camera; interpolation stays exact."""
    ground = np.array(((-5, 0.5, -4), (-5, 0.5, 30), (5, 0.5, 30), (5, 0.5, -4)), np.float32)
    mesh = replace(quad(), positions=ground, normals=np.tile(np.array((0, -0.8, -0.6), np.float32), (4, 1)))
    material = Material(base_color_texture=noise(), metallic=0.0, double_sided=True)
    assert_same(DrawList((placed(mesh, material),)), Look("phong"))


def test_phong_is_exact_on_a_plane() -> None:
    """Facts of RenderEngineVtk: 255 * base * max(0, n . z), rounded, no gamma."""
    tilted = np.array(((1.0, 0.0, 0.0), (0.0, 0.8, 0.6), (0.0, -0.6, 0.8)))
    scene = DrawList((placed(quad(z=0.0), Material(base_color=(1.0, 0.3, 0.7, 1.0)), z=2.0, linear=tilted),))
    assert (painted(scene, camera(), Look("phong"))[18, 24] == np.round(255 * 0.8 * np.array((1.0, 0.3, 0.7)))).all()


def test_background_is_as_stored_in_both_looks() -> None:
    for look in ("phong", "pbr"):
        empty = painted(DrawList(), camera(), Look(look, (1, 2, 3)))
        assert (empty == (1, 2, 3)).all()


def test_lines_and_points_show_their_color_unlit() -> None:
    view = camera()
    ends = np.array(((-0.8, -0.5, 2.0), (0.8, 0.5, 4.0)), np.float32)
    colors = np.array(((1, 0, 0.5, 1), (0, 1, 0.5, 1)), np.float32)
    line = Mesh(ends, np.array(((0, 1),), np.uint32), colors=colors)
    color = painted(DrawList((placed(line, Material(base_color=(1.0, 1.0, 0.5, 1.0))),)), view, Look("phong"))
    is_drawn = (color != (204, 229, 255)).any(axis=-1)
    # Perspective-correct: the middle of the line in the image is nearer to the near end.
    ys, xs = np.nonzero(is_drawn)
    for x, y in zip(xs, ys, strict=True):
        ray = np.array(((x + 0.5 - view.cx) / view.fx, (y + 0.5 - view.cy) / view.fy))
        samples = ends[0] + np.linspace(0, 1, 2001)[:, None] * (ends[1] - ends[0])
        t = np.linspace(0, 1, 2001)[np.abs(samples[:, :2] / samples[:, 2:] - ray).sum(axis=1).argmin()]
        expected = 255 * np.array((1 - t, t, 0.25))
        assert np.abs(color[y, x] - expected).max() <= 255 * 0.02
    points = Mesh(ends, np.array(((0,), (1,)), np.uint32), colors=colors)
    color = painted(DrawList((placed(points),)), view, Look("pbr"))
    is_drawn = (color != (204, 229, 255)).any(axis=-1)
    assert {tuple(pixel) for pixel in color[is_drawn]} == {(255, 0, 128), (0, 255, 128)}


def test_look_material() -> None:
    vtk = Material(metallic=0.0, roughness=1.0, vtk_export=True)
    assert look_material(vtk, "pbr").roughness == 0.5
    assert look_material(replace(vtk, vtk_export=False), "pbr").roughness == 1.0
    plain = look_material(FULL, "phong")
    assert (plain.normal_texture, plain.occlusion_texture, plain.emissive) == (None, None, (0.0, 0.0, 0.0))
    assert look_material(FULL, "gltf").occlusion_texture is None
    assert look_material(FULL, "studio").occlusion_texture is not None
    assert plain.base_color_texture.image is FULL.base_color_texture.image
    assert vertex_color_rule(FULL, "phong") == 0
    assert vertex_color_rule(FULL, "pbr") == COLORS_DECODE | COLORS_REPLACE
    assert vertex_color_rule(replace(FULL, decodes_vertex_colors=False), "pbr") == COLORS_REPLACE
    assert vertex_color_rule(FULL, "gltf") == 0
    assert vertex_color_rule(Material(unlit=True), "pbr") == COLORS_DECODE


def test_a_look_decodes_only_the_textures_it_uses() -> None:
    def never() -> np.ndarray:
        raise AssertionError("decoded")

    unseen = Texture(Image(b"unseen", never), Sampler())
    material = replace(Material(), normal_texture=unseen, emissive_texture=unseen, occlusion_texture=unseen)
    prepare((placed(quad(), material),), "phong")
    prepare((placed(quad(), replace(Material(), emissive_texture=unseen)),), "pbr")  # emissive factor 0
    with pytest.raises(AssertionError, match="decoded"):
        prepare((placed(quad(), material),), "pbr")


def test_rejects_a_scene_prepared_for_another_look() -> None:
    scene, view = DrawList((placed(quad()),)), camera()
    color = np.zeros((view.height, view.width, 3), np.uint8)
    prepared = prepare(scene.instances, "pbr")
    with pytest.raises(ValueError, match="prepared for the look 'pbr'"):
        paint(BruteForce(), scene, prepared, view, Look("phong"), color)


@pytest.mark.parametrize("name", ["normals", "uv0", "uv1", "colors", "tangents"])
def test_rejects_attributes_of_wrong_length_or_dtype(name: str) -> None:
    """Kernels would read out of bounds."""
    columns = {"normals": 3, "uv0": 2, "uv1": 2, "colors": 4, "tangents": 4}[name]
    short: dict[str, Any] = {name: np.zeros((3, columns), np.float32)}
    with pytest.raises(ValueError, match=f"mesh with 4 vertices: {name} has shape"):
        prepare((placed(quad(**short)),), "phong")
    wide: dict[str, Any] = {name: np.zeros((4, columns))}
    with pytest.raises(TypeError, match="float32"):
        prepare((placed(quad(**wide), FULL),), "pbr")


def test_plain_look_encodes_the_base_color() -> None:
    """A linear factor that encodes to sRGB 0.5 gives 0.5 in the image; phong shows the factor itself."""
    material = Material(base_color=(0.21404114, 0.0, 1.0, 0.25), metallic=0.0, emissive=(1.0, 0.0, 0.0))
    plain = look_material(material, "plain")
    assert plain.base_color == pytest.approx((0.5, 0.0, 1.0, 0.25), abs=1e-6)
    assert plain.emissive == (0.0, 0.0, 0.0)
    assert look_material(material, "phong").base_color == material.base_color


@pytest.mark.parametrize(("look", "level"), [("plain", 188), ("phong", 128)])
def test_the_plain_look_shows_linear_vertex_colours_as_srgb(look: LookName, level: int) -> None:
    colors = np.tile(np.array((0.5, 0.5, 0.5, 1.0), np.float32), (4, 1))
    instance = placed(replace(quad(), colors=colors), Material(double_sided=True, unlit=True))
    color = painted(DrawList((instance,)), camera(), Look(look))
    height, width, _ = color.shape
    assert color[height // 2, width // 2].tolist() == [level] * 3
