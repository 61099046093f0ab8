"""Converts the materials and textures of a compiled MuJoCo model."""

import hashlib
from typing import Any

import numpy as np
from numpy.typing import NDArray

from gateway.scene.tree.materials import mean_color
from renderers.color import linear_from_srgb
from renderers.drawlist import AlphaMode, Image, Material, Texture

_UNSET_RGBA = (0.5, 0.5, 0.5, 1.0)
"""MuJoCo's default of ``geom_rgba``. A geometry with this value gets the colour of its material."""


class MjcfMaterials:
    """Materials of geometries, by the index of the geometry. The pixels of each texture are read once."""

    def __init__(self, mujoco: Any, model: Any) -> None:
        self._model = model
        self._color_roles = (int(mujoco.mjtTextureRole.mjTEXROLE_RGB), int(mujoco.mjtTextureRole.mjTEXROLE_RGBA))
        self._texture_2d = int(mujoco.mjtTexture.mjTEXTURE_2D)
        self._cube_map = int(mujoco.mjtTexture.mjTEXTURE_CUBE)
        self._images: dict[int, Image] = {}
        self._plain: dict[int, bool] = {}
        """True for textures of one colour."""
        self._mean_colors: dict[int, tuple[float, float, float]] = {}
        """Mean colours of textures, linear."""

    def rgba(self, geom: int) -> tuple[float, float, float, float]:
        """Return the colour of a geometry without its texture: sRGB and opacity, as in the file."""
        model = self._model
        r, g, b, a = model.geom_rgba[geom].tolist()
        if (r, g, b, a) == _UNSET_RGBA and model.geom_matid[geom] >= 0:
            r, g, b, a = model.mat_rgba[model.geom_matid[geom]].tolist()
        return r, g, b, a

    def material(self, geom: int, has_uv: bool) -> Material:
        """Return the material of a geometry; without coordinates for its texture, it has the texture's mean colour."""
        model = self._model
        r, g, b, alpha = np.clip(self.rgba(geom), 0.0, 1.0).tolist()
        color = np.array([linear_from_srgb(channel) for channel in (r, g, b)])
        material_index, texture = int(model.geom_matid[geom]), None
        metallic, roughness, emission = 0.0, _roughness(0.5), 0.0
        if material_index >= 0:
            metallic = max(0.0, float(model.mat_metallic[material_index]))
            roughness = float(model.mat_roughness[material_index])
            if roughness < 0.0:  # the file does not set it
                roughness = _roughness(float(model.mat_shininess[material_index]))
            emission = float(model.mat_emission[material_index])
            texture_index = self._color_texture(material_index)
            if texture_index is not None and has_uv:
                texture = Texture(self._image(texture_index), name=f"texture {texture_index}")
            elif texture_index is not None:
                if texture_index not in self._mean_colors:
                    self._mean_colors[texture_index] = mean_color(self._image(texture_index))
                color = color * self._mean_colors[texture_index]
        red, green, blue = color.tolist()
        return Material(
            base_color=(red, green, blue, alpha),
            base_color_texture=texture,
            metallic=metallic,
            roughness=roughness,
            emissive=(emission * red, emission * green, emission * blue),
            alpha_mode=AlphaMode.BLEND if alpha < 1.0 else AlphaMode.OPAQUE,
            double_sided=True,
        )

    def _color_texture(self, material: int) -> int | None:
        textures = (int(self._model.mat_texid[material][role]) for role in self._color_roles)
        return next((index for index in textures if index >= 0), None)

    def has_image(self, geom: int) -> bool:
        """Return True if a geometry's material has a texture for coordinates u and v."""
        material = int(self._model.geom_matid[geom])
        texture = self._color_texture(material) if material >= 0 else None
        return texture is not None and int(self._model.tex_type[texture]) == self._texture_2d

    def cube_map(self, geom: int) -> tuple[int, int] | None:
        """Return the side length, in texels, and the number of images of a geometry's cube map; None if it shows none.

        The map is one image for all faces, or six in a column. None also if all its texels are equal.
        """
        model, material = self._model, int(self._model.geom_matid[geom])
        texture = self._color_texture(material) if material >= 0 else None
        if texture is None or int(model.tex_type[texture]) != self._cube_map:
            return None
        height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
        if texture not in self._plain:
            pixels = self._image(texture).decode()
            self._plain[texture] = bool((pixels == pixels[0, 0]).all())
        return None if height not in (width, 6 * width) or self._plain[texture] else (width, height // width)

    def texture_repeats(self, geom: int) -> NDArray[np.float64]:
        """Return the factors of a geometry's texture coordinates, (2,), where 0 to 1 is its whole length.

        With ``texuniform`` MuJoCo also multiplies by the half lengths in metres: a texture is 2 m / texrepeat large.
        """
        model, index = self._model, int(self._model.geom_matid[geom])
        if index < 0:
            return np.ones(2)
        repeats = np.asarray(model.mat_texrepeat[index], np.float64)
        half_lengths = np.asarray(model.geom_size[geom][:2], np.float64)
        return repeats * np.where(half_lengths > 0.0, half_lengths, 1.0) if model.mat_texuniform[index] else repeats

    def _pixels(self, texture: int) -> NDArray[np.uint8]:
        """Return the pixels of a texture, (H, W, 4) uint8, top row first."""
        model = self._model
        height, width = int(model.tex_height[texture]), int(model.tex_width[texture])
        channels, start = int(model.tex_nchannel[texture]), int(model.tex_adr[texture])
        data = model.tex_data[start : start + height * width * channels].reshape(height, width, channels)
        pixels = np.full((height, width, 4), 255, np.uint8)
        pixels[..., :3] = data[..., :3] if channels >= 3 else data[..., :1]
        if channels == 4:
            pixels[..., 3] = data[..., 3]
        return pixels

    def _image(self, texture: int) -> Image:
        if texture not in self._images:
            pixels = self._pixels(texture)
            self._images[texture] = Image(hashlib.sha256(pixels.tobytes()).digest(), lambda: pixels)
        return self._images[texture]


def _roughness(shininess: float) -> float:
    """Return the glTF roughness for MuJoCo's shininess: the exponent of Phong highlights divided by 128.

    A microfacet distribution with alpha = roughness² has highlights as wide as Phong's of exponent 2 / alpha² - 2.
    """
    return float((2.0 / (128.0 * max(0.0, shininess) + 2.0)) ** 0.25)
