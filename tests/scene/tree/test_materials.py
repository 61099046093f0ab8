"""Materials of geometries with a colour, and of mesh files that a command colours."""

import pytest

from gateway.scene.tree.materials import WHITE, material, tinted
from renderers.color import linear_from_srgb
from renderers.drawlist import AlphaMode, Material


@pytest.mark.parametrize(("alpha", "mode"), [(1.0, AlphaMode.OPAQUE), (0.999, AlphaMode.BLEND), (0.0, AlphaMode.BLEND)])
def test_directors_material(alpha: float, mode: AlphaMode) -> None:
    made = material((1.0, 0.5, 0.25, alpha))
    assert made.base_color == (1.0, linear_from_srgb(0.5), linear_from_srgb(0.25), alpha)
    assert (made.metallic, made.roughness, made.double_sided, made.alpha_mode) == (0.0, 1.0, True, mode)


def test_a_mesh_files_colour_is_multiplied_channel_by_channel() -> None:
    given = Material(base_color=(0.9, 0.8, 0.7, 0.6), alpha_mode=AlphaMode.MASK, metallic=0.25)
    made = tinted(given, (0.75, 0.5, 0.25, 0.5))
    assert made.base_color == pytest.approx(
        (0.9 * linear_from_srgb(0.75), 0.8 * linear_from_srgb(0.5), 0.7 * linear_from_srgb(0.25), 0.3)
    )
    assert (made.alpha_mode, made.metallic) == (AlphaMode.MASK, 0.25)
    assert tinted(given, WHITE) is given


@pytest.mark.parametrize(
    ("alpha", "before", "after"),
    [
        (1.0, AlphaMode.OPAQUE, AlphaMode.OPAQUE),
        (0.5, AlphaMode.OPAQUE, AlphaMode.BLEND),
        (0.5, AlphaMode.BLEND, AlphaMode.BLEND),
        (1.0, AlphaMode.BLEND, AlphaMode.BLEND),
    ],
)
def test_a_translucent_colour_makes_an_opaque_material_translucent(
    alpha: float, before: AlphaMode, after: AlphaMode
) -> None:
    assert tinted(Material(alpha_mode=before), (1.0, 0.5, 1.0, alpha)).alpha_mode is after
