"""Table of a draw list's textures, which ``sampling`` reads."""

from collections.abc import Iterable
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from renderers.compiler.pointers import address_of
from renderers.drawlist import Texture, Wrap, name_image_errors
from renderers.interface import Parallel
from renderers.shading.layout import ShadingTexture
from renderers.shading.mipmaps import mip_level_rows
from renderers.shading.textures import cached_texels, texels_of

WRAP_REPEAT: Final = 0
WRAP_CLAMP: Final = 1
WRAP_MIRROR: Final = 2
_WRAPS: Final = {Wrap.REPEAT: WRAP_REPEAT, Wrap.CLAMP_TO_EDGE: WRAP_CLAMP, Wrap.MIRRORED_REPEAT: WRAP_MIRROR}
MIPS_NONE: Final = 0
MIPS_NEAREST: Final = 1
MIPS_LINEAR: Final = 2


class TextureTable:
    """Collects the textures of one draw list. Every pair of texture and colour space gets a ShadingTexture."""

    def __init__(self) -> None:
        self._indices: dict[tuple[Texture, bool], int] = {}
        self.keep: list[NDArray[Any]] = []
        """Arrays that the addresses in ``structs`` point into."""

    def index_of(self, texture: Texture, srgb: bool) -> int:
        """Return the index of a texture, which is added if it is new; ``srgb``: decode its colours to linear light."""
        return self._indices.setdefault((texture, srgb), len(self._indices))

    def structs(self, parallel: Parallel | None = None) -> NDArray[Any]:
        """Return (n,) ShadingTexture, at least one. Decodes the images, in parallel.

        Raises:
            ImageError: an image cannot be decoded; the message names it.
        """
        structs = np.zeros(max(len(self._indices), 1), ShadingTexture.dtype)
        _prepare(self._indices, parallel)
        for k, (texture, srgb) in enumerate(self._indices):
            sampler, decoded = texture.sampler, texels_of(texture.image)
            texels, (height, width) = decoded.rows, decoded.size
            last_level, mip_mode = 0, MIPS_NONE
            if sampler.mipmaps and max(width, height) > 1:
                texels, last_level = mip_level_rows(texture.image, srgb), max(width, height).bit_length() - 1
                mip_mode = MIPS_LINEAR if sampler.mip_linear else MIPS_NEAREST
            with np.errstate(over="ignore"):  # a transform beyond the range of float32 becomes infinite
                structs[k] = ShadingTexture.record(
                    wrap_s=_WRAPS[sampler.wrap_s],
                    wrap_t=_WRAPS[sampler.wrap_t],
                    mag_linear=sampler.mag_linear,
                    min_linear=sampler.min_linear,
                    mip_mode=mip_mode,
                    uv_set=texture.uv_set,
                    srgb=srgb,
                    texels=address_of(texels, np.uint8),
                    stride=texels.shape[1],
                    last_level=last_level,
                    width=width,
                    height=height,
                    uv_transform=texture.uv_transform or (1.0, 0.0, 0.0, 0.0, 1.0, 0.0),
                )
            self.keep.append(texels)
        return structs


def _prepare(textures: Iterable[tuple[Texture, bool]], parallel: Parallel | None) -> None:
    """Decode the images of textures and make their mip levels, as far as they are not cached.

    Error messages use the name of an image's first texture.
    """
    missing: dict[int, list[tuple[Texture, bool]]] = {}
    for texture, srgb in textures:
        cached = cached_texels(texture.image)
        if cached is None or (texture.sampler.mipmaps and srgb not in cached.rows_with_levels):
            missing.setdefault(id(texture.image), []).append((texture, srgb))
    by_image = list(missing.values())

    def prepare(k: int) -> None:
        with name_image_errors(by_image[k][0][0].name):
            for texture, srgb in by_image[k]:
                texels_of(texture.image)
                if texture.sampler.mipmaps:
                    mip_level_rows(texture.image, srgb)

    if parallel is not None and len(by_image) > 1:
        parallel(len(by_image), prepare)
    else:
        for k in range(len(by_image)):
            prepare(k)
