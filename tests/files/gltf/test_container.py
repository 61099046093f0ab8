import base64
import json
import struct
from pathlib import Path
from typing import Any
from urllib.parse import quote_from_bytes

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gateway.files.gltf import GltfError, GltfLimits, read_gltf
from gateway.files.gltf.buffers import decode_data_uri
from gateway.files.gltf.container import open_container
from tests.files.gltf.builder import TRIANGLE, Builder, data_uri, glb, meshes, only_mesh

LONG = np.arange(900, dtype=np.float32).tobytes()


def document(uri: str | None, length: int = 36) -> dict[str, Any]:
    b = Builder()
    b.add("buffers", {"byteLength": length, **({} if uri is None else {"uri": uri})})
    return b.draw(b.points(b.add("bufferViews", {"buffer": 0, "byteLength": length}), length // 12)).json


def positions(data: bytes | memoryview, **options: Any) -> bytes:
    return only_mesh(read_gltf(data, **options)).positions.tobytes()


@pytest.mark.parametrize("data", [TRIANGLE.tobytes(), LONG])
@pytest.mark.parametrize("kind", ["bytes", "memoryview", "part of a bytearray"])
@pytest.mark.parametrize("form", ["compact", "pretty", "glb"])
def test_gltf_and_glb_in_any_buffer_type(data: bytes, kind: str, form: str) -> None:
    if form == "glb":
        text = glb(document(None, len(data)), data)
    else:
        text = json.dumps(document(data_uri(data), len(data)), indent=2 if form == "pretty" else None).encode()
    source: bytes | memoryview = text
    if kind == "memoryview":
        source = memoryview(text)
    elif kind != "bytes":
        source = memoryview(bytearray(b"xxx" + text + b"yyy"))[3:-3]
    assert positions(source) == data


@pytest.mark.parametrize("form", ["uri", "glb"])
def test_a_buffer_shorter_than_its_byte_length_is_used(form: str) -> None:
    """More may be there (the chunk of a binary file ends at a multiple of four); of fewer, what is there is used."""

    def said(length: int) -> bytes:
        source = document(data_uri(LONG) if form == "uri" else None, len(LONG))
        source["buffers"][0]["byteLength"] = length
        return json.dumps(source).encode() if form == "uri" else glb(source, LONG)

    assert positions(said(len(LONG))) == positions(said(len(LONG) - 3)) == LONG
    assert positions(said(len(LONG) + 1)) == LONG
    warning = "buffers[0].byteLength: 3601 is more than the 3600 bytes there; these are used"
    assert read_gltf(said(len(LONG) + 1)).warnings == (warning,)


def test_meshes_do_not_refer_to_the_input() -> None:
    body = bytearray(glb(document(None, len(LONG)), LONG))
    (mesh,) = meshes(read_gltf(memoryview(body)))
    body[:] = bytes(len(body))
    assert mesh.positions.tobytes() == LONG


def test_long_data_uris_are_extracted_from_the_json() -> None:
    text = json.dumps(document(data_uri(LONG), len(LONG))).encode()
    container = open_container(text)
    assert len(container.json) < 600
    assert len(container.data_uris) == 1
    (uri,) = container.data_uris.values()
    assert bytes(uri).decode() == data_uri(LONG)


def test_other_strings_that_look_like_uris_stay_in_the_json() -> None:
    long = "A" * 999
    values = {
        "name": "data:" + long,
        "extras": {'"uri":"data:': long, "x": '"uri": "data:' + long, "y": '\\"uri":"data:' + long},
        "nodes": [{"name": "data:" + long}],
    }
    text = json.dumps(values).encode()
    container = open_container(text)
    assert container.json == text
    assert [path for path, _ in read_gltf(text).root.walk()][1:] == [("data:" + long,)]


@given(
    st.recursive(
        st.one_of(
            st.text('\\":{}uridata ', max_size=20),
            st.sampled_from(["data:" + "AAAA" * count for count in (70, 255, 300)]),
            st.integers(),
        ),
        lambda inner: (
            st.lists(inner, max_size=4)
            | st.dictionaries(st.sampled_from(["uri", "x", '"uri":', "\\"]), inner, max_size=4)
        ),
        max_leaves=12,
    ),
    st.sampled_from([None, 1]),
)
@settings(deadline=None, max_examples=200)
def test_extraction_of_uris_is_reversible(value: Any, indent: int | None) -> None:
    """Inserting the extracted data URIs restores any JSON value."""
    text = json.dumps({"v": value}, indent=indent, ensure_ascii=False).encode()
    for data in (text, memoryview(text)):
        container = open_container(data)

        def restore(v: Any, container: Any = container) -> Any:
            if isinstance(v, str):
                uri = container.data_uris.get(v, v)
                return uri if isinstance(uri, str) else bytes(uri).decode()
            if isinstance(v, list):
                return [restore(item) for item in v]
            return {key: restore(item) for key, item in v.items()} if isinstance(v, dict) else v

        assert restore(json.loads(container.json)) == {"v": value}


@pytest.mark.parametrize(
    ("data", "message"),
    [
        (b"", "the document is empty"),
        (b"PK\x03\x04", r"neither glTF JSON nor GLB: it starts with b'PK"),
        (b"[]", "neither glTF JSON nor GLB"),
        (b"{", "not JSON: "),
        (b'{"nodes":[}', "not JSON: "),
        (b'{"asset":{"generator":"\xff\xfe"}}', "not JSON: "),
        (b'{"asset":{"version":"1.0"}}', r"asset\.version: glTF 1\.0 is not supported, only 2\.x"),
        (b'{"asset":{"minVersion":"3.0"}}', r"asset\.minVersion: glTF 3\.0 is not supported, only 2\.x"),
        (b'{"nodes":' + b"[" * 100_000, "nested too deeply"),
        (b'{"x":' + b'{"x":' * 100_000, "nested too deeply"),
        (b'{"x":NaN,"nodes":' + b"[" * 100_000 + b"]" * 100_000 + b"}", "nested too deeply"),
        (b"glTF", "GLB: 4 bytes are too few"),
        (struct.pack("<4sIIII", b"glTF", 1, 20, 0, 0), "GLB: version 1 is not supported"),
        (struct.pack("<4sIIII", b"glTF", 2, 99, 0, 0), "GLB: the header announces 99 bytes, but there are 20"),
        (
            struct.pack("<4sIIII", b"glTF", 2, 20, 4, 0x4E4F534A),
            "the chunk at byte 12 has 4 bytes, but only 0 are left",
        ),
        (struct.pack("<4sIIII", b"glTF", 2, 20, 0, 0x004E4942), r"the first chunk is of type 0x004e4942, not JSON"),
        (struct.pack("<4sIIII", b"glTF", 2, 12, 0, 0), "there is no JSON chunk"),
    ],
)
def test_rejects_other_files(data: bytes, message: str) -> None:
    with pytest.raises(GltfError, match=message):
        read_gltf(data)


def test_glb_with_trailing_bytes_more_chunks_and_zero_padding() -> None:
    """Of several binary chunks, the first one counts."""
    text = json.dumps(document(None)).encode()
    text += b"\0" * (4 - len(text) % 4)
    data = glb(text, TRIANGLE.tobytes())
    extra = struct.pack("<I4s", 4, b"ACME") + b"abcd" + struct.pack("<I4s", 36, b"BIN\0") + bytes(36)
    data = struct.pack("<4sII", b"glTF", 2, len(data) + len(extra)) + data[12:] + extra + b"trailing"
    assert positions(data) == TRIANGLE.tobytes()


@pytest.mark.parametrize("padding", [0, 1, 2, 3])
@pytest.mark.parametrize("padded", [False, True])
def test_glb_with_unaligned_chunks(padding: int, padded: bool) -> None:
    text = json.dumps(document(None)).encode()
    text += b" " * (-len(text) % 4 + padding)
    gap = bytes(-len(text) % 4) if padded else b""
    chunks = struct.pack("<I4s", len(text), b"JSON") + text + gap
    chunks += struct.pack("<I4s", TRIANGLE.nbytes, b"BIN\0") + TRIANGLE.tobytes()
    assert positions(struct.pack("<4sII", b"glTF", 2, 12 + len(chunks)) + chunks) == TRIANGLE.tobytes()


@pytest.mark.parametrize("kind", [bytes, memoryview])
def test_a_million_quotes_before_data_stay_in_the_json(kind: Any) -> None:
    text = b'{"x":[' + b'"data:",' * 1_000_000 + b"0]}"
    assert open_container(kind(text)).json == text
    with pytest.raises(GltfError, match="max_json_values"):
        read_gltf(kind(text), limits=GltfLimits(max_json_values=100_000))


@pytest.mark.parametrize(
    "uri",
    [
        "data:application/octet-stream;base64,{b}",
        "data:image/png;charset=utf-8;base64,{b}",
        "DATA:;BASE64,{b}",
        "data:;base64,{lines}",
        "data:;base64,{bare}",
        "data:;base64,{url}",
        "data:;base64,{percent}",
        "data:application/octet-stream,{raw}",
    ],
)
@pytest.mark.parametrize("size", [36, 3600])
def test_data_uris(uri: str, size: int) -> None:
    data = np.random.default_rng(size).random(size // 4, np.float32).tobytes()
    b = base64.b64encode(data).decode()
    text = uri.format(
        b=b,
        lines="\r\n".join(b[i : i + 76] for i in range(0, len(b), 76)),
        bare=b.rstrip("="),
        url=base64.urlsafe_b64encode(data).decode(),
        percent=b.replace("+", "%2B").replace("/", "%2F").replace("=", "%3D"),
        raw=quote_from_bytes(data),
    )
    assert positions(json.dumps(document(text, size)).encode()) == data


def test_json_escapes_within_a_data_uri() -> None:
    data = bytes([255]) * 3600
    text = json.dumps(document(data_uri(data), 3600)).encode().replace(b"/", b"\\/")
    assert b"\\/" in text
    scene = read_gltf(text)
    assert scene.warnings[0].endswith("are left out")  # 0xFFFFFFFF is NaN: the bytes arrived


@given(st.binary(max_size=200))
def test_data_uri_round_trip(data: bytes) -> None:
    for uri in (data_uri(data), "data:," + quote_from_bytes(data)):
        assert decode_data_uri(memoryview(uri.encode())) == data


@given(st.binary(max_size=100))
def test_any_data_uri_is_decoded_or_a_value_error(text: bytes) -> None:
    for head in (b"", b"data:,", b"data:;base64,"):
        try:
            assert isinstance(decode_data_uri(memoryview(head + text)), bytes)
        except ValueError:
            pass


def test_relative_uris_need_a_resolver() -> None:
    asked = []

    def resolve(uri: str) -> bytes:
        asked.append(uri)
        return TRIANGLE.tobytes()

    text = json.dumps(document("my%20mesh.bin")).encode()
    assert positions(text, resolve=resolve) == TRIANGLE.tobytes()
    assert asked == ["my mesh.bin"]
    with pytest.raises(GltfError, match=r"buffers\[0\]\.uri: 'my%20mesh.bin' "):
        read_gltf(text)


def test_a_posted_document_without_its_buffer_is_one_sentence() -> None:
    b = Builder()
    for _ in range(5):
        b.draw()
    for buffer in b.json["buffers"]:
        buffer["uri"] = "scene.bin"
    with pytest.raises(GltfError) as error:
        b.read()
    assert str(error.value).count("scene.bin") == str(error.value).count("post a .glb") == 1
    b.json["buffers"][0]["uri"] = data_uri(TRIANGLE.tobytes())
    assert len(meshes(b.read())) == 1


@pytest.mark.parametrize("uri", ["file:///etc/passwd", "http://example.org/a.bin", "/etc/passwd", "C:\\a", "\\\\h\\a"])
def test_of_other_uris_only_the_name_reaches_the_resolver(uri: str) -> None:
    asked = []

    def resolve(uri: str) -> bytes:
        asked.append(uri)
        raise FileNotFoundError(uri)

    with pytest.raises(GltfError, match=r"buffers\[0\]\.uri: .*data URIs"):
        read_gltf(json.dumps(document(uri)).encode(), resolve=resolve)
    assert asked in (["passwd"], ["a.bin"], ["a"])


@pytest.mark.parametrize(
    ("uri", "found"),
    [
        (".\\my%20mesh.bin", "./my mesh.bin"),
        ("parts\\mesh.bin", "parts/mesh.bin"),
        ("parts/mesh.bin", "mesh.bin"),
        ("file:///C:/Users/me/mesh.bin", "mesh.bin"),
        ("C:\\Users\\me\\mesh.bin", "mesh.bin"),
    ],
)
def test_a_file_named_as_on_another_machine_lies_beside(uri: str, found: str) -> None:
    scene = read_gltf(json.dumps(document(uri)).encode(), resolve={found: TRIANGLE.tobytes()}.__getitem__)
    assert meshes(scene)[0].positions.tobytes() == TRIANGLE.tobytes()
    (warning,) = scene.warnings
    assert repr(found) in warning


def test_failures_of_the_resolver_name_the_file(tmp_path: Path) -> None:
    def resolve(uri: str) -> bytes:
        return (tmp_path / uri).read_bytes()

    with pytest.raises(GltfError) as raised:
        read_gltf(json.dumps(document("gone.bin")).encode(), resolve=resolve)
    assert "buffers[0].uri: cannot read 'gone.bin': No such file or directory; meshes[0]" in str(raised.value)


def test_buffers_are_limited_before_decoding() -> None:
    text = json.dumps(document(data_uri(LONG), len(LONG))).encode()
    assert positions(text, limits=GltfLimits(max_buffer_bytes=4000)) == LONG
    with pytest.raises(GltfError, match=r"buffers\[0\]\.uri: .*max_buffer_bytes = 3000"):
        read_gltf(text, limits=GltfLimits(max_buffer_bytes=3000))
    with pytest.raises(GltfError, match="the binary chunk: the buffers exceed"):
        read_gltf(glb(document(None, len(LONG)), LONG), limits=GltfLimits(max_buffer_bytes=3000))


def test_the_smallest_glb_has_a_header_and_an_empty_chunk() -> None:
    empty = struct.pack("<4sIII4s", b"glTF", 2, 20, 0, b"JSON")
    with pytest.raises(GltfError, match="not JSON"):
        read_gltf(empty)
    with pytest.raises(GltfError, match="GLB: 19 bytes are too few"):
        read_gltf(empty[:19])


def test_a_document_may_start_with_white_space() -> None:
    assert read_gltf(b"\xef\xbb\xbf" + b" \t\r\n" * 15 + b"{}").instance_count == 0  # 63 bytes before the brace
    with pytest.raises(GltfError, match="neither glTF JSON nor GLB"):
        read_gltf(b" " * 64 + b"{}")


@pytest.mark.parametrize(("size", "extracted"), [(1023, False), (1024, True)])
def test_data_uris_of_a_kilobyte_are_extracted(size: int, extracted: bool) -> None:
    uri = "data:;base64,".ljust(size, "A")
    container = open_container(json.dumps({"buffers": [{"uri": uri}]}).encode())
    assert len(container.data_uris) == extracted
    assert (uri.encode() in container.json) != extracted


@pytest.mark.parametrize(("size", "allowed"), [(1024, True), (1025, False)])
def test_the_comma_of_a_data_uri_is_within_its_first_kilobyte(size: int, allowed: bool) -> None:
    uri = "data:".ljust(size - 1, "x") + ",ab"
    if allowed:
        assert decode_data_uri(uri) == decode_data_uri(memoryview(uri.encode())) == b"ab"
    else:
        for form in (uri, memoryview(uri.encode())):
            with pytest.raises(ValueError, match="no comma within its first 1024 bytes"):
                decode_data_uri(form)


@pytest.mark.parametrize(("length", "shown"), [(80, "a" * 80), (81, "a" * 77 + "...")])
def test_long_names_of_files_are_shortened_in_messages(length: int, shown: str) -> None:
    with pytest.raises(GltfError, match=rf": '{shown}' is a file"):
        read_gltf(json.dumps(document("a" * length)).encode())


def test_only_buffer_0_is_the_binary_chunk() -> None:
    source = document(None)
    source["buffers"].insert(0, {"byteLength": 36})
    source["bufferViews"][0]["buffer"] = 1
    with pytest.raises(GltfError, match=r"buffers\[1\]: .*uri .*binary chunk"):
        read_gltf(glb(source, TRIANGLE.tobytes()))


@pytest.mark.parametrize("value", ["1e999", "-1e999", "NaN", "Infinity", "-Infinity"])
@pytest.mark.parametrize("place", ["translation", "scale", "rotation"])
def test_numbers_that_are_not_finite_are_ignored(value: str, place: str) -> None:
    count = 4 if place == "rotation" else 3
    text = json.dumps({"nodes": [{place: [0] * count}]}).replace("0]", f"{value}]")
    scene = read_gltf(text.encode())
    shown = value.replace("1e999", "Infinity")
    assert scene.warnings == (f"nodes[0].{place}[{count - 1}]: expected a finite number, got {shown}; it is ignored",)
    assert scene.nodes.X_parent_node.tolist() == [np.eye(4).tolist()]


def test_a_later_minor_version_is_read_with_a_warning() -> None:
    b = Builder()
    b.json["asset"].update(version="2.1", minVersion="2.1")
    b.node(mesh=b.triangle())
    scene = b.read()
    assert scene.instance_count == 1
    assert scene.warnings == ("asset.minVersion: glTF 2.1 is read as glTF 2.0",)
