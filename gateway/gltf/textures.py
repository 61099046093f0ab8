"""Textures, samplers and images of a document. Images are not decoded; their headers are looked at."""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Final

import msgspec

from gateway.gltf import document as gltf
from gateway.gltf.buffers import Buffers
from gateway.gltf.document import Document, extension, vector
from gateway.gltf.errors import GltfError, element
from gateway.gltf.limits import GltfLimits
from gateway.gltf.scene import DRAKE_GENERATORS
from renderers.drawlist import Image, ImageError, Sampler, Texture, Wrap
from renderers.images import image_from_bytes, image_header
from renderers.stop import check_stop

_NEAREST: Final = 9728
_MIN_NEAREST: Final = frozenset({9728, 9984, 9986})
_MIN_MIPMAPS: Final = frozenset({9984, 9985, 9986, 9987})
_MIP_NEAREST: Final = frozenset({9984, 9985})
_SAMPLER: Final = Sampler()
_WRAPS: Final[dict[int | None, Wrap]] = {None: Wrap.REPEAT} | {wrap.value: wrap for wrap in Wrap}
_IMAGES_OF_BUFFER: Final = 4096
"""Images that a buffer remembers. Documents can ask for ever new pieces of one that is kept; then all are forgotten."""


class Textures:
    """Makes the textures of one document, each when first used."""

    def __init__(
        self, document: Document, buffers: Buffers, limits: GltfLimits, warnings: list[str], *, wanted: bool = True
    ) -> None:
        """``wanted``: False leaves them out, images are not even looked at."""
        self._document = document
        self._buffers = buffers
        self._limits = limits
        self._warnings = warnings
        self._wanted = wanted
        self._textures: dict[int, Texture | None] = {}
        """With the first texture coordinates, as they are."""
        self._images: dict[int, tuple[Image, str]] = {}
        """With their names."""
        self._counted: set[int] = set()
        """Identities of images, which are held."""
        self._pixels = 0

    def of(self, info: gltf.TextureInfo | None, material: int, member: str) -> Texture | None:
        """What ``materials[material].member`` refers to; None also where there is no picture that can be used.

        Raises:
            GltfError: a reference is out of range, or images are beyond the limits.
        """
        if info is None or not self._wanted:
            return None
        index = info.index
        if index is None:
            raise GltfError(f"materials[{material}].{member}.index: missing")
        textures = self._textures
        loaded = textures[index] if index in textures else self._load(index, material, member)
        if loaded is None or (not info.tex_coord and not info.extensions):
            return loaded
        return self._placed(loaded, info, f"materials[{material}].{member}")

    def _placed(self, loaded: Texture, info: gltf.TextureInfo, name: str) -> Texture:
        """By other texture coordinates."""
        uv_set, uv_transform = info.tex_coord or 0, None
        raw = extension(info.extensions, "KHR_texture_transform")
        if raw is not None:
            where = f"{name}.extensions.KHR_texture_transform"
            try:
                transform = msgspec.json.decode(raw, type=gltf.TextureTransform)
            except msgspec.MsgspecError as error:
                raise GltfError(f"{where}: {error}") from error
            uv_transform = _uv_transform(transform, where)
            uv_set = uv_set if transform.tex_coord is None else transform.tex_coord
        if uv_set not in (0, 1):
            self._warnings.append(f"{name}: TEXCOORD_{uv_set} is not read, TEXCOORD_0 is used")
            uv_set = 0
        return Texture(loaded.image, loaded.sampler, uv_set, uv_transform, loaded.name)

    def _load(self, index: int, material: int, member: str) -> Texture | None:
        check_stop()
        sources = self._document.textures or ()
        texture = sources[index] if 0 <= index < len(sources) else None
        if texture is None:
            where = f"materials[{material}].{member}.index"
            texture = element(self._document.textures, index, "textures", where)
        image = texture.source
        if image is not None:
            made: Texture | None = self._texture(image, texture, index)
        else:
            made = self._webp(texture, index)
        self._textures[index] = made
        return made

    def _webp(self, texture: gltf.Texture, index: int) -> Texture | None:
        """Of a texture without a source."""
        name = f"textures[{index}]"
        raw = extension(texture.extensions, "EXT_texture_webp")
        asset = self._document.asset
        # Drake's merge leaves the indices in extensions as they were in the single files.
        if raw is not None and (asset is None or asset.generator not in DRAKE_GENERATORS):
            try:
                webp = msgspec.json.decode(raw, type=gltf.ImageSource)
            except msgspec.MsgspecError as error:
                raise GltfError(f"{name}.extensions.EXT_texture_webp: {error}") from error
            if webp.source is not None:
                return self._texture(webp.source, texture, index, ".extensions.EXT_texture_webp")
        offered = ", ".join(texture.extensions or ()) or "no extension"
        self._warnings.append(f"{name}: no source ({offered}), so there is no texture")
        return None

    def _texture(self, image: int, texture: gltf.Texture, index: int, part: str = "") -> Texture:
        """Image of ``images[image]``, which ``part`` of ``textures[index]`` refers to."""
        found, name = self._image(image, index, part)
        return Texture(found, self._sampler(texture.sampler, index), name=name)

    def _sampler(self, index: int | None, texture: int) -> Sampler:
        if index is None:
            return _SAMPLER
        sources = self._document.samplers or ()
        source = sources[index] if 0 <= index < len(sources) else None
        if source is None:
            source = element(self._document.samplers, index, "samplers", f"textures[{texture}].sampler")
        s, t = _WRAPS.get(source.wrap_s), _WRAPS.get(source.wrap_t)
        if s is None:
            s = self._repeating(source.wrap_s, f"samplers[{index}].wrapS")
        if t is None:
            t = self._repeating(source.wrap_t, f"samplers[{index}].wrapT")
        return _sampler_of(s, t, source.mag_filter, source.min_filter)

    def _repeating(self, value: int | None, where: str) -> Wrap:
        self._warnings.append(f"{where}: {value} is not a wrap mode, REPEAT is used")
        return Wrap.REPEAT

    def _image(self, index: int, texture: int, part: str) -> tuple[Image, str]:
        """The image, which other documents may share, and its name in this one."""
        known = self._images.get(index)
        if known is not None:
            return known
        sources = self._document.images or ()
        source = sources[index] if 0 <= index < len(sources) else None
        if source is None:
            source = element(self._document.images, index, "images", f"textures[{texture}]{part}.source")
        data: bytes | memoryview
        if source.buffer_view is not None:
            buffer, offset, length, _ = self._buffers.view(source.buffer_view, f"images[{index}].bufferView")
            data = memoryview(buffer.data)[offset : offset + length]
        elif source.uri is not None:
            buffer = self._buffers.of_uri(source.uri, "images", index)
            data = buffer.data
            offset, length = 0, len(data)
        else:
            raise GltfError(f"images[{index}]: there is neither a uri nor a bufferView")
        name = f"images[{index}] ({source.name[:60]})" if source.name else f"images[{index}]"
        place = offset, length, self._limits.max_image_pixels
        # A new one is hashed, and many views can name the same bytes. Known ones count as well: whether a document is
        # within the limits must not depend on those before it.
        self._buffers.charge(length, f"images[{index}]")
        image = buffer.images.get(place)
        if image is None:
            image = image_from_bytes(data, max_pixels=self._limits.max_image_pixels)
            if len(buffer.images) >= _IMAGES_OF_BUFFER:
                buffer.images.clear()
            buffer.images[place] = image
        self._images[index] = image, name
        if id(image) not in self._counted:
            self._counted.add(id(image))
            self._count_pixels(data, name)
        return image, name

    def _count_pixels(self, data: bytes | memoryview, name: str) -> None:
        try:
            pixels = image_header(data, name).pixels
        except ImageError as error:
            # Depth and label pictures do not need it: only who decodes it gets the error.
            self._warnings.append(str(error))
            pixels = 0
        self._pixels += pixels
        if pixels > self._limits.max_image_pixels:
            raise GltfError(f"{name}: {pixels} pixels are more than max_image_pixels = {self._limits.max_image_pixels}")
        if self._pixels > self._limits.max_total_image_pixels:
            limit = self._limits.max_total_image_pixels
            raise GltfError(f"{name}: the images have more pixels than max_total_image_pixels = {limit}")


@lru_cache(maxsize=256)
def _sampler_of(wrap_s: Wrap, wrap_t: Wrap, largest: int | None, smallest: int | None) -> Sampler:
    """``largest`` and ``smallest``: glTF's magFilter and minFilter."""
    return Sampler(
        wrap_s=wrap_s,
        wrap_t=wrap_t,
        mag_linear=largest != _NEAREST,
        min_linear=smallest not in _MIN_NEAREST,
        mipmaps=smallest is None or smallest in _MIN_MIPMAPS,
        mip_linear=smallest not in _MIP_NEAREST,
    )


def _uv_transform(source: gltf.TextureTransform, where: str) -> tuple[float, float, float, float, float, float]:
    """Offset * rotation * scale, as the extension's text and reference viewer compose them; v points down."""
    x, y = vector(source.offset, (0.0, 0.0), f"{where}.offset")
    sx, sy = vector(source.scale, (1.0, 1.0), f"{where}.scale")
    angle = 0.0 if source.rotation is None else source.rotation
    if not math.isfinite(angle):
        raise GltfError(f"{where}.rotation: not finite")
    c, s = math.cos(angle), math.sin(angle)
    return (c * sx, s * sy, x, -s * sx, c * sy, y)
