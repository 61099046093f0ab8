"""Depth peeling: blending and alpha masks."""

import itertools
from dataclasses import replace
from unittest.mock import Mock

import numpy as np
import pytest

from renderers.color import srgb_values_from_linear
from renderers.drawlist import AlphaMode, DrawList, Instance, Material, Mesh, Texture
from renderers.interface import Look, LookName
from renderers.raster import CpuRenderer
from renderers.shading import prepare
from renderers.shading.depth_peeling import MAX_LAYERS
from tests.renderers.shading.reference import (
    UNFILTERED,
    assert_as_reference,
    ball,
    camera,
    image_of,
    painted,
    placed,
    quad,
)

BLEND, MASK = AlphaMode.BLEND, AlphaMode.MASK
GLASS = Material(base_color=(0.2, 0.9, 0.3, 0.3), metallic=0.0, alpha_mode=BLEND, double_sided=True)
BLUE = Material(base_color=(0.2, 0.4, 1.0, 0.4), metallic=0.0, alpha_mode=BLEND, double_sided=True)
WALL = Material(base_color=(0.9, 0.2, 0.2, 1.0), metallic=0.0, double_sided=True)
VIEW = camera(32, 24, focal=28.0)


def crossing() -> tuple[Instance, ...]:
    """Return two glass balls that intersect each other and a glass pane, before a wall that fills half of the image."""
    tilt = np.array(((0.8, 0.0, -0.6), (0.0, 1.0, 0.0), (0.6, 0.0, 0.8)))
    wall = replace(quad(2.0, 6.0), positions=quad(2.0, 6.0).positions + np.array((2.1, 0, 0), np.float32))
    return (
        placed(ball(5), GLASS, z=3.0, linear=tilt),
        placed(ball(4), BLUE, z=3.6, linear=tilt.T),
        placed(quad(1.2, 0.0), replace(GLASS, base_color=(0.9, 0.9, 0.1, 0.5)), z=3.0, linear=tilt),
        placed(wall, WALL),
    )


def noise(shape: tuple[int, int] = (6, 7)) -> Texture:
    pixels = np.random.default_rng(5).integers(0, 256, (*shape, 4)).astype(np.uint8)
    return Texture(image_of(pixels), UNFILTERED)


@pytest.mark.parametrize("look", ["plain", "gltf"])
def test_translucent_surfaces_are_sorted_per_pixel(look: LookName) -> None:
    assert_as_reference(DrawList(crossing()), Look(look), VIEW, exceptions=1)  # where two cross


@pytest.mark.parametrize("look", ["phong", "pbr"])
@pytest.mark.parametrize("order", [(0, 1, 2, 3), (3, 2, 1, 0), (2, 3, 0, 1)])
def test_vtk_blends_translucent_surfaces_in_the_order_of_the_draw_list(look: LookName, order: tuple[int, ...]) -> None:
    instances = crossing()
    assert_as_reference(DrawList(tuple(instances[k] for k in order)), Look(look), VIEW, exceptions=1)


def test_the_order_of_the_draw_list_does_not_matter_to_the_others() -> None:
    images = [painted(DrawList(order), VIEW, Look("plain")) for order in [*itertools.permutations(crossing())][::3]]
    assert all((image == images[0]).all() for image in images)


@pytest.mark.parametrize("look", ["phong", "plain", "pbr", "gltf"])
@pytest.mark.parametrize("mode", [BLEND, MASK, AlphaMode.OPAQUE])
@pytest.mark.parametrize("factor", [0.9, 1.0])
@pytest.mark.parametrize("vtk_export", [False, True])
def test_alpha_of_a_texture(look: LookName, mode: AlphaMode, factor: float, vtk_export: bool) -> None:
    tilt = np.array(((0.8, 0.0, -0.6), (0.0, 1.0, 0.0), (0.6, 0.0, 0.8)))
    material = Material(
        base_color=(1.0, 0.8, 0.6, factor),
        base_color_texture=noise(),
        metallic=0.0,
        alpha_mode=mode,
        alpha_cutoff=0.4,
        double_sided=True,
        vtk_export=vtk_export,
    )
    scene = DrawList((placed(ball(6), material, z=3.0, linear=tilt), placed(quad(2.0, 6.0), WALL)))
    assert_as_reference(scene, Look(look), VIEW, exceptions=2)  # an alpha may go either way at the cutoff


@pytest.mark.parametrize("look", ["phong", "pbr"])
def test_vtk_does_not_draw_what_a_texture_cuts_out(look: LookName) -> None:
    """Behind a hole is the ball's inside and a wall, whatever is drawn first."""
    pixels = np.full((8, 8, 4), 255, np.uint8)
    pixels[:4, :, 3] = 0
    sampler = replace(UNFILTERED, mag_linear=False, min_linear=False)
    material = Material(base_color_texture=Texture(image_of(pixels), sampler), metallic=0.0, double_sided=True)
    scene = (placed(ball(6), material, z=3.0), placed(quad(2.0, 6.0), WALL))
    for order in (scene, scene[::-1]):
        assert_as_reference(DrawList(order), Look(look), VIEW, exceptions=7)  # of texels at the border of the hole


def test_alpha_of_vertices() -> None:
    colors = np.array(((1, 0, 0, 0.1), (0, 1, 0, 0.9), (0, 0, 1, 0.5), (1, 1, 1, 0.0)), np.float32)
    scene = DrawList(
        (placed(quad(0.95, colors=colors), replace(GLASS, base_color=(1, 1, 1, 1))), placed(quad(2.0, 6.0), WALL))
    )
    assert_as_reference(scene, Look(), VIEW)


def test_coplanar_translucent_surfaces_are_each_drawn_once() -> None:
    twice = DrawList((placed(quad(), GLASS), placed(quad(), BLUE)))
    color = painted(twice, VIEW, Look("plain"))[12, 16] / 255.0
    blue, green = (srgb_values_from_linear(np.array(material.base_color[:3])) for material in (BLUE, GLASS))
    under = np.array((204, 229, 255)) / 255 * 0.7 + green * 0.3
    np.testing.assert_allclose(color, under * 0.6 + blue * 0.4, atol=0.6 / 255)


@pytest.mark.parametrize("panes", [MAX_LAYERS - 1, MAX_LAYERS, MAX_LAYERS + 3])
def test_number_of_layers_is_limited(panes: int) -> None:
    red = replace(GLASS, base_color=(1.0, 0, 0, 0.02))
    stack = tuple(placed(quad(z=2.0 + 0.1 * k), red) for k in range(panes))
    wall = placed(quad(9.0, 9.0), replace(WALL, base_color=(0, 0, 1, 1)))
    color = painted(DrawList((*stack, wall)), camera(8, 6, focal=7.0), Look())[3, 4]
    transmittance = 0.98 ** min(panes, MAX_LAYERS)
    assert np.abs(color - 255 * np.array((1 - transmittance, 0, transmittance))).max() <= 0.51


def test_peeling_stops_behind_opaque_layers(monkeypatch: pytest.MonkeyPatch) -> None:
    """A stack of masked quads without visible holes takes few passes."""
    solid = np.full((2, 2, 4), 255, np.uint8)
    solid[0, 0, 3] = 0  # makes it a cut-out, though no pixel shows this texel
    scrap = Texture(image_of(solid), uv_transform=(0.0, 0.0, 0.75, 0.0, 0.0, 0.75))
    material = Material(base_color_texture=scrap, alpha_mode=MASK, metallic=0.0)
    renderer = CpuRenderer(threads=1)
    visibility = Mock(wraps=renderer.visibility)
    monkeypatch.setattr(renderer, "visibility", visibility)
    stack = tuple(placed(quad(2.0, 2.0 + 0.1 * i), material) for i in range(8))
    painted(DrawList(stack), VIEW, Look("gltf"), renderer)
    assert visibility.call_count == 3  # behind the stack, its first layer, nothing more


@pytest.mark.parametrize(
    ("material", "mesh", "layered"),
    [
        (GLASS, quad(), True),
        (replace(GLASS, base_color=(1, 1, 1, 1)), quad(), False),
        (replace(GLASS, base_color=(1, 1, 1, 1), base_color_texture=noise()), quad(), True),
        (replace(GLASS, base_color=(1, 1, 1, 1)), quad(colors=np.ones((4, 4), np.float32)), True),
        (replace(GLASS, alpha_mode=MASK, alpha_cutoff=0.2), quad(), False),
        (replace(GLASS, alpha_mode=MASK, alpha_cutoff=0.5), quad(), True),
        (replace(GLASS, alpha_mode=AlphaMode.OPAQUE), quad(), False),
    ],
)
def test_only_translucent_instances_are_peeled(material: Material, mesh: Mesh, layered: bool) -> None:
    assert prepare((placed(mesh, material),), "gltf").has_transparency is layered
