"""Encoded pictures (PNG, JPEG, WebP) as images: told apart by their bytes, checked by header, decoded when asked.

The reader of a scene never decodes: depth and label pictures need no texture at all.
"""

from __future__ import annotations

import io
import re
import struct
import threading
import warnings
import weakref
from collections import deque
from dataclasses import dataclass
from typing import Any, Final

import cv2
import numpy as np
import PIL.Image
from numpy.typing import NDArray

from renderers.contents import quick_key, whole_key
from renderers.drawlist import Image, ImageError, image_named
from renderers.png_truncation import rows_are_missing
from renderers.stop import check_stop

MAX_PIXELS: Final = 64 << 20
"""Default bound of one image: 8192 x 8192, 256 MB as RGBA. A header of a few bytes can announce any size."""

MAX_SCANNED_PIXELS: Final = 1 << 30
"""Scans of a JPEG times its pixels. Decoders go over the whole image for each scan, some 50 ms at 8192 x 8192, and look
at no ``StopFlag`` meanwhile, but a scan may be a hundred bytes long. Progressive files have about ten."""
_LEAST_SCANNED: Final = 1 << 12
"""Pixels that a scan counts as at least."""
_LARGE_PIXELS: Final = 1 << 24
"""Larger images are decoded by Pillow, which reads them piece by piece, so that a ``StopFlag`` ends it: OpenCV takes a
second or more for 8192 x 8192 pixels, Pillow as long."""
_PILLOW_PIXELS: Final = 1 << 27
"""Pillow refuses images that are about a third larger, whatever our own limit."""
_STRIP: Final = 256
"""Rows that are copied between two looks at the ``StopFlag``."""

_KEY: Final = struct.Struct("<IqQ")
"""Checksum, length (negative: of a ``whole_key``), ``max_pixels``."""
_PNG_SIZE: Final = struct.Struct(">II")
_MAX_SEGMENTS: Final = 1024
"""Segments or chunks before the pixels that are walked over; real files have tens."""
_MARKER: Final = re.compile(rb"(?:[^\xff]|\xff+\0)*\xff+[^\xff\0]", re.DOTALL)
_NAMES: Final = {
    b"\xabKTX 20\xbb": "KTX2",
    b"\xabKTX 11\xbb": "KTX",
    b"DDS ": "DDS",
    b"GIF8": "GIF",
    b"BM": "BMP",
    b"II*\0": "TIFF",
    b"MM\0*": "TIFF",
    b"sB": "Basis",
    b"\0\0\0\x20ftypavif": "AVIF",
    b"\0\0\0\x1cftypavif": "AVIF",
}
"""Formats that are recognised to say so."""


@dataclass(frozen=True, slots=True)
class ImageHeader:
    """What an encoded image says about itself."""

    format: str
    """``PNG``, ``JPEG`` or ``WebP``."""
    width: int
    height: int

    @property
    def pixels(self) -> int:
        return self.width * self.height


def image_header(data: bytes | memoryview, name: str = "image") -> ImageHeader:
    """Format and size by the bytes alone; nothing is decoded.

    Raises:
        ImageError: no format that can be decoded, or a header that is cut off; the message names image and magic.
    """
    with image_named(name):
        return _header(data)


def _header(data: bytes | memoryview) -> ImageHeader:
    view = data if isinstance(data, bytes) else memoryview(data).cast("B")
    start = bytes(view[:32])
    try:
        if start.startswith(b"\x89PNG\r\n\x1a\n"):
            if start[12:16] != b"IHDR":
                raise ImageError("PNG without IHDR")
            width, height = _PNG_SIZE.unpack_from(start, 16)
            return ImageHeader("PNG", width, height)
        if start.startswith(b"\xff\xd8\xff"):
            return ImageHeader("JPEG", *_jpeg_frame(view)[:2])
        if start.startswith(b"RIFF") and start[8:12] == b"WEBP":
            return ImageHeader("WebP", *_webp_size(start))
    except (struct.error, IndexError) as error:
        raise ImageError(f"its header is cut off ({len(view)} bytes)") from error
    known = next((kind for magic, kind in _NAMES.items() if start.startswith(magic)), None)
    what = f"{known} images are" if known else f"an image that starts with {start[:12]!r} is"
    raise ImageError(f"{what} not supported, only PNG, JPEG and WebP" if start else "it is empty")


def _jpeg_frame(view: bytes | memoryview) -> tuple[int, int, int]:
    """Return width, height and the offset of the frame header SOFn (ITU T.81 B.2.2), found by walking over the segments
    before it."""
    at = 2
    for _ in range(_MAX_SEGMENTS):
        # As libjpeg looks for markers, so that both find the same frame header: noise (here: little), then fill bytes.
        found = _MARKER.match(bytes(view[at : at + 256]))
        if found is None:
            break
        marker_at = at + found.end() - 1
        marker = view[marker_at]
        at = marker_at + 1
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            height, width = struct.unpack_from(">HH", view, at + 3)
            return width, height, at
        if marker == 0x01 or 0xD0 <= marker <= 0xD8:
            continue
        at += max(2, struct.unpack_from(">H", view, at)[0])
    raise IndexError


def _webp_size(start: bytes) -> tuple[int, int]:
    """By RFC 9649: VP8X, VP8L or VP8 is the first chunk."""
    kind = start[12:16]
    if kind == b"VP8X":
        return 1 + int.from_bytes(start[24:27], "little"), 1 + int.from_bytes(start[27:30], "little")
    if kind == b"VP8L":
        bits = struct.unpack_from("<I", start, 21)[0]
        return 1 + (bits & 0x3FFF), 1 + ((bits >> 14) & 0x3FFF)
    width, height = struct.unpack_from("<HH", start, 26)
    return width & 0x3FFF, height & 0x3FFF


class _Known(weakref.ref[Image]):
    """An image as long as somebody holds it."""

    __slots__ = ("key",)
    key: bytes


_images: dict[bytes, _Known] = {}
"""By a checksum: whoever finds one compares."""
_dead: deque[_Known] = deque()
"""Images die anywhere, within this module's own statements too: their death is only noted there."""
_lock: Final = threading.Lock()


def image_from_bytes(data: bytes | memoryview, *, max_pixels: int = MAX_PIXELS) -> Image:
    """An image of an encoded file; equal bytes give the same object as long as somebody holds it and, where others with
    the same ``quick_key`` were there first, these.

    Args:
        data: PNG, JPEG or WebP. Not looked at before ``decode``; a memoryview must not change.
        max_pixels: ``decode`` refuses images whose header announces more.
    """
    # A comparison costs a twentieth of a hash that nobody can make collide.
    key = _key(quick_key(data), max_pixels)
    before = _images.get(key)
    known = None if before is None else before()
    if known is not None and not _is_of(known, data):
        key = _key(whole_key(data), max_pixels)
        before = _images.get(key)
        known = None if before is None else before()
    if known is not None and _is_of(known, data):
        return known
    made = Image(key, _Decoder(data, max_pixels))
    entry = _Known(made, _dead.append)
    entry.key = key
    with _lock:
        while _dead:
            dead = _dead.popleft()
            if _images.get(dead.key) is dead:
                del _images[dead.key]
        now = _images.get(key)
        if now is not None and now is not before:  # another thread made one
            found = now()
            if found is not None and _is_of(found, data):
                return found
        _images[key] = entry
    return made


def _key(contents: int, max_pixels: int) -> bytes:
    return _KEY.pack(contents & 0xFFFFFFFF, contents >> 32, max_pixels)


def _is_of(image: Image, data: bytes | memoryview) -> bool:
    """Whether it was made of these bytes; their checksums agree, and with these their lengths."""
    assert isinstance(image.decode, _Decoder)
    own = image.decode.data
    return (own if isinstance(own, bytes) else bytes(own)).startswith(data)


@dataclass(frozen=True, slots=True, eq=False)
class _Decoder:
    data: bytes | memoryview
    max_pixels: int

    def __call__(self) -> NDArray[np.uint8]:
        return _decode(self.data, self.max_pixels)


def decode_image(data: bytes | memoryview, *, name: str = "image", max_pixels: int = MAX_PIXELS) -> NDArray[np.uint8]:
    """(H, W, 4) uint8 RGBA, straight alpha, top row first, C-contiguous. Releases the GIL while it decodes.

    16-bit samples keep their high byte; palettes, grey levels and transparent colours (tRNS) are expanded. Colour
    profiles and EXIF orientation are ignored, as glTF 2.0 section 3.8.3 asks.

    Raises:
        ImageError: unknown format, too many pixels, or broken data; the message names the image.
        Exception: the current ``StopFlag`` was set.
    """
    with image_named(name):
        return _decode(data, max_pixels)


def _decode(data: bytes | memoryview, max_pixels: int) -> NDArray[np.uint8]:
    header = _header(data)
    if header.width <= 0 or header.height <= 0:
        raise ImageError(f"{header.width}x{header.height} pixels")
    if header.pixels > max_pixels:
        raise ImageError(f"{header.width}x{header.height} pixels are more than the limit of {max_pixels}")
    if header.format == "JPEG":
        _check_scans(data)
    if _LARGE_PIXELS < header.pixels <= _PILLOW_PIXELS:
        return _by_pillow(data, header)
    if header.format == "PNG" and _png_needs_pillow(memoryview(data).cast("B")):
        return _by_pillow(data, header)
    decoded = _by_opencv(data)
    if decoded is None or decoded.shape[:2] != (header.height, header.width):
        return _by_pillow(data, header)
    return decoded


def _check_scans(data: bytes | memoryview) -> None:
    """Refuse a JPEG whose scans would take seconds to decode.

    Within a scan's data the marker SOS cannot occur: there every 0xFF is followed by a zero or a restart marker.

    Raises:
        ImageError: with the number of scans, and how many are read at this size.
    """
    view = memoryview(data).cast("B")
    width, height, frame_at = _jpeg_frame(view)
    scans = bytes(view[frame_at:]).count(b"\xff\xda")
    most = MAX_SCANNED_PIXELS // max(width * height, _LEAST_SCANNED)
    if scans > most:
        raise ImageError(f"a JPEG of {scans} scans, at {width}x{height} pixels at most {most} are read")


def _png_needs_pillow(view: memoryview) -> bool:
    """Whether transparency comes from tRNS with grey or RGB samples, which OpenCV does not expand for every type."""
    colour_type = view[25] if len(view) > 25 else 0
    if colour_type not in (0, 2):
        return False
    at = 8
    for _ in range(_MAX_SEGMENTS):
        if at + 8 > len(view):
            break
        kind = bytes(view[at + 4 : at + 8])
        if kind == b"tRNS":
            return True
        if kind == b"IDAT":
            return False
        at += 12 + struct.unpack_from(">I", view, at)[0]
    return False


_CONVERSIONS: Final[dict[int, int]] = {1: cv2.COLOR_GRAY2RGBA, 3: cv2.COLOR_BGR2RGBA, 4: cv2.COLOR_BGRA2RGBA}


def _by_opencv(data: bytes | memoryview) -> NDArray[np.uint8] | None:
    try:
        pixels: Any = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
        if pixels is None:
            return None
        if pixels.dtype == np.uint16:
            pixels = (pixels >> 8).astype(np.uint8)
        channels = 1 if pixels.ndim == 2 else pixels.shape[2]
        if pixels.dtype != np.uint8 or channels not in _CONVERSIONS:
            return None
        result: NDArray[np.uint8] = np.ascontiguousarray(cv2.cvtColor(pixels, _CONVERSIONS[channels]))
    except cv2.error:
        return None
    return result


def _by_pillow(data: bytes | memoryview, header: ImageHeader) -> NDArray[np.uint8]:
    if header.format == "PNG" and rows_are_missing(memoryview(data).cast("B")):
        raise ImageError("broken PNG data: there are fewer rows than its header says")
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            with PIL.Image.open(_WatchedBytes(data), formats=(header.format,)) as image:
                if image.size != (header.width, header.height):
                    raise ImageError("the header and the data differ in size")
                mode = image.mode
                if mode in ("I;16", "I;16B", "I"):
                    grey = np.asarray(image).astype(np.uint32) >> 8
                    return _grey16(grey.astype(np.uint8), np.asarray(image), image.info.get("transparency"))
                return _rgba(image)
    except ImageError:
        raise
    except PIL.UnidentifiedImageError as error:  # whose message names an object of ours
        raise ImageError(f"broken {header.format} data") from error
    except Exception as error:  # Pillow's plugins raise almost anything for broken data
        check_stop()
        raise ImageError(f"broken {header.format} data: {error}") from error


class _WatchedBytes(io.BytesIO):
    """Bytes whose reading ends when the current ``StopFlag`` is set."""

    def read(self, size: int | None = -1, /) -> bytes:
        check_stop()
        return super().read(size)


def _rgba(image: PIL.Image.Image) -> NDArray[np.uint8]:
    """The pixels of an image, strip by strip."""
    image.load()
    width, height = image.size
    pixels = np.empty((height, width, 4), np.uint8)
    for top in range(0, height, _STRIP):
        check_stop()
        strip = image.crop((0, top, width, min(top + _STRIP, height)))
        pixels[top : top + _STRIP] = np.asarray(strip.convert("RGBA"))
    return pixels


def _grey16(grey: NDArray[np.uint8], samples: NDArray[Any], transparent: object) -> NDArray[np.uint8]:
    result = np.empty((*grey.shape, 4), np.uint8)
    result[..., :3] = grey[..., None]
    result[..., 3] = 255 if not isinstance(transparent, int) else np.where(samples == transparent, 0, 255)
    return result
