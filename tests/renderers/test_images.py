import contextlib
import gc
import io
import itertools
import struct
import time
import weakref
import zlib
from typing import Any

import cv2
import numpy as np
import PIL.Image
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.typing import NDArray

from renderers.drawlist import Image, ImageError
from renderers.images import (
    MAX_PIXELS,
    MAX_PNG_CHUNKS,
    MAX_SCANNED_PIXELS,
    MAX_UNCHECKED_IDAT,
    ImageFile,
    browser_file,
    decode_image,
    image_from_bytes,
    image_header,
)

RGBA = np.random.default_rng(0).integers(0, 256, (5, 7, 4), np.uint8)


def encoded(array: NDArray[np.uint8], kind: str, mode: str | None = None, **options: object) -> bytes:
    file = io.BytesIO()
    image = PIL.Image.fromarray(array)
    (image.convert(mode) if mode else image).save(file, kind, **options)
    return file.getvalue()


def png16(samples: NDArray[Any]) -> bytes:
    ok, data = cv2.imencode(".png", samples)
    assert ok
    return bytes(data.tobytes())


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def raw_png(
    width: int, height: int, depth: int, colour_type: int, rows: bytes, *more: bytes, interlaced: bool = False
) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, depth, colour_type, 0, 0, interlaced)
    parts = (b"\x89PNG\r\n\x1a\n", chunk(b"IHDR", header), *more, chunk(b"IDAT", zlib.compress(rows)))
    return b"".join((*parts, chunk(b"IEND", b"")))


def opaque(rgb: NDArray[np.uint8]) -> NDArray[np.uint8]:
    return np.dstack([rgb, np.full(rgb.shape[:2], 255, np.uint8)])


GREY = np.ascontiguousarray(RGBA[..., 0])


@pytest.mark.parametrize(
    ("data", "expected"),
    [
        (encoded(RGBA, "PNG"), RGBA),
        (encoded(RGBA[..., :3], "PNG"), opaque(RGBA[..., :3])),
        (encoded(GREY, "PNG"), opaque(np.dstack([GREY] * 3))),
        (encoded(RGBA[..., :2], "PNG", None), np.dstack([GREY] * 3 + [RGBA[..., 1]])),
        (encoded(RGBA, "WebP", lossless=True, exact=True), RGBA),
        (encoded(RGBA[..., :3], "WebP", lossless=True), opaque(RGBA[..., :3])),
        (png16(RGBA[..., [2, 1, 0]].astype(np.uint16) << 8 | 0x7F), opaque(RGBA[..., :3])),
        (png16(RGBA[..., [2, 1, 0, 3]].astype(np.uint16) << 8), RGBA),
        (png16(GREY.astype(np.uint16) << 8 | 0xFF), opaque(np.dstack([GREY] * 3))),
    ],
    ids=["rgba", "rgb", "grey", "grey+alpha", "webp+alpha", "webp", "rgb16", "rgba16", "grey16"],
)
def test_lossless_formats_are_exact(data: bytes, expected: NDArray[np.uint8]) -> None:
    pixels = decode_image(data)
    assert pixels.dtype == np.uint8
    assert pixels.flags.c_contiguous
    assert pixels.tolist() == expected.tolist()


@pytest.mark.parametrize("depth", [1, 2, 4, 8])
def test_palettes_with_transparency(depth: int) -> None:
    palette = b"\x00\x0a\x14\xff\x80\x40"
    rows = b"\0" + bytes([1 << (8 - depth)]) + (b"" if depth < 8 else b"\0")
    if depth == 8:
        rows = b"\0\x01\x00"
    data = raw_png(2, 1, depth, 3, rows, chunk(b"PLTE", palette), chunk(b"tRNS", b"\xff\x33"))
    assert decode_image(data).tolist() == [[[255, 128, 64, 0x33], [0, 10, 20, 255]]]


@pytest.mark.parametrize(
    ("depth", "colour_type", "rows", "transparent", "expected"),
    [
        (8, 0, b"\0\x05\x06", b"\0\x05", [[5, 5, 5, 0], [6, 6, 6, 255]]),
        (8, 2, b"\0\x01\x02\x03\x04\x05\x06", b"\0\1\0\2\0\3", [[1, 2, 3, 0], [4, 5, 6, 255]]),
        (16, 0, b"\0\x05\x01\x05\x02", b"\x05\x01", [[5, 5, 5, 0], [5, 5, 5, 255]]),
        (1, 0, b"\0\x40", b"\0\0", [[0, 0, 0, 0], [255, 255, 255, 255]]),
    ],
)
def test_transparent_colours(
    depth: int, colour_type: int, rows: bytes, transparent: bytes, expected: list[list[int]]
) -> None:
    data = raw_png(2, 1, depth, colour_type, rows, chunk(b"tRNS", transparent))
    assert decode_image(data).tolist() == [expected]


@pytest.mark.parametrize("mode", ["RGB", "L", "CMYK"])
def test_jpeg(mode: str) -> None:
    smooth = np.dstack([*np.meshgrid(np.arange(0, 256, 4), np.arange(0, 128, 4)), np.full((32, 64), 90)])
    source = PIL.Image.fromarray(smooth.astype(np.uint8)).convert(mode)
    file = io.BytesIO()
    source.save(file, "JPEG", quality=98, subsampling=0)
    pixels = decode_image(file.getvalue()).astype(int)
    assert pixels.shape == (32, 64, 4)
    assert (pixels[..., 3] == 255).all()
    expected = np.asarray(source.convert("RGB")).astype(int)
    assert np.abs(pixels[..., :3] - expected).mean() < 2


def test_a_png_that_inflates_to_more_than_its_pixels_is_refused() -> None:
    deflate = zlib.compressobj()
    data = b"".join(deflate.compress(bytes(1 << 20)) for _ in range(300)) + deflate.flush()
    assert len(data) > MAX_UNCHECKED_IDAT
    parts = b"".join(chunk(b"IDAT", data[start : start + 1000]) for start in range(0, len(data), 1000))
    for size, chunks in itertools.product((8, 600), (chunk(b"IDAT", data), parts)):
        start_of_file = b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", struct.pack(">IIBBBBB", size, size, 8, 6, 0, 0, 0))
        with pytest.raises(ImageError, match=f"inflate to more than [0-9]+ bytes, twice the size of {size}x{size}"):
            decode_image(start_of_file + chunks + chunk(b"IEND", b""))


def test_a_big_png_with_broken_data_is_refused() -> None:
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 600, 600, 8, 6, 0, 0, 0))
    data = b"\x89PNG\r\n\x1a\n" + header + chunk(b"IDAT", bytes(2 * MAX_UNCHECKED_IDAT)) + chunk(b"IEND", b"")
    with pytest.raises(ImageError, match="broken PNG data"):
        decode_image(data)


def test_big_pngs_are_decoded() -> None:
    noise = np.random.default_rng(0).integers(0, 256, (300, 301, 4), np.uint8)
    for options in ({}, {"compress_level": 0}):
        data = encoded(noise, "PNG", None, **options)
        assert len(data) > MAX_UNCHECKED_IDAT
        assert (decode_image(data) == noise).all()


def test_exif_orientation_is_ignored() -> None:
    exif = PIL.Image.Exif()
    exif[0x0112] = 6
    assert decode_image(encoded(RGBA[..., :3], "JPEG", exif=exif.tobytes())).shape == (5, 7, 4)


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WebP"])
def test_files_for_browsers_have_no_orientation_and_no_profile(kind: str) -> None:
    exif = PIL.Image.Exif()
    exif[0x0112] = 6
    smooth = np.asarray(cv2.resize(RGBA[..., :3], (70, 50), interpolation=cv2.INTER_CUBIC), np.uint8)
    data = encoded(smooth, kind, exif=exif.tobytes(), icc_profile=b"profile" * 9000)
    image = image_from_bytes(data)
    file, media_type = browser_file(image)
    assert media_type == ("image/jpeg" if kind == "JPEG" else "image/png")
    shown = PIL.Image.open(io.BytesIO(file))
    assert not shown.getexif()
    assert "icc_profile" not in shown.info
    np.testing.assert_allclose(np.asarray(shown.convert("RGB"), int), image.decode()[..., :3], atol=2)
    assert kind == "WebP" or len(file) < len(data)


def test_files_for_browsers_of_cmyk_and_of_pixels_are_png() -> None:
    cmyk = image_from_bytes(encoded(RGBA, "JPEG", "CMYK"))
    for image in (cmyk, Image(b"drawn", lambda: RGBA)):
        file, media_type = browser_file(image)
        assert media_type == "image/png"
        np.testing.assert_array_equal(decode_image(file)[..., :3], image.decode()[..., :3])


@pytest.mark.parametrize(("offset", "value"), [(1, 0xC9), (1, 0xC3), (4, 12)])
def test_jpegs_that_browsers_do_not_read_are_no_files_for_them(offset: int, value: int) -> None:
    """Arithmetic codes, without loss, 12 bits: at most a PNG, if OpenCV reads it."""
    data = bytearray(encoded(RGBA[..., :3], "JPEG"))
    data[data.index(b"\xff\xc0") + offset] = value
    with contextlib.suppress(ImageError):
        assert browser_file(image_from_bytes(bytes(data)))[1] == "image/png"


@pytest.mark.parametrize("left_out", [10, 60, 150, 600])
@pytest.mark.parametrize("kind", ["PNG", "JPEG"])
def test_cut_off_files_are_no_files_for_browsers(kind: str, left_out: int) -> None:
    """Browsers would draw the pixels that are there, and the renderers none."""
    data = encoded(np.tile(RGBA[..., :3], (9, 9, 1)), kind, exif=PIL.Image.Exif().tobytes())
    with pytest.raises(ImageError):
        browser_file(image_from_bytes(data[:-left_out]))


def test_files_for_browsers_have_at_most_the_pixels_of_the_limit() -> None:
    with pytest.raises(ImageError, match=r"7x5 pixels .* 34"):
        browser_file(image_from_bytes(encoded(RGBA[..., :3], "JPEG"), max_pixels=34))


@pytest.mark.parametrize("kind", ["PNG", "JPEG", "WebP"])
@pytest.mark.parametrize("options", [{}, {"lossless": True}, {"progressive": True}, {"exif": b"Exif\0\0" + bytes(300)}])
def test_headers(kind: str, options: dict[str, object]) -> None:
    for channels in (3, 4):
        if kind == "JPEG" and channels == 4:
            continue
        data = encoded(RGBA[..., :channels], kind, None, **options)
        header = image_header(memoryview(data))
        assert (header.format, header.width, header.height, header.pixels) == (kind, 7, 5, 35)


def test_rejects_bombs_by_their_header() -> None:
    bomb = raw_png(60_000, 60_000, 1, 0, b"")
    with pytest.raises(ImageError, match="bomb: 60000x60000 pixels are more than the limit of 67108864"):
        decode_image(bomb, name="bomb")


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "tex: it is empty"),
        (b"\xabKTX 20\xbb\r\n\x1a\n", "tex: KTX2 images are not supported, only PNG, JPEG and WebP"),
        (b"GIF89a", "tex: GIF images are not supported"),
        (b"<svg", r"tex: an image that starts with b'<svg' is not supported"),
        (b"\x89PNG\r\n\x1a\n", "tex: PNG without IHDR"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\0IHDR" + bytes(30), "tex: PNG without IHDR"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\0IHDR\0\0\0\4\0\0\0\4tRNS" + bytes(8), "tex: PNG without IHDR"),
        (b"\x89PNG\r\n\x1a\n\0\0\0\x0dIHDR\0", r"tex: its header is cut off \(17 bytes\)"),
        (b"\xff\xd8\xff\xe0\0\x10JFIF", r"tex: its header is cut off \(10 bytes\)"),
        (b"RIFF\0\0\0\0WEBPVP8 ", r"tex: its header is cut off"),
        (encoded(RGBA, "PNG")[:60], "tex: broken PNG data"),
        (encoded(RGBA, "PNG")[:29] + bytes(4) + encoded(RGBA, "PNG")[33:], "tex: broken PNG data$"),
        (raw_png(0, 5, 8, 2, b""), "tex: 0x5 pixels"),
    ],
)
def test_errors_name_the_image(data: bytes, message: str) -> None:
    with pytest.raises(ImageError, match=message):
        decode_image(data, name="tex")
    with pytest.raises(ImageError, match=message.replace("tex: ", "^")):
        image_from_bytes(data).decode()  # which every document with these bytes shares


@pytest.mark.parametrize("data", [b"", chunk(b"tRNS", b"\0\5")])
@pytest.mark.parametrize(
    ("interlaced", "rows"),
    [
        (False, [b"\0\1\2\3", b"\0\4\5\6", b"\0\7\7\7"]),
        # Passes of 3 x 3 pixels: (0, 0), none, none, (2, 0), (0, 2) (2, 2), (1, 0) (1, 2), the row 1.
        (True, [b"\0\1", b"\0\3", b"\0\7\7", b"\0\2", b"\0\7", b"\0\4\5\6"]),
    ],
    ids=["rows", "interlaced"],
)
def test_rejects_pngs_with_missing_rows(interlaced: bool, rows: list[bytes], data: bytes) -> None:
    more = (data,) if data else ()
    levels = decode_image(raw_png(3, 3, 8, 0, b"".join(rows), *more, interlaced=interlaced))[..., 0]
    assert levels.tolist() == [[1, 2, 3], [4, 5, 6], [7, 7, 7]]
    for count in range(len(rows)):
        with pytest.raises(ImageError, match=r"tex: broken PNG data$"):
            decode_image(raw_png(3, 3, 8, 0, b"".join(rows[:count]), *more, interlaced=interlaced), name="tex")


def test_pixels_in_several_png_chunks() -> None:
    whole = encoded(RGBA, "PNG")
    at = whole.index(b"IDAT")
    (length,) = struct.unpack_from(">I", whole, at - 4)
    pixels, rest = whole[at + 4 : at + 4 + length], whole[at + 8 + length :]
    pieces = (chunk(b"IDAT", pixels[k : k + 7]) for k in range(0, length, 7))
    assert decode_image(b"".join((whole[: at - 4], *pieces, rest))).tolist() == RGBA.tolist()


def with_extra(*chunks: bytes) -> bytes:
    whole = encoded(RGBA, "PNG")
    return whole[:33] + b"".join(chunks) + whole[33:]


def test_png_chunks_without_pixels_are_not_decoded(capfd: pytest.CaptureFixture[str]) -> None:
    """libpng writes a line to stderr for each flaw; twenty thousand flaws fit into a small file."""
    flawed = (
        chunk(b"eXIf", b"?") * 9,
        chunk(b"iCCP", b"a\0\0b"),
        b"\0\0\0\4tEXtabcd\0\0\0\0" * 9,
        chunk(b"pHYs", b"") * 9,
    )
    assert decode_image(with_extra(*flawed)).tolist() == RGBA.tolist()
    assert capfd.readouterr() == ("", "")


@pytest.mark.parametrize("kind", [b"IDAT", b"tRNS"])
def test_memory_for_an_incomplete_png_chunk_is_that_of_the_file(kind: bytes) -> None:
    """OpenCV would allocate and clear 4 GB for it."""
    header = chunk(b"IHDR", struct.pack(">IIBBBBB", 2, 1, 8, 0, 0, 0, 0))
    begin = time.process_time()
    with pytest.raises(ImageError, match="broken PNG data"):
        decode_image(b"\x89PNG\r\n\x1a\n" + header + b"\xff\xff\xff\0" + kind + bytes(8))
    assert time.process_time() - begin < 0.5


def test_too_many_png_chunks_are_refused() -> None:
    assert decode_image(with_extra(chunk(b"tEXt", b"a\0b") * (MAX_PNG_CHUNKS - 3))).shape == (5, 7, 4)
    with pytest.raises(ImageError, match=f"tex: a PNG has more than {MAX_PNG_CHUNKS} chunks"):
        decode_image(with_extra(chunk(b"tEXt", b"a\0b") * MAX_PNG_CHUNKS), name="tex")


def test_ignores_false_jpeg_frame_headers_in_noise() -> None:
    """libjpeg skips noise and FF 00 before a marker: with another size here, a bomb would pass the limit."""
    data = encoded(np.ascontiguousarray(RGBA[..., :3]), "JPEG")
    false = b"\xc0\x00\x11\x08\x00\x01\x00\x01\x03"
    for noise in (b"\0" + false, b"\xff\0" + false, b"\xff\xff\0\0" + false):
        header = image_header(data[:2] + b"\xff\xe1\0\2" + noise + data[2:])
        assert (header.width, header.height) == (7, 5)


def test_rejects_endless_headers() -> None:
    with pytest.raises(ImageError, match="its header is cut off"):
        image_header(b"\xff\xd8\xff" + b"\xe0\x00\x02\xff" * 1_000_000)
    with pytest.raises(ImageError, match="its header is cut off"):
        image_header(b"\xff\xd8\xff" + bytes(50_000_000))


def test_equal_bytes_give_one_image() -> None:
    data = encoded(RGBA, "PNG")
    first, second = image_from_bytes(data), image_from_bytes(memoryview(bytearray(data)))
    assert first is second
    assert image_from_bytes(data, max_pixels=1000) is not first  # other limits, other outcome
    assert first.key == b"%08x" % zlib.crc32(data)


def test_images_that_are_not_in_use_are_freed() -> None:
    image = weakref.ref(image_from_bytes(encoded(RGBA, "PNG")))
    gc.collect()
    assert image() is None


@pytest.mark.parametrize(("width", "height", "pixels"), [(7, 5, 35), (5, 7, 35), (1, 9, 9), (9, 1, 9)])
def test_the_pixel_limit_is_exact(width: int, height: int, pixels: int) -> None:
    data = encoded(np.zeros((height, width, 3), np.uint8), "PNG")
    assert image_from_bytes(data, max_pixels=pixels).decode().shape == (height, width, 4)
    with pytest.raises(ImageError, match=f"{width}x{height} pixels are more than the limit of {pixels - 1}"):
        image_from_bytes(data, max_pixels=pixels - 1).decode()


SAMPLES = [encoded(RGBA, "PNG"), encoded(RGBA[..., :3], "JPEG"), encoded(RGBA, "WebP"), png16(RGBA.astype(np.uint16))]


@given(st.sampled_from(SAMPLES), st.lists(st.tuples(st.integers(0, 2000), st.integers(0, 255)), max_size=4), st.data())
@settings(deadline=None, max_examples=150)
def test_damaged_images_decode_or_raise_image_error(
    data: bytes, changes: list[tuple[int, int]], draw: st.DataObject
) -> None:
    damaged = bytearray(data)
    for position, value in changes:
        damaged[position % len(damaged)] = value
    cut = bytes(damaged[: draw.draw(st.integers(0, len(damaged)))])
    for candidate in (bytes(damaged), cut):
        try:
            pixels = decode_image(candidate, max_pixels=10_000)
        except ImageError:
            continue
        assert pixels.dtype == np.uint8
        assert pixels.ndim == 3
        assert pixels.shape[2] == 4


def jpeg_of_scans(side: int, scans: int) -> bytes:
    """Return a grey progressive JPEG with its last scan repeated until there are ``scans``."""
    grey = np.full((side, side), 128, np.uint8)
    data = encoded(grey, "JPEG", progressive=True)
    last, before = data[data.rindex(b"\xff\xda") : -2], data.count(b"\xff\xda")
    return data[:-2] + last * (scans - before) + data[-2:]


def test_rejects_jpegs_of_too_many_scans(monkeypatch: pytest.MonkeyPatch) -> None:
    """Decoders process the whole image for each scan: half a megabyte of scans takes minutes."""
    monkeypatch.setattr("renderers.images.MAX_SCANNED_PIXELS", 20 * 256**2)
    np.testing.assert_array_equal(decode_image(jpeg_of_scans(256, 20))[..., 0], 128)
    with pytest.raises(ImageError, match="a JPEG of 21 scans, at 256x256 pixels at most 20 are read"):
        decode_image(jpeg_of_scans(256, 21))
    assert browser_file(image_from_bytes(jpeg_of_scans(256, 20)))[1] == "image/jpeg"
    with pytest.raises(ImageError, match=" 21 scans"):
        browser_file(image_from_bytes(jpeg_of_scans(256, 21)))


def test_progressive_jpegs_of_the_maximum_size_are_allowed() -> None:
    assert MAX_SCANNED_PIXELS // MAX_PIXELS >= 14


def test_rejects_many_scans_of_few_pixels() -> None:
    with pytest.raises(ImageError, match="scans, at 8x8 pixels at most 262144 are read"):
        decode_image(jpeg_of_scans(8, 262145))


def test_images_of_files_keep_the_file() -> None:
    data = encoded(RGBA, "PNG")
    decode = image_from_bytes(data, max_pixels=100).decode
    assert isinstance(decode, ImageFile)
    assert (decode.data, decode.max_pixels) == (data, 100)
    np.testing.assert_array_equal(decode(), RGBA)
