"""Golden images of the studio look, one per feature: exact on every run and any number of threads.

``SCENEGATE_REGENERATE_PICTURES=1 pytest ...`` writes them anew; look at them before committing them.
"""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from renderers.drawlist import AlphaMode, DrawList, Instance, LightKind, Material, Texture
from renderers.interface import Look, Output, SampleCount
from renderers.light_rig import STUDIO, Rig
from renderers.raster import CpuRenderer
from tests.renderers.golden_images import assert_equal_to_golden
from tests.renderers.shading.studio.scenes import (
    DARK,
    KINDS,
    from_above,
    noise,
    rendered,
    sheet,
    slab_over_floor,
    translation,
    two_balls,
    view,
)


@pytest.fixture(scope="module", params=[1, 3], ids=["1 thread", "3 threads"])
def renderer(request: pytest.FixtureRequest) -> Iterator[CpuRenderer]:
    renderer = CpuRenderer(request.param)
    yield renderer
    renderer.close()


def floor(**material: Any) -> DrawList:
    mesh = sheet([(-2, 0.6, 0.6), (2, 0.6, 0.6), (2, 0.9, 30), (-2, 0.9, 30)], 4.0)
    return DrawList((Instance(mesh, Material(double_sided=True, **material), np.eye(4)),))


def glass() -> DrawList:
    """Translucent balls in front of one another."""
    green = Material((0.2, 0.8, 0.4, 0.4), metallic=0.0, roughness=0.2, alpha_mode=AlphaMode.BLEND, double_sided=True)
    red = replace(green, base_color=(0.9, 0.2, 0.2, 0.5))
    balls = two_balls().instances
    return DrawList(
        (
            Instance(balls[0].mesh, green, translation(-0.3, 0.0, 3.0)),
            Instance(balls[0].mesh, red, translation(0.4, 0.1, 3.4)),
            replace(balls[1], X_world_mesh=translation(0.0, -0.2, 4.6)),
        )
    )


PLAIN = replace(STUDIO, shadow_size=0)
SCENES: dict[str, tuple[DrawList, Rig, SampleCount]] = {
    "lights": (two_balls(), replace(DARK, lights=tuple(KINDS.values())), 1),
    "surroundings": (two_balls(ior=1.8, specular_color=(1.0, 0.8, 0.6)), PLAIN, 1),
    "textures": (floor(unlit=True, base_color_texture=Texture(noise())), DARK, 1),
    "normals": (
        floor(
            metallic=0.0, roughness=0.5, normal_texture=Texture(noise()), metallic_roughness_texture=Texture(noise())
        ),
        PLAIN,
        1,
    ),
    "glass": (glass(), PLAIN, 1),
    "samples": (two_balls(), PLAIN, 8),
    "glass_samples": (glass(), PLAIN, 4),
    "emission": (two_balls(emissive=(1.0, 0.4, 0.0), emissive_strength=3.0), PLAIN, 1),
}


def test_golden_images(renderer: CpuRenderer) -> None:
    camera = from_above()
    images = {name: rendered(renderer, scene, view(72, 54, 60.0), rig, n) for name, (scene, rig, n) in SCENES.items()}
    for kind in (LightKind.DIRECTIONAL, LightKind.SPOT):
        images[f"shadow_{kind.value}"] = rendered(
            renderer, slab_over_floor(kind), camera, replace(PLAIN, shadow_size=512)
        )
    assert_equal_to_golden("studio", **images)


def test_geometry_outputs_do_not_depend_on_the_look(renderer: CpuRenderer) -> None:
    """Depth, labels, instances and normals beside a studio image with samples are those without one."""
    geometry = Output.DEPTH | Output.LABEL | Output.INSTANCE | Output.NORMAL
    scene, camera = glass(), view()
    geometry_only = renderer.render(scene, camera, geometry)
    with_color = renderer.render(scene, camera, geometry | Output.COLOR, Look("studio", samples=8))
    for name in ("depth", "label", "instance", "normal"):
        assert np.array_equal(getattr(geometry_only, name), getattr(with_color, name))


def test_empty_scene(renderer: CpuRenderer) -> None:
    counts: tuple[SampleCount, ...] = (1, 4)
    for samples in counts:
        color = rendered(renderer, DrawList(), view(), STUDIO, samples, background=(1, 2, 3))
        assert (color == (1, 2, 3)).all()
