from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from gateway.files.assets.mesh_formats import without_broken_textures
from gateway.scene.tree import transforms as tf
from gateway.scene.tree.geometry import Part
from renderers.drawlist import Image, ImageError, Material, Texture
from scenegate.messages.geometry import Box

TEXTURE_FIELDS = (
    "base_color_texture",
    "metallic_roughness_texture",
    "normal_texture",
    "occlusion_texture",
    "emissive_texture",
)


def image(height: int, width: int) -> Image:
    return Image(b"", lambda: np.zeros((height, width, 4), np.uint8))


def broken_image() -> Image:
    def decode() -> np.ndarray:
        raise ImageError("broken")

    return Image(b"", decode)


def part(material: Material) -> Part:
    return Part(Box((1, 2, 3)), material, tf.translation(1, 2, 3), "box", "box.obj")


@pytest.mark.parametrize("field", TEXTURE_FIELDS)
def test_a_broken_texture_is_removed_and_everything_else_stays(field: str) -> None:
    textures: dict[str, Any] = {name: Texture(image(1, 1)) for name in TEXTURE_FIELDS}
    original = part(Material(base_color=(1, 0, 0, 1), **{**textures, field: Texture(broken_image())}))
    (repaired,) = without_broken_textures((original,), 100, [])
    assert repaired.material == replace(original.material, **{field: None})
    assert repaired.shape is original.shape
    assert repaired.X_node_part is original.X_node_part
    assert (repaired.kind, repaired.source) == ("box", "box.obj")


def test_parts_without_broken_textures_are_the_same_object() -> None:
    parts = (part(Material()), part(Material(base_color_texture=Texture(image(2, 3)))))
    assert without_broken_textures(parts, 6, []) is parts


@pytest.mark.parametrize(
    ("max_pixels", "kept"),
    [(3, [False, False]), (5, [False, True]), (6, [True, False]), (9, [True, False]), (10, [True, True])],
)
def test_textures_beyond_the_pixels_of_all_together_are_removed(max_pixels: int, kept: list[bool]) -> None:
    """The first has 6 pixels, the second 4. A texture that is left out takes nothing from those after it."""
    parts = tuple(part(Material(base_color_texture=Texture(image(*size)))) for size in ((2, 3), (1, 4)))
    warnings: list[str] = []
    repaired = without_broken_textures(parts, max_pixels, warnings)
    assert len(warnings) == kept.count(False)
    assert all("are left to all textures" in text for text in warnings)
    assert [entry.material.base_color_texture is not None for entry in repaired] == kept


def test_an_image_of_several_textures_counts_once_and_is_decoded_once() -> None:
    decoded = []

    def decode() -> np.ndarray:
        decoded.append(1)
        return np.zeros((2, 3, 4), np.uint8)

    shared = Image(b"", decode)
    materials = (
        Material(base_color_texture=Texture(shared), emissive_texture=Texture(shared)),
        Material(base_color=(0, 1, 0, 1), normal_texture=Texture(shared)),
    )
    parts = tuple(map(part, materials))
    assert without_broken_textures(parts, 6, []) is parts
    assert len(decoded) == 1
