"""The phong and pbr looks against the reference, within one level of 255."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from renderers.drawlist import DrawList, Image, Material, Sampler, Texture
from renderers.interface import Look, LookName
from renderers.shading import paint, prepare
from renderers.shading.materials import COLORS_DECODE, COLORS_REPLACE, vertex_color_rule
from tests.renderers.shading.reference import (
    RENDERER,
    UNFILTERED,
    Array,
    assert_as_reference,
    ball,
    camera,
    image_of,
    painted,
    placed,
    quad,
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
    assert_as_reference(DrawList((placed(mesh, MATERIALS[name], z=3.0, linear=ROTATED),)), Look(look))


@pytest.mark.parametrize("linear", [ROTATED, SQUASHED, MIRRORED], ids=["rotated", "squashed", "mirrored"])
@pytest.mark.parametrize("look", ["phong", "pbr", "gltf"])
def test_affine_transforms_of_normals_and_tangents(look: LookName, linear: Array) -> None:
    assert_as_reference(DrawList((placed(ball(), FULL, z=3.0, linear=linear),)), Look(look))


@pytest.mark.parametrize("look", ["phong", "pbr"])
def test_vtk_shows_a_mirrored_ball_black(look: LookName) -> None:
    mirrored = DrawList((placed(ball(16), z=3.0, linear=np.diag((1.0, 1.0, -1.0))),))
    assert painted(mirrored, camera(), Look(look))[18, 24].max() <= 20


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


def test_triangles_clipped_by_the_near_plane() -> None:
    """Some vertices lie behind the camera; interpolation stays exact."""
    ground = np.array(((-5, 0.5, -4), (-5, 0.5, 30), (5, 0.5, 30), (5, 0.5, -4)), np.float32)
    mesh = replace(quad(), positions=ground, normals=np.tile(np.array((0, -0.8, -0.6), np.float32), (4, 1)))
    material = Material(base_color_texture=noise(), metallic=0.0, double_sided=True)
    assert_as_reference(DrawList((placed(mesh, material),)), Look("phong"))


def test_phong_is_exact_on_a_plane() -> None:
    """Facts of RenderEngineVtk: 255 * base * max(0, n . z), rounded, no gamma."""
    tilted = np.array(((1.0, 0.0, 0.0), (0.0, 0.8, 0.6), (0.0, -0.6, 0.8)))
    scene = DrawList((placed(quad(z=0.0), Material(base_color=(1.0, 0.3, 0.7, 1.0)), z=2.0, linear=tilted),))
    assert (painted(scene, camera(), Look("phong"))[18, 24] == np.round(255 * 0.8 * np.array((1.0, 0.3, 0.7)))).all()


def test_vertex_colors_of_pbr() -> None:
    assert vertex_color_rule(FULL, "pbr") == COLORS_DECODE | COLORS_REPLACE
    assert vertex_color_rule(replace(FULL, decodes_vertex_colors=False), "pbr") == COLORS_REPLACE
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
        paint(RENDERER, scene, prepared, view, Look("phong"), color)


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


@pytest.mark.parametrize(("look", "level"), [("plain", 188), ("phong", 128)])
def test_the_plain_look_shows_linear_vertex_colours_as_srgb(look: LookName, level: int) -> None:
    colors = np.tile(np.array((0.5, 0.5, 0.5, 1.0), np.float32), (4, 1))
    instance = placed(replace(quad(), colors=colors), Material(double_sided=True, unlit=True))
    color = painted(DrawList((instance,)), camera(), Look(look))
    height, width, _ = color.shape
    assert color[height // 2, width // 2].tolist() == [level] * 3
