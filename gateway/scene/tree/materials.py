"""Materials of geometries that clients publish with a colour."""

from dataclasses import replace
from functools import lru_cache
from typing import Final

from renderers.color import linear_from_srgb
from renderers.drawlist import AlphaMode, Image, ImageError, Material, Sampler, Texture, Wrap

Color = tuple[float, float, float, float]
"""Red, green, blue (sRGB) and alpha from 0 to 1."""
TEXTURE_FIELDS: Final = (
    "base_color_texture",
    "metallic_roughness_texture",
    "normal_texture",
    "occlusion_texture",
    "emissive_texture",
)
"""Fields of ``Material`` that are textures."""
WHITE: Final[Color] = (1.0, 1.0, 1.0, 1.0)
POINT_SIZE: Final = 2.0
"""Width of points in pixels, as in Director."""
_CLAMPED: Final = Sampler(wrap_s=Wrap.CLAMP_TO_EDGE, wrap_t=Wrap.CLAMP_TO_EDGE)


def mean_color(image: Image) -> tuple[float, float, float]:
    """Return the mean colour of an image, linear; white if it cannot be decoded."""
    try:
        mean = image.decode()[..., :3].reshape(-1, 3).mean(axis=0) / 255.0
    except ImageError:
        return 1.0, 1.0, 1.0
    red, green, blue = map(linear_from_srgb, mean.tolist())
    return red, green, blue


def material(rgba: Color, point_size: float = POINT_SIZE, line_width: float = 1.0) -> Material:
    """Return a diffuse, double-sided material of a colour, the same object for equal arguments. Sizes in pixels."""
    return _material(rgba, point_size, line_width)


@lru_cache(maxsize=4096)
def _material(rgba: Color, point_size: float, line_width: float) -> Material:
    r, g, b, a = rgba
    return Material(
        base_color=(linear_from_srgb(r), linear_from_srgb(g), linear_from_srgb(b), a),
        metallic=0.0,
        roughness=1.0,
        alpha_mode=AlphaMode.BLEND if a < 1.0 else AlphaMode.OPAQUE,
        double_sided=True,
        point_size=point_size,
        line_width=line_width,
    )


def textured(rgba: Color, image: Image, *, has_alpha: bool, repeats: bool = True, unlit: bool = False) -> Material:
    """Return a material with a colour and a texture, which multiply each other. The rest is as in ``material``.

    ``has_alpha``: a pixel of the image is not opaque. ``repeats`` False: the pixels of its edges continue beyond them.
    ``unlit``: the image is shown without lighting.
    """
    plain = material(rgba)
    return replace(
        plain,
        base_color_texture=Texture(image, Sampler() if repeats else _CLAMPED, name="image"),
        alpha_mode=AlphaMode.BLEND if has_alpha else plain.alpha_mode,
        unlit=unlit,
    )


@lru_cache(maxsize=4096)
def faded(source: Material, opacity: float) -> Material:
    """Return a material with its alpha multiplied by the opacity of its node, 0 to 1."""
    r, g, b, alpha = source.base_color
    return replace(source, base_color=(r, g, b, alpha * opacity), alpha_mode=AlphaMode.BLEND, fallback=None)


def tinted(source: Material, rgba: Color) -> Material:
    """Return the material of a mesh file, multiplied by the command's colour."""
    if rgba == WHITE:
        return source
    r, g, b, a = rgba
    base = source.base_color
    alpha = base[3] * a
    return replace(
        source,
        base_color=(base[0] * linear_from_srgb(r), base[1] * linear_from_srgb(g), base[2] * linear_from_srgb(b), alpha),
        alpha_mode=AlphaMode.BLEND if a < 1.0 and source.alpha_mode is AlphaMode.OPAQUE else source.alpha_mode,
        fallback=None,
    )
