"""Textures, samplers and images of a document. Images are not decoded; only their headers are read."""

import math
from dataclasses import dataclass, field
from typing import Final

from gateway.files.gltf import schema
from gateway.files.gltf.buffers import Buffers
from gateway.files.gltf.document_cache import ContentKey
from gateway.files.gltf.gltf_errors import GltfError, GltfLimitError, GltfLimits, as_warning, checked_item
from gateway.files.gltf.parser import extension, vector_or_default
from renderers.cache import Cache
from renderers.drawlist import Image, Mesh, Sampler, Texture, Wrap, name_image_errors
from renderers.images import image_from_bytes, image_header

_IMAGE_BYTES: Final = 256
"""Approximate size of an ``Image`` besides its encoded data."""
_NEAREST: Final = 9728
"""``magFilter`` NEAREST."""
_MIN_NEAREST: Final = frozenset({9728, 9984, 9986})
"""Values of ``minFilter`` without interpolation within a mipmap level: NEAREST and NEAREST_MIPMAP_*."""
_MIN_MIPMAPS: Final = frozenset({9984, 9985, 9986, 9987})
"""Values of ``minFilter`` with mipmaps: *_MIPMAP_*."""
_MIP_NEAREST: Final = frozenset({9984, 9985})
"""Values of ``minFilter`` without interpolation between mipmap levels: *_MIPMAP_NEAREST."""
_TRANSFORM: Final = "KHR_texture_transform"
_WRAPS: Final[dict[int | None, Wrap]] = {None: Wrap.REPEAT} | {wrap.value: wrap for wrap in Wrap}


@dataclass(eq=False)
class Textures:
    """The textures of one document, each read at its first use."""

    _document: schema.Document
    _buffers: Buffers
    _content: Cache[ContentKey, Mesh | Image]
    _limits: GltfLimits
    _warnings: list[str]
    _decodes: bool = False
    """True: decode each image, and leave out those that cannot be decoded."""
    _textures: dict[int, Texture | None] = field(default_factory=dict)
    """Textures by index, with TEXCOORD_0 and no transform; None for those without a usable image."""
    _images: dict[int, tuple[Image, str]] = field(default_factory=dict)
    """Images and their names for messages, by index."""
    _counted_images: set[Image] = field(default_factory=set)
    """Images whose pixels are counted towards ``max_total_image_pixels``."""
    _total_pixels: int = 0

    def get(self, info: schema.TextureInfo | None, path: str) -> Texture | None:
        """Return a property's texture; None without, or if it cannot be read. Raises GltfLimitError."""
        if info is None:
            return None
        with as_warning(self._warnings, "the texture is left out"):
            if info.index is None:
                raise GltfError(f"{path}.index: missing")
            if info.index not in self._textures:
                self._textures[info.index] = self._load(info.index, f"{path}.index")
            texture = self._textures[info.index]
            if texture is None or (not info.tex_coord and not info.extensions):
                return texture
            return self._with_coordinates(texture, info, path)
        return None

    def _with_coordinates(self, texture: Texture, info: schema.TextureInfo, path: str) -> Texture:
        """Return the texture with the ``texCoord`` and the KHR_texture_transform of a material's property."""
        uv_set = info.tex_coord or 0
        uv_transform = None
        transform = extension(info.extensions, _TRANSFORM, schema.TextureTransform, path, self._warnings)
        if transform is not None:
            uv_transform = _uv_transform(transform, f"{path}.extensions.{_TRANSFORM}", self._warnings)
            uv_set = uv_set if transform.tex_coord is None else transform.tex_coord
        if uv_set not in (0, 1):
            self._warnings.append(f"{path}: TEXCOORD_{uv_set} is not read, TEXCOORD_0 is used")
            uv_set = 0
        return Texture(texture.image, texture.sampler, uv_set, uv_transform, texture.name)

    def _load(self, index: int, path: str) -> Texture | None:
        texture = checked_item(self._document.textures, index, "textures", path)
        source, name = texture.source, f"textures[{index}].source"
        if source is None:
            source, name = self._webp_source(texture, index), f"textures[{index}].extensions.EXT_texture_webp.source"
        if source is None:
            return None
        with as_warning(self._warnings, f"textures[{index}] is left out"):
            image, image_name = self._image(source, name)
            return Texture(image, self._sampler(texture.sampler, index), name=image_name)
        return None

    def _webp_source(self, texture: schema.GltfTexture, index: int) -> int | None:
        """Return the image of EXT_texture_webp, for a texture without a source of its own."""
        # When Drake's client merges several files, it does not adapt the indices in extensions.
        webp = None if self._document.merged_by_drake else texture.extensions
        image = extension(webp, "EXT_texture_webp", schema.ImageSource, f"textures[{index}]", self._warnings)
        if image is not None and image.source is not None:
            return image.source
        extensions = ", ".join(texture.extensions or ()) or "no extension"
        self._warnings.append(f"textures[{index}]: no source ({extensions}), so there is no texture")
        return None

    def _sampler(self, index: int | None, texture_index: int) -> Sampler:
        if index is None:
            return Sampler()
        with as_warning(self._warnings, "the default sampler is used"):
            source = checked_item(self._document.samplers, index, "samplers", f"textures[{texture_index}].sampler")
            return Sampler(
                wrap_s=self._wrap(source.wrap_s, f"samplers[{index}].wrapS"),
                wrap_t=self._wrap(source.wrap_t, f"samplers[{index}].wrapT"),
                mag_linear=source.mag_filter != _NEAREST,
                min_linear=source.min_filter not in _MIN_NEAREST,
                mipmaps=source.min_filter is None or source.min_filter in _MIN_MIPMAPS,
                mip_linear=source.min_filter not in _MIP_NEAREST,
            )
        return Sampler()

    def _wrap(self, value: int | None, path: str) -> Wrap:
        wrap = _WRAPS.get(value)
        if wrap is None:
            self._warnings.append(f"{path}: {value} is not a wrap mode, REPEAT is used")
        return wrap or Wrap.REPEAT

    def _image(self, index: int, path: str) -> tuple[Image, str]:
        """Return ``images[index]`` and its name for messages. Other documents may share the image, but not the name."""
        if (image_and_name := self._images.get(index)) is not None:
            return image_and_name
        source = checked_item(self._document.images, index, "images", path)
        if source.buffer_view is not None:
            view = self._buffers.view(source.buffer_view, f"images[{index}].bufferView")
            buffer, offset, length = view.buffer, view.offset, view.length
        elif source.uri is not None:
            buffer = self._buffers.from_uri(source.uri, f"images[{index}].uri")
            offset, length = 0, len(buffer.data)
        else:
            raise GltfError(f"images[{index}]: there is neither a uri nor a bufferView")
        name = f"images[{index}] ({source.name[:60]})" if source.name else f"images[{index}]"
        # Images that share a buffer view count, too: each of them may be copied.
        self._buffers.count_bytes(length, f"images[{index}]")
        key = (buffer.digest, offset, length, self._limits.max_image_pixels)
        image = self._content.get(key)
        data = memoryview(buffer.data)[offset : offset + length]
        if not isinstance(image, Image):
            image = image_from_bytes(bytes(data), max_pixels=self._limits.max_image_pixels)
            self._content.put(key, image, length + _IMAGE_BYTES)
        if image not in self._counted_images:
            self._count_pixels(data, name)
            if self._decodes:
                from renderers.shading.textures import texels_of  # here, because it loads kernels

                with name_image_errors(name):
                    texels_of(image)  # kept for the renderer
            self._counted_images.add(image)
        self._images[index] = image, name
        return image, name

    def _count_pixels(self, data: memoryview, name: str) -> None:
        """Count an image's pixels towards the limits. Raises GltfLimitError, or ImageError if its header is broken."""
        pixels = image_header(data, name).pixels
        self._total_pixels += pixels
        limits = self._limits
        if pixels > limits.max_image_pixels:
            raise GltfLimitError(f"{name}: {pixels} pixels are more than max_image_pixels = {limits.max_image_pixels}")
        if self._total_pixels > limits.max_total_image_pixels:
            limit = limits.max_total_image_pixels
            raise GltfLimitError(f"{name}: the images have more pixels than max_total_image_pixels = {limit}")


def _uv_transform(
    source: schema.TextureTransform, path: str, warnings: list[str]
) -> tuple[float, float, float, float, float, float]:
    """Return the first two rows of the matrix offset * rotation * scale of KHR_texture_transform, row by row."""
    offset_u, offset_v = vector_or_default(source.offset, f"{path}.offset", (0.0, 0.0), warnings)
    scale_u, scale_v = vector_or_default(source.scale, f"{path}.scale", (1.0, 1.0), warnings)
    angle = 0.0 if source.rotation is None else source.rotation
    cos, sin = math.cos(angle), math.sin(angle)
    return (cos * scale_u, sin * scale_v, offset_u, -sin * scale_u, cos * scale_v, offset_v)
