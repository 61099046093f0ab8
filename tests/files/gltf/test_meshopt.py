"""KHR_meshopt_compression and EXT_meshopt_compression: streams recorded from meshoptimizer's encoder, of both versions
of the attributes; files written by glTF-Transform."""

import base64
import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from gateway.files.gltf import GltfError, GltfLimits, meshopt, schema
from gateway.files.gltf.meshopt_kernels import MeshoptError, decode_attributes, decode_indices, decode_triangles
from tests.files.gltf.builder import TRIANGLE, Builder, meshes, read_file, world_triangles

STREAMS: list[dict[str, Any]] = json.loads((Path(__file__).parent / "files" / "meshopt_streams.json").read_text())
DTYPES: dict[str, dict[int, Any]] = {"OCTAHEDRAL": {4: np.int8, 8: np.int16}, "QUATERNION": {8: np.int16}}


def extension(record: dict[str, Any], **changes: Any) -> schema.MeshoptCompression:
    fields = {"count": record["count"], "byte_stride": record["byteStride"], "filter": record["filter"]}
    return schema.MeshoptCompression(**(fields | {"mode": record["mode"]} | changes))


@pytest.mark.parametrize("k", range(len(STREAMS)))
def test_recorded_streams(k: int) -> None:
    record = STREAMS[k]
    stream, expected = base64.b64decode(record["stream"]), base64.b64decode(record["decoded"])
    decoded = bytes(meshopt.decompress(extension(record), stream, "x"))
    if record["filter"] in DTYPES:  # the extension leaves the rounding of filters to the decoder
        dtype = DTYPES[record["filter"]][record["byteStride"]]
        ours, theirs = np.frombuffer(decoded, dtype).astype(int), np.frombuffer(expected, dtype).astype(int)
        assert np.abs(ours - theirs).max() <= 1
        assert (ours != theirs).mean() < 0.01
    else:
        assert decoded == expected


@pytest.mark.parametrize("k", range(len(STREAMS)))
def test_damaged_streams_end_with_an_error_or_a_result(k: int) -> None:
    record = STREAMS[k]
    stream = base64.b64decode(record["stream"])
    rng = np.random.default_rng(k)
    with pytest.raises(GltfError, match="truncated"):
        meshopt.decompress(extension(record), stream[: len(stream) // 2], "x")
    with pytest.raises(GltfError, match=r"bytes after its end|truncated"):
        meshopt.decompress(extension(record), stream[:1] + b"\0\0\0" + stream[1:], "x")
    for k in range(200):
        damaged = bytearray(stream[: rng.integers(1, len(stream))] if k % 2 else stream)
        damaged[rng.integers(0, len(damaged))] = rng.integers(256)
        try:
            meshopt.decompress(extension(record), bytes(damaged), "x")
        except GltfError as error:
            assert re.match("x: the stream (starts with|is truncated|has bytes after|has an unknown)", str(error))


def packed(elements: np.ndarray[Any, Any], widths: np.ndarray[Any, Any]) -> bytes:
    """Encode elements, (N, size) uint8, with the given number of bits per byte or more: 0, 2, 4 or 8 for each group."""
    count, size = elements.shape
    block_size = min(8192 // size // 16 * 16, 256)
    stream = bytearray([0xA0])
    baseline, groups = elements[0].copy(), iter(widths)
    previous = baseline.astype(int)
    for begin in range(0, count, block_size):
        block = elements[begin : begin + block_size].astype(int)
        differences = (np.diff(np.vstack((previous, block)), axis=0) + 128) % 256 - 128
        previous = block[-1]
        zigzag = np.where(differences < 0, -2 * differences - 1, 2 * differences)
        zigzag = np.vstack((zigzag, np.zeros((-len(zigzag) % 16, size), int)))
        for k in range(size):
            headers, data = [], bytearray()
            for group in zigzag[:, k].reshape(-1, 16):
                width = 0 if not group.any() else int(next(groups))
                headers.append(width)
                if width == 3:
                    data += bytes(group.tolist())
                elif width:
                    bits, escape = 2 * width, (1 << 2 * width) - 1
                    codes = np.minimum(group, escape).reshape(-1, 8 // bits)
                    shifts = np.arange(8 // bits)[::-1] * bits
                    data += bytes((codes << shifts).sum(axis=1).tolist()) + bytes(group[group >= escape].tolist())
            headers += [0] * (-len(headers) % 4)
            stream += bytes((np.reshape(headers, (-1, 4)) << np.array([0, 2, 4, 6])).sum(axis=1).tolist())
            stream += data
    return bytes(stream) + bytes(max(0, 32 - size)) + bytes(baseline)


@given(
    st.integers(1, 600), st.sampled_from((4, 8, 20, 36, 256)), st.integers(0, 2**32 - 1), st.sampled_from((2, 9, 256))
)
def test_attributes_of_any_widths(count: int, size: int, seed: int, spread: int) -> None:
    rng = np.random.default_rng(seed)
    elements = np.cumsum(rng.integers(0, spread, (count, size)), axis=0).astype(np.uint8)
    stream = packed(elements, rng.integers(1, 4, count * size))
    assert (decode_attributes(np.frombuffer(stream, np.uint8), count, size) == elements).all()


@pytest.mark.parametrize("mode", ["ATTRIBUTES", "TRIANGLES", "INDICES"])
def test_no_elements(mode: str) -> None:
    record = {"count": 0, "byteStride": 4, "filter": None, "mode": mode}
    assert bytes(meshopt.decompress(extension(record), b"", "x")) == b""


def test_an_unknown_channel_mode() -> None:
    elements = np.arange(4 * 16, dtype=np.uint8)
    stream = bytes([0xA1, 0xFF]) + bytes(elements) + bytes(19) + bytes(4)  # literal bytes, baseline 0
    for mode in (3, 0x10, 0x21):
        with pytest.raises(MeshoptError, match="unknown channel mode"):
            decode_attributes(np.frombuffer(stream + bytes([mode]), np.uint8), 16, 4)
    assert decode_attributes(np.frombuffer(stream + b"\0", np.uint8), 16, 4)[0].tolist() == [0, 8, 16, 24]


@pytest.mark.parametrize("decode", [decode_triangles, decode_indices])
def test_a_stream_of_another_kind(decode: Any) -> None:
    for stream in (b"", b"\xa0" + bytes(40)):
        with pytest.raises(MeshoptError, match="the stream starts with"):
            decode(np.frombuffer(stream, np.uint8), 3)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"count": None}, r"x\.count: None is not a number of elements"),
        ({"count": -1}, r"x\.count: -1 is not"),
        ({"byte_stride": None}, r"x\.byteStride: None is not a multiple of 4 between 4 and 256"),
        ({"byte_stride": 6}, r"x\.byteStride: 6 is not a multiple of 4"),
        ({"byte_stride": 260}, r"x\.byteStride: 260 is not a multiple of 4"),
        ({"mode": "POINTS"}, r"x\.mode: POINTS is not ATTRIBUTES, TRIANGLES or INDICES"),
        ({"mode": "INDICES", "byte_stride": 1}, r"x\.byteStride: 1 is not 2 or 4"),
        ({"mode": "TRIANGLES", "count": 4}, r"x\.count: 4 is not a multiple of 3"),
        ({"filter": "OCTAHEDRAL", "byte_stride": 12}, r"x\.filter: OCTAHEDRAL is not a filter for a byteStride of 12"),
        ({"filter": "QUATERNION"}, r"x\.filter: QUATERNION is not a filter for a byteStride of 4"),
        ({"filter": "CUBIC"}, r"x\.filter: CUBIC is not a filter"),
    ],
)
def test_bad_properties(changes: dict[str, Any], message: str) -> None:
    record = {"count": 4, "byteStride": 4, "filter": None, "mode": "ATTRIBUTES"}
    stride = changes.get("byte_stride") or 4
    stream = packed(np.zeros((4, stride if stride % 4 == 0 else 4), np.uint8), np.array([]))
    with pytest.raises(GltfError, match=message):
        meshopt.decompress(extension(record, **changes), stream, "x")


@pytest.mark.parametrize(
    "name", ["posed_meshopt", "posed_meshopt_filters", "rigid_meshopt_floats", "instanced_meshopt"]
)
def test_files_equal_those_without_compression(name: str) -> None:
    compressed, plain = read_file(name), read_file(name.partition("_")[0])
    assert compressed.warnings == plain.warnings == ()
    assert compressed.instance_count == plain.instance_count
    for ours, expected in zip(world_triangles(compressed), world_triangles(plain), strict=True):
        assert ours.shape == expected.shape
        # Quantized to 14 bits; the encoder may order triangles and vertices anew.
        assert np.abs(np.sort(ours.reshape(-1, 3), axis=0) - np.sort(expected.reshape(-1, 3), axis=0)).max() < 1e-3


def test_the_limit_counts_decompressed_bytes() -> None:
    with pytest.raises(GltfError, match=r"bufferViews\[\d\]\..*buffers exceed"):
        read_file("rigid_meshopt_floats", limits=GltfLimits(max_buffer_bytes=7000))


def compressed_triangle(name: str = "EXT_meshopt_compression", **changes: Any) -> Builder:
    b = Builder()
    stream = packed(TRIANGLE.view(np.uint8).reshape(3, 12), np.full(100, 3))
    source = {"buffer": b.buffer(stream), "byteLength": len(stream), "byteStride": 12, "count": 3, "mode": "ATTRIBUTES"}
    view = {"buffer": b.add("buffers", {"byteLength": 36}), "byteLength": 36, "byteStride": 12}
    b.add("bufferViews", view | {"extensions": {name: source | changes}})
    return b.draw(b.points(0))


@pytest.mark.parametrize("name", ["KHR_meshopt_compression", "EXT_meshopt_compression"])
def test_a_fallback_buffer_without_data_is_not_read(name: str) -> None:
    b = compressed_triangle(name)
    b.json["extensionsRequired"] = b.json["extensionsUsed"] = [name]
    scene = b.read()
    (mesh,) = meshes(scene)
    assert scene.warnings == ()
    assert (mesh.positions == TRIANGLE).all()


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"buffer": 7}, r"bufferViews\[0\]\.extensions\.EXT_meshopt_compression\.buffer: 7 is out of range"),
        ({"buffer": None}, r"bufferViews\[0\]\.extensions\.EXT_meshopt_compression\.buffer: missing"),
        ({"byteLength": 9999}, r"EXT_meshopt_compression: bytes 0 \.\. 9999 are outside of buffers\[0\]"),
        (
            {"count": "3"},
            r"bufferViews\[0\]\.extensions\.EXT_meshopt_compression\.count: expected an integer, got \"3\"",
        ),
        ({"count": 400}, r"bufferViews\[0\]\.extensions\.EXT_meshopt_compression: the stream"),
    ],
)
def test_errors_name_the_buffer_view(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(GltfError, match=message):
        compressed_triangle(**changes).read()


def test_drakes_merge_loses_the_compressed_buffer() -> None:
    b = compressed_triangle()
    b.json["asset"]["generator"] = "Drake glTF merger"
    with pytest.raises(GltfError, match=r"buffers\[1\]: .*uri .*binary chunk"):
        b.read()
    b.json["buffers"][1]["uri"] = "data:;base64," + base64.b64encode(bytes(36)).decode()
    assert (meshes(b.read())[0].positions == 0).all()
