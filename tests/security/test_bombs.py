"""Small inputs that decompress or parse to large ones; a process of its own measures memory."""

import struct
import subprocess
import sys
import zlib

import pytest

MOST = 256 << 20
"""Bytes above what the imports take; every bomb below would take a gigabyte or more."""
PROBE = """
import resource, sys
from {module} import {name} as take
before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
try:
    take(sys.stdin.buffer.read())
except ValueError as error:
    print("refused:", error)
print((resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - before) * 1024)
"""


def grown(module: str, name: str, data: bytes) -> int:
    """Bytes that the peak of a fresh process grows by when it takes ``data``."""
    command = [sys.executable, "-c", PROBE.format(module=module, name=name)]
    result = subprocess.run(command, input=data, capture_output=True, check=True)
    return int(result.stdout.split()[-1])


def chunk(kind: bytes, data: bytes) -> bytes:
    return struct.pack(">I", len(data)) + kind + data + struct.pack(">I", zlib.crc32(kind + data))


def png(*extra: bytes, width: int = 4, height: int = 4, rows: bytes | None = None) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, 8, 6, 0, 0, 0)
    pixels = zlib.compress(bytes(height * (1 + 4 * width))) if rows is None else rows
    return (
        b"\x89PNG\r\n\x1a\n" + chunk(b"IHDR", header) + b"".join(extra) + chunk(b"IDAT", pixels) + chunk(b"IEND", b"")
    )


def compressed_zeros(size: int) -> bytes:
    """Return a zlib stream of ``size`` zeros (whole MiB): one compressed MiB, repeated."""
    compressor = zlib.compressobj(9, wbits=-15)
    mebibyte = compressor.compress(bytes(1 << 20)) + compressor.flush(zlib.Z_FULL_FLUSH)
    adler32 = struct.pack(">HH", size % 65521, 1)
    return b"\x78\xda" + mebibyte * (size >> 20) + b"\x03\x00" + adler32


GIGABYTE = compressed_zeros(1 << 30)


@pytest.mark.parametrize(
    "data",
    [
        png(chunk(b"iCCP", b"profile\0\0" + GIGABYTE)),
        png(chunk(b"zTXt", b"text\0\0" + GIGABYTE)),
        png(chunk(b"iTXt", b"text\0\1\0\0\0" + GIGABYTE)),
        png(rows=GIGABYTE),
        png(width=30_000, height=30_000, rows=GIGABYTE),
    ],
    ids=["profile", "text", "text of the world", "more rows than the header says", "dimensions"],
)
def test_png_bombs_do_not_unfold(data: bytes) -> None:
    assert len(data) < 3 << 20
    assert grown("renderers.images", "decode_image", data) < MOST


@pytest.mark.parametrize(
    "text",
    [b"[" * 1_000_000, b'{"nodes":' * 1_000_000, b'{"nodes":[' + b"{}," * 20_000_000 + b"{}]}"],
    ids=["lists", "objects", "values"],
)
def test_json_bombs_do_not_unfold(text: bytes) -> None:
    assert grown("gateway.files.gltf", "read_gltf", text) < MOST + 4 * len(text)
