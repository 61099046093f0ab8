"""Encoded images (PNG, JPEG, WebP): header checks, decoding by OpenCV, and one ``Image`` object per content.

Scene readers create ``Image`` objects. Renderers decode them when they render a colour image.
"""

import re
import struct
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, Final, TypeAlias
from weakref import WeakValueDictionary

import cv2
import numpy as np
from isal import isal_zlib
from isal.igzip_lib import IsalError
from numpy.typing import NDArray

from renderers.drawlist import Image, ImageError, name_image_errors
from renderers.encode import png_pixels
from renderers.stop import check_stop

MAX_PIXELS: Final = 64 << 20
"""Default maximum number of pixels of an image: 8192 x 8192, 256 MB as RGBA. Headers can announce any size."""

MAX_SCANNED_PIXELS: Final = 1 << 30
"""Maximum number of scans of a JPEG times its pixels. Even a scan of a hundred bytes is decoded for all pixels, which
takes some 50 ms at 8192 x 8192. Progressive files have about ten scans."""
_MIN_SCAN_PIXELS: Final = 1 << 12
"""A scan of a smaller image counts as this many pixels."""
MAX_SEGMENTS: Final = 1024
"""Maximum number of JPEG segments before the pixels; real files have tens."""
MAX_UNCHECKED_IDAT: Final = 256 << 10
"""Maximum number of compressed bytes of a PNG that are decoded without a check of their inflated size. They inflate
to at most 264 MB, which OpenCV reads to the end in some two seconds. The check adds a third to the time of decoding."""
MAX_PNG_CHUNKS: Final = 1 << 17
"""Maximum number of a PNG's chunks: libpng writes 8 KiB of pixels into each, that is 1 GiB."""

_PNG_SIGNATURE: Final = b"\x89PNG\r\n\x1a\n"
_PNG_IHDR: Final = struct.Struct(">8xIIBB")
"""Chunk IHDR of a PNG: width, height, bits of a sample, colour type."""
_JPEG_MARKER: Final = re.compile(rb"(?:[^\xff]|\xff+\0)*\xff+[^\xff\0]", re.DOTALL)
"""A marker (ITU T.81 B.1.1.2), with preceding noise and fill bytes."""
_UNSUPPORTED_FORMATS: Final = {
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
"""Names of formats for error messages, by the first bytes of a file."""


@dataclass(frozen=True, slots=True)
class ImageHeader:
    """Format and size in the header of an encoded image."""

    format: str
    """``PNG``, ``JPEG`` or ``WebP``."""
    width: int
    """Columns, pixels."""
    height: int
    """Rows, pixels."""

    @property
    def pixels(self) -> int:
        """Number of pixels."""
        return self.width * self.height


def image_header(data: bytes | memoryview, name: str = "image") -> ImageHeader:
    """Return format and size without decoding.

    Raises:
        ImageError: unsupported format or truncated header; the message names the image and its first bytes.
    """
    with name_image_errors(name):
        return _header(data)


def _header(data: bytes | memoryview) -> ImageHeader:
    view = data if isinstance(data, bytes) else memoryview(data).cast("B")
    start = bytes(view[:32])
    try:
        if start.startswith(_PNG_SIGNATURE):
            if start[8:16] != b"\0\0\0\x0dIHDR":
                raise ImageError("PNG without IHDR")
            width, height, _, _ = _PNG_IHDR.unpack_from(start, 8)
            return ImageHeader("PNG", width, height)
        if start.startswith(b"\xff\xd8\xff"):
            return ImageHeader("JPEG", *_jpeg_frame_header(view)[:2])
        if start.startswith(b"RIFF") and start[8:12] == b"WEBP":
            return ImageHeader("WebP", *_webp_size(start))
    except (struct.error, IndexError) as error:
        raise ImageError(f"its header is cut off ({len(view)} bytes)") from error
    if not start:
        raise ImageError("it is empty")
    unsupported = next((name for magic, name in _UNSUPPORTED_FORMATS.items() if start.startswith(magic)), None)
    subject = f"{unsupported} images are" if unsupported else f"an image that starts with {start[:12]!r} is"
    raise ImageError(f"{subject} not supported, only PNG, JPEG and WebP")


def _jpeg_segments(view: bytes | memoryview) -> Iterator[tuple[int, int, int, int]]:
    """Yield the segments of a JPEG after its first marker, up to the frame header SOFn (ITU T.81 B.2.2).

    At most 256 bytes of noise before a marker are skipped, as libjpeg does, so that both read the same frame header.

    Yields:
        Marker, and offsets: of the segment, of what follows the marker, of the next segment.
    """
    begin = 2
    for _ in range(MAX_SEGMENTS):
        match = _JPEG_MARKER.match(bytes(view[begin : begin + 256]))
        if match is None:
            break
        start = begin + match.end()
        marker = view[start - 1]
        has_no_content = marker == 0x01 or 0xD0 <= marker <= 0xD8
        end = start if has_no_content else start + max(2, struct.unpack_from(">H", view, start)[0])
        yield marker, begin, start, end
        if 0xC0 <= marker <= 0xCF and marker not in (0xC4, 0xC8, 0xCC):
            return
        begin = end
    raise IndexError


def _jpeg_frame_header(view: bytes | memoryview) -> tuple[int, int, int]:
    """Return width, height and offset of the frame header."""
    *_, (_, _, start, _) = _jpeg_segments(view)
    height, width = struct.unpack_from(">HH", view, start + 3)
    return width, height, start


def _is_for_browsers(jpeg: bytes) -> bool:
    """Return True for a JPEG with an end that all browsers read: Huffman codes, 8 bits, grey or RGB, not CMYK."""
    *_, (marker, _, start, _) = _jpeg_segments(jpeg)
    is_whole = jpeg.find(b"\xff\xd9", start) > 0
    return is_whole and marker <= 0xC2 and jpeg[start + 2] == 8 and jpeg[start + 7 : start + 8] in (b"\1", b"\3")


def _webp_size(start: bytes) -> tuple[int, int]:
    """Return the size in the first chunk, which is VP8X, VP8L or VP8 (RFC 9649)."""
    kind = start[12:16]
    if kind == b"VP8X":
        return 1 + int.from_bytes(start[24:27], "little"), 1 + int.from_bytes(start[27:30], "little")
    if kind == b"VP8L":
        bits = struct.unpack_from("<I", start, 21)[0]
        return 1 + (bits & 0x3FFF), 1 + ((bits >> 14) & 0x3FFF)
    width, height = struct.unpack_from("<HH", start, 26)
    return width & 0x3FFF, height & 0x3FFF


@dataclass(frozen=True, slots=True)
class ImageFile:
    """``Image.decode`` of an encoded file. Exporters and the state's storage copy ``data`` instead of the pixels."""

    data: bytes
    """PNG, JPEG or WebP."""
    max_pixels: int
    """Maximum number of pixels that are decoded."""

    def __call__(self) -> NDArray[np.uint8]:
        """Return the pixels, see ``Image.decode``."""
        return _decode(self.data, self.max_pixels)


_JPEG_APP_1_2: Final = (0xE1, 0xE2)
"""Markers of segments with EXIF data and colour profiles."""
_images: Final[WeakValueDictionary[ImageFile, Image]] = WeakValueDictionary()
"""Images in use, by content and ``max_pixels``. Renderers cache textures by the identity of their image."""


_PNG_BIT_DEPTH: Final = 24
"""Offset of the number of bits per channel in a PNG."""


def image_from_bytes(data: bytes | memoryview, *, max_pixels: int = MAX_PIXELS) -> Image:
    """Return an image that decodes an encoded file. Equal bytes give the same object while it is in use.

    ``Image.decode`` checks the data, and accepts at most ``max_pixels``.
    """
    file = ImageFile(bytes(data), max_pixels)
    image = _images.get(file)
    if image is None:
        is_deep_png = file.data.startswith(b"\x89PNG") and file.data[_PNG_BIT_DEPTH : _PNG_BIT_DEPTH + 1] == b"\x10"
        image = _images[file] = Image(b"%08x" % isal_zlib.crc32(file.data), file, is_deep_png)
    return image


def browser_file(image: Image) -> tuple[bytes, str]:
    """Return a file of an image for browsers, and its media type.

    It is the image's own PNG or JPEG, without colour profile and orientation, which browsers would apply; or a new PNG.

    Raises:
        ImageError: the image cannot be decoded, as far as this is seen without decoding a file that is sent; the
            message does not name it.
    """
    file = image.decode
    if isinstance(file, ImageFile) and (header := _header(file.data)).pixels <= file.max_pixels:
        view = memoryview(file.data)
        if header.format == "PNG" and (chunks := _png_chunks(view))[b"IEND"]:
            return _plain_png(chunks), "image/png"
        if header.format == "JPEG" and _is_for_browsers(file.data):
            _check_scans(view)
            *before, (_, frame, _, _) = _jpeg_segments(view)
            kept = (view[begin:end] for marker, begin, _, end in before if marker not in _JPEG_APP_1_2)
            return b"".join((view[:2], *kept, view[frame:])), "image/jpeg"
    return png_pixels(file()), "image/png"


def decode_image(data: bytes | memoryview, *, name: str = "image", max_pixels: int = MAX_PIXELS) -> NDArray[np.uint8]:
    """Return (H, W, 4) uint8 RGBA, straight alpha, top row first, C-contiguous. Releases the GIL.

    16-bit samples are reduced to their high byte; palettes, grey levels and transparent colours (tRNS) are expanded.
    Colour profiles and EXIF orientation are ignored, as required by glTF 2.0 section 3.8.3.

    Raises:
        ImageError: unknown format, too many pixels, or broken data; the message names the image.
        Exception: the error of the current ``StopFlag``, if it was set.
    """
    with name_image_errors(name):
        pixels = _decode(data, max_pixels)
        return pixels if pixels.shape[2] == 4 else np.asarray(cv2.cvtColor(pixels, cv2.COLOR_RGB2RGBA), np.uint8)


def _decode(data: bytes | memoryview, max_pixels: int) -> NDArray[np.uint8]:
    """Return (H, W, 4) uint8 RGBA, or (H, W, 3) RGB of a JPEG."""
    check_stop()
    header = _header(data)
    if header.width <= 0 or header.height <= 0:
        raise ImageError(f"{header.width}x{header.height} pixels")
    if header.pixels > max_pixels:
        raise ImageError(f"{header.width}x{header.height} pixels are more than the limit of {max_pixels}")
    if header.format == "JPEG":
        _check_scans(data)
    transparent_level: int | None = None
    if header.format == "PNG":
        chunks = _png_chunks(memoryview(data).cast("B"))
        _check_inflated_size(chunks)
        transparent_level = _transparent_grey(chunks)
        data = _plain_png(chunks)
    # An alpha of 255, and its search, would take a third of the time of a JPEG.
    mode = cv2.IMREAD_COLOR_RGB | cv2.IMREAD_IGNORE_ORIENTATION if header.format == "JPEG" else cv2.IMREAD_UNCHANGED
    try:
        samples: Any = cv2.imdecode(np.frombuffer(data, np.uint8), mode)
    except cv2.error as error:
        raise ImageError(f"broken {header.format} data: {error.err}") from error
    if samples is None or samples.shape[:2] != (header.height, header.width):
        raise ImageError(f"broken {header.format} data")
    if header.format == "JPEG":
        return np.asarray(samples, np.uint8)
    return _rgba(samples, transparent_level if samples.ndim == 2 else None)


def _check_scans(data: bytes | memoryview) -> None:
    """Reject a JPEG whose scans would take seconds to decode.

    Scans are counted by their marker SOS. Their data cannot contain it, since 0 or the second byte of a restart marker
    follows each 0xFF there.

    Raises:
        ImageError: too many scans; the message has their number and the limit at this size.
    """
    view = memoryview(data).cast("B")
    width, height, offset = _jpeg_frame_header(view)
    scans = bytes(view[offset:]).count(b"\xff\xda")
    limit = MAX_SCANNED_PIXELS // max(width * height, _MIN_SCAN_PIXELS)
    if scans > limit:
        raise ImageError(f"a JPEG of {scans} scans, at {width}x{height} pixels at most {limit} are read")


_PngChunks: TypeAlias = dict[bytes, list[memoryview]]
"""Chunks of a PNG by type, each from its length to its checksum."""


def _png_chunks(png: memoryview) -> _PngChunks:
    """Return the chunks of a PNG that its pixels depend on, in the order of the PNG specification.

    OpenCV gets no others: libpng writes a warning about each flaw of a colour profile or text to stderr, and colour
    profiles, orientations and animations are ignored anyway. It gets no incomplete one either: it allocates up to 4 GB,
    the length that a chunk states, before it reads the chunk.

    Returns:
        All IDAT; of the others the first one.

    Raises:
        ImageError: too many chunks; the message has the limit.
    """
    chunks: _PngChunks = {kind: [] for kind in (b"IHDR", b"PLTE", b"tRNS", b"IDAT", b"IEND")}
    offset = len(_PNG_SIGNATURE)
    for _ in range(MAX_PNG_CHUNKS + 1):
        end = offset + 12 + int.from_bytes(png[offset : offset + 4], "big")
        if end > len(png):
            return chunks
        kind = bytes(png[offset + 4 : offset + 8])
        if kind == b"IDAT" or chunks.get(kind) == []:
            chunks[kind].append(png[offset:end])
        offset = end
    raise ImageError(f"a PNG has more than {MAX_PNG_CHUNKS} chunks")


def _plain_png(chunks: _PngChunks) -> bytes:
    return b"".join((_PNG_SIGNATURE, *(chunk for same_type in chunks.values() for chunk in same_type)))


def _check_inflated_size(chunks: _PngChunks) -> None:
    """Reject a PNG whose data inflate to far more than its pixels: OpenCV would inflate all of it, 9 s for each GB.

    Raises:
        ImageError: too many bytes; the message has the limit.
    """
    compressed = [chunk[8:-4] for chunk in chunks[b"IDAT"]]
    if sum(map(len, compressed)) <= MAX_UNCHECKED_IDAT:
        return
    width, height, bit_depth, color_type = _PNG_IHDR.unpack_from(chunks[b"IHDR"][0])
    bits = bit_depth * _PNG_CHANNELS.get(color_type, 4)
    limit = 2 * height * (1 + (width * bits + 7) // 8) + (1 << 16)  # interlaced rows have more filter bytes
    inflater = isal_zlib.decompressobj()
    inflated = 0
    try:
        for data in compressed:
            pending: bytes | memoryview = data
            while len(pending) and not inflater.eof:
                inflated += len(inflater.decompress(pending, 1 << 20))
                if inflated > limit:
                    raise ImageError(
                        f"its data inflate to more than {limit} bytes, twice the size of {width}x{height} pixels"
                    )
                pending = inflater.unconsumed_tail
    except IsalError:  # type: ignore[misc]  # its stub does not say that it is an exception
        return  # OpenCV reports broken data


_PNG_CHANNELS: Final = {0: 1, 2: 3, 3: 1, 4: 2, 6: 4}
"""Samples of a pixel by colour type (PNG, table 11.1)."""


def _transparent_grey(chunks: _PngChunks) -> int | None:
    """Return the transparent grey level of a PNG at OpenCV's bit depth (chunk tRNS, which OpenCV ignores), or None."""
    data = b"".join(chunk[8:-4] for chunk in chunks[b"tRNS"])
    if len(data) < 2:
        return None
    _, _, bit_depth, _ = _PNG_IHDR.unpack_from(chunks[b"IHDR"][0])
    level = int.from_bytes(data[:2], "big")
    return level * 255 // ((1 << bit_depth) - 1) if bit_depth < 8 else level


_RGBA_CONVERSIONS: Final[dict[int, int]] = {1: cv2.COLOR_GRAY2RGBA, 3: cv2.COLOR_BGR2RGBA, 4: cv2.COLOR_BGRA2RGBA}
"""OpenCV's conversions to RGBA, by number of channels."""


def _rgba(samples: NDArray[Any], transparent_level: int | None) -> NDArray[np.uint8]:
    """Return OpenCV's samples as (H, W, 4) uint8; pixels of a grey image at ``transparent_level`` get alpha 0."""
    levels = (samples >> 8).astype(np.uint8) if samples.dtype == np.uint16 else samples
    channels = 1 if levels.ndim == 2 else levels.shape[2]
    if levels.dtype != np.uint8 or channels not in _RGBA_CONVERSIONS:
        raise ImageError(f"{channels} channels of {levels.dtype.name} are not supported")
    rgba: NDArray[np.uint8] = np.ascontiguousarray(cv2.cvtColor(levels, _RGBA_CONVERSIONS[channels]))
    if transparent_level is not None:
        rgba[..., 3] = np.where(samples == transparent_level, 0, 255)
    return rgba
