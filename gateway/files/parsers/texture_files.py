"""Reads the textures that a mesh file refers to, and encodes those as PNG that the server does not decode."""

import io
from collections.abc import Callable, Iterable
from typing import Final

from PIL import Image

from gateway.files.parsers.mesh_data import MeshData

ReadFile = Callable[[str], bytes]
"""Function that returns the bytes of a file that the mesh file refers to; raises OSError."""
_DECODED_BY_SERVER: Final = ("PNG", "JPEG", "WEBP")
_CONVERTED: Final = ("BMP", "DDS", "GIF", "TGA", "TIFF")
"""Pillow's names of the formats that are encoded as PNG: those of older models, and of Gazebo's."""


class TextureFiles:
    """Collects the textures that a mesh file refers to, without duplicates."""

    def __init__(self, read_file: ReadFile, content: MeshData) -> None:
        """Textures are added to the images of ``content``, and warnings of files that hold no image."""
        self._read_file = read_file
        self._images, self._warnings = content.images, content.warnings
        self._index_by_name: dict[str, int | None] = {}
        self._index_by_data: dict[bytes, int] = {}

    def index(self, name: str, folders: Iterable[str] = ()) -> int | None:
        """Return the index of a texture in the content's images; None if it cannot be read.

        ``folders``: further places of the file, relative to the mesh file; each ends with a slash, or is empty.
        """
        if name not in self._index_by_name:
            try:
                names = "\n".join(dict.fromkeys((name, *(folder + name for folder in folders))))
                self._index_by_name[name] = self.add(name, self.encoded(name, self._read_file(names)))
            except OSError:
                self._index_by_name[name] = None
        return self._index_by_name[name]

    def add(self, name: str, data: bytes) -> int:
        """Return the index of a texture in the content's images, and add it if its bytes are new."""
        index = self._index_by_data.setdefault(data, len(self._images))
        if index == len(self._images):
            self._images.append((name, data))
        return index

    def encoded(self, name: str, data: bytes) -> bytes:
        """Return a PNG, JPEG or WebP file as it is, another one as PNG. Raises OSError, and warns, if it is none."""
        try:
            # Only the header is read here: damaged pixels are found by the server, which says so.
            with Image.open(io.BytesIO(data), formats=(*_DECODED_BY_SERVER, *_CONVERTED)) as image:
                return data if image.format in _DECODED_BY_SERVER else _png(image)
        except Exception as error:  # any error of a decoder
            formats = ", ".join((*_DECODED_BY_SERVER, *_CONVERTED))
            warning = f"{name[:120]!r} is left out: it is damaged, or none of {formats}"
            if warning not in self._warnings:
                self._warnings.append(warning)
            raise OSError(warning) from error


def read_texture(read_file: ReadFile, data: bytes) -> bytes:
    """Return an image file as ``TextureFiles.encoded`` does, and other data as they are."""
    try:
        return TextureFiles(read_file, MeshData()).encoded("", data)
    except OSError:
        return data


def _png(image: Image.Image) -> bytes:
    file = io.BytesIO()
    rgba = image if image.mode.startswith("I;16") else image.convert("RGBA")  # which would clip 16 bits
    rgba.save(file, "PNG", compress_level=1)
    return file.getvalue()
