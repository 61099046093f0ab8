"""Forms of Drake's and other clients, and errors for invalid ones."""

import dataclasses
import hashlib
import math
import re
from base64 import b64encode
from itertools import pairwise
from typing import Any

import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.errors import MAX_MESSAGE_BYTES, RequestError, message_bytes, quoted
from gateway.adapters.render.form import FormReader
from gateway.adapters.render.request import RenderRequest
from tests.support.corpus import DrakeScene, drake_scenes
from tests.support.forms import BOUNDARY, CONTENT_TYPE, body, closed, drake_fields, part

CONFIG = RenderConfig()
SCENE = b'{"asset":{"version":"2.0"}}'


def read(
    data: bytes, content_type: str = CONTENT_TYPE, *, config: RenderConfig = CONFIG, step: int = 0
) -> RenderRequest:
    """Feed a body in pieces. Reading it in a buffer has the same result."""
    outcome = in_buffer(data, content_type, config, step)
    try:
        request = feed(data, content_type, config, step)
    except RequestError as error:
        assert outcome == (error.status, without_position(error.sentence))
        raise
    assert outcome == dataclasses.asdict(request)
    return request


def feed(data: bytes, content_type: str, config: RenderConfig, step: int) -> RenderRequest:
    reader = FormReader(content_type, config)
    for start in range(0, len(data), step or len(data) or 1):
        reader.feed(data[start : start + (step or len(data))])
    return reader.request()


def in_buffer(data: bytes, content_type: str, config: RenderConfig, step: int) -> dict[str, Any] | tuple[int, str]:
    """The request that a body in a buffer is read as, or the error."""
    buffer = bytearray(len(data))
    try:
        reader = FormReader(content_type, config)
        for start in range(0, len(data), step or len(data) or 1):
            end = min(start + (step or len(data)), len(data))
            buffer[start:end] = data[start:end]
            reader.read(buffer, end)
        return dataclasses.asdict(reader.request(buffer))
    except RequestError as error:
        return error.status, without_position(error.sentence)


def without_position(sentence: str) -> str:
    return re.sub(r" at \d+$| \(\d+\)$", "", sentence)


def refused(data: bytes, content_type: str = CONTENT_TYPE, *, config: RenderConfig = CONFIG) -> str:
    with pytest.raises(RequestError) as error:
        read(data, content_type, config=config)
    assert error.value.status == 400
    return error.value.sentence


def refused_fields(image_type: str = "color", **changes: str | None) -> str:
    return refused(body(SCENE, drake_fields(image_type, **changes)))


@pytest.mark.corpus
@pytest.mark.parametrize("scene", drake_scenes() or [None], ids=str)
def test_recorded_forms(scene: DrakeScene | None) -> None:
    if scene is None:
        pytest.skip("SCENEGATE_CORPUS does not name a folder with recorded requests")
    for image_type in ("color", "depth", "label"):
        recorded = scene.request(image_type)
        fields = recorded.fields
        request = read(recorded.body, recorded.content_type, step=65536)
        assert request.image_type == image_type
        assert (request.width, request.height) == (int(fields["width"]), int(fields["height"]))
        for name in ("focal_x", "focal_y", "center_x", "center_y", "near", "far"):
            assert getattr(request, name) == float(fields[name])
        if image_type == "depth":
            assert (request.min_depth, request.max_depth) == (float(fields["min_depth"]), float(fields["max_depth"]))
        assert bytes(request.scene) == recorded.scene
        assert request.claimed_sha256 == fields["scene_sha256"]
        assert request.scene_filename.endswith(".gltf")
        assert request.warnings == ()


@settings(deadline=None, max_examples=60)
@given(st.binary(min_size=1, max_size=400), st.integers(1, 70))
def test_scene_is_complete_in_pieces_of_any_size(scene: bytes, step: int) -> None:
    scene = scene.replace(b"?", b"\r\n--" + BOUNDARY[:9].encode())  # half a boundary is data
    request = read(body(scene), step=step)
    assert bytes(request.scene) == scene


_LURES = [b"\r", b"\n", b"\r\n", b"\r\n--", b"\r\n--" + BOUNDARY[:-1].encode(), b"--" + BOUNDARY.encode()]


@settings(deadline=None, max_examples=80)
@given(
    st.lists(st.one_of(st.integers(1, 9000), st.sampled_from(_LURES)), min_size=1, max_size=8),
    st.lists(st.integers(0, 30_000), max_size=12),
    st.booleans(),
)
def test_scene_of_any_bytes_in_pieces_of_any_size(parts: list[int | bytes], cuts: list[int], first: bool) -> None:
    scene = b"".join(bytes(each % 12 + 40 for each in range(p)) if isinstance(p, int) else p for p in parts)
    assume(b"\r\n--" + BOUNDARY.encode() not in scene)  # two lures can be a boundary together
    fields = [part(name, value.encode()) for name, value in drake_fields().items()]
    own = part("scene", scene, filename="s.gltf")
    data = closed(own, *fields) if first else closed(*fields, own)
    reader = FormReader(CONTENT_TYPE, CONFIG)
    ends = sorted({min(cut, len(data)) for cut in cuts} | {len(data)})
    for begin, end in pairwise([0, *ends]):
        reader.feed(data[begin:end])
    request = reader.request()
    assert request.scene == scene
    assert (request.width, request.far) == (64, 10.0)


def test_fields_in_any_order_with_preamble_and_epilogue() -> None:
    parts = [part(name, value.encode()) for name, value in reversed(drake_fields().items())]
    request = read(b"\r\n" + closed(part("scene", SCENE), *parts) + b"epilogue")
    assert bytes(request.scene) == SCENE
    assert request.width == 64


def test_other_clients_scene_parts() -> None:
    """drake-blender's tests send no content type; a form may carry any file name, or none."""
    for headers, filename in (
        ((), "scene.glb"),
        (("content-type: application/octet-stream",), "../../etc/x"),
        ((), None),
    ):
        assert bytes(read(body(SCENE, scene_headers=headers, filename=filename)).scene) == SCENE


def test_number_formats() -> None:
    request = read(body(SCENE, drake_fields(width="64.0", height="+48", near=" 1e-2 ", far="10", focal_x=".5e2")))
    assert (request.width, request.height, request.near, request.far, request.focal_x) == (64, 48, 0.01, 10.0, 50.0)


def test_a_near_plane_rounded_to_zero_is_accepted() -> None:
    """std::to_string prints six decimals: 1e-7 arrives as 0.000000. Drake's own demo server refuses it."""
    assert read(body(SCENE, drake_fields(near="0.000000"))).near == 0.0
    assert read(body(SCENE, drake_fields("depth", min_depth="0.000000"))).min_depth == 0.0


def test_hashes() -> None:
    digest = hashlib.sha256(SCENE).hexdigest()
    request = read(body(SCENE, drake_fields(scene_sha256=digest.upper())))
    assert request.claimed_sha256 == digest
    assert request.warnings == ()
    for careless in ("NOT_USED_IN_THE_TEST", "", digest[:-1]):
        request = read(body(SCENE, drake_fields(scene_sha256=careless)))
        assert request.claimed_sha256 is None
        assert any("scene_sha256" in warning for warning in request.warnings)
    missing = closed(*(part(n, v.encode()) for n, v in drake_fields().items()), part("scene", SCENE))
    assert read(missing).warnings == ("scene_sha256 is missing",)


def test_unknown_fields_are_ignored_with_a_warning() -> None:
    request = read(body(SCENE, drake_fields(renderer="fast")))
    assert request.warnings == ("the field 'renderer' is unknown and ignored",)


def test_the_look_is_a_choice_that_drake_never_sends() -> None:
    assert read(body(SCENE, drake_fields())).look is None
    assert read(body(SCENE, drake_fields(scenegate_look="studio"))).look == "studio"
    choices = "scenegate_look must be auto, phong, pbr, gltf, plain or studio, got "
    for name in ("Studio", "vtk", "x" * 500):
        assert refused_fields(scenegate_look=name) == choices + quoted(name)
    assert refused_fields(scenegate_look="") == "the field 'scenegate_look' is empty"


def test_a_missing_focal_length_comes_from_the_field_of_view() -> None:
    request = read(body(SCENE, drake_fields(focal_x=None, focal_y="")))
    assert request.focal_x == pytest.approx(57.941125, rel=1e-6)
    assert request.focal_y == pytest.approx(57.941125, rel=1e-6)
    assert read(body(SCENE, drake_fields(fov_x=None, fov_y=None))).focal_x == 57.941125
    assert "fov_x must be less than pi" in refused_fields(focal_x=None, fov_x="3.2")
    assert "fov_x must be less than pi" in refused_fields(fov_x="3.2")
    assert "fov_y must be positive" in refused_fields(fov_y="0")


def test_all_missing_fields_are_named_at_once() -> None:
    fields: dict[str, str | None] = dict.fromkeys(("width", "near", "max_depth", "focal_x", "fov_x"))
    fields["far"] = ""
    text = refused_fields("depth", **fields)
    assert all(f"'{name}'" in text for name in ("width", "near", "far", "max_depth", "focal_x"))
    text = refused(closed(part("unknown", b"1")))
    assert all(f"'{name}'" in text for name in ("scene", "image_type", "width", "center_y", "focal_y"))


@pytest.mark.parametrize("name", ["width", "height", "near", "far", "focal_x", "center_x", "center_y", "image_type"])
def test_errors_name_missing_and_empty_fields(name: str) -> None:
    without_fov: dict[str, Any] = {"fov_x": None, "fov_y": None}
    assert refused_fields(**{**without_fov, name: None}) == f"the field '{name}' is missing"
    assert refused_fields(**{**without_fov, name: ""}) == f"the field '{name}' is empty"


def test_depth_requires_its_range() -> None:
    assert refused_fields("depth", max_depth=None) == "the field 'max_depth' is missing; depth images need it"
    assert "min_depth must be less than max_depth, got 5 and 5" in refused_fields("depth", min_depth="5")
    assert read(body(SCENE, drake_fields(min_depth="5", max_depth=""))).max_depth == math.inf  # not used for colour
    assert "min_depth must be a finite decimal number" in refused_fields("color", min_depth="nonsense")


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"width": "0"}, "width must be a whole number from 1 to 16384, got '0'"),
        ({"width": "-64"}, "width must be a whole number"),
        ({"width": "64.5"}, "width must be a whole number"),
        ({"width": "99999999999999999999"}, "width must be a whole number"),
        ({"height": "٤٨"}, "height must be a whole number"),
        ({"height": "1_0"}, "height must be a whole number"),
        ({"width": "16384", "height": "16384"}, "268435456 pixels, the limit is 16777216 (max_pixels)"),
        ({"near": "-0.1"}, "near must be at least 0, got '-0.1'"),
        ({"near": "nan"}, "near must be a finite decimal number, got 'nan'"),
        ({"near": "10"}, "near must be less than far, got near=10 and far=10"),
        ({"near": "0", "far": "5e-324"}, "far must be at least 1e-08, got '5e-324'"),
        ({"far": "inf"}, "far must be a finite decimal number, got 'inf'"),
        ({"far": "1e999"}, "far must be a finite decimal number"),
        ({"far": "1e13"}, "far must be at most 1e+12"),
        ({"focal_x": "0"}, "focal_x must be positive, got '0'"),
        ({"focal_y": "1e30"}, "focal_y must be at most 1e+09"),
        ({"focal_y": "1e-30"}, "focal_y = 1e-30 pixels is not from"),
        ({"fov_x": "x"}, "fov_x must be a finite decimal number, got 'x'"),
        ({"center_x": "64"}, "center_x must be less than the width (64), got '64'"),
        ({"center_y": "0"}, "center_y must be positive, got '0'"),
        ({"image_type": "rgb"}, "image_type must be color, depth or label, got 'rgb'"),
        ({"image_type": "COLOR"}, "image_type must be color, depth or label"),
        ({"width": "\x1b[31m\udcff".encode("utf-8", "replace").decode()}, r"got '\x1b[31m?'"),
    ],
)
def test_errors_name_bad_values_and_what_is_accepted(changes: dict[str, str], words: str) -> None:
    assert words in refused_fields(**changes)


FIELDS = [part(name, value.encode()) for name, value in drake_fields().items()]
HEAD = f"--{BOUNDARY}\r\n".encode()


@pytest.mark.parametrize(
    ("data", "words"),
    [
        (body(None), "'scene' (the glTF file) is missing"),
        (body(b""), "'scene' is an empty file"),
        (closed(*FIELDS, part("width", b"65"), part("scene", SCENE)), "'width' was sent twice"),
        (closed(*FIELDS, part("scene", SCENE), part("scene", SCENE)), "'scene' was sent twice"),
        (closed(part("far", b"1"), HEAD + b"X: y\r\n\r\nvalue\r\n"), "part 2 of the form needs Content-Disposition"),
        (closed(HEAD + b"Content-Disposition: form-data\r\n\r\nvalue\r\n"), "part 1 of the form needs Content-"),
        (closed(part("", b"value")), "part 1 of the form needs Content-Disposition: form-data; name="),
        (closed(part("width", b"\xff\xfe")), r"the field 'width' is not UTF-8 text: '\\xff\\xfe'"),
        (b"", "cut short after 0 bytes, before the closing boundary"),
        (b"something else entirely", "malformed"),
    ],
)
def test_forms_that_are_refused(data: bytes, words: str) -> None:
    assert words in refused(data)


def test_bodies_that_are_not_forms() -> None:
    assert "got none" in refused(b"{}", "")
    assert "Content-Type must be multipart/form-data, got 'application/json'" in refused(b"{}", "application/json")
    assert "names no boundary" in refused(b"", "multipart/form-data")
    assert "boundary" in refused(b"", f"multipart/form-data; boundary={'x' * 500}")
    with pytest.raises(RequestError, match="60021 characters, the limit is 4096"):
        FormReader("multipart/form-data; " + "a=b;" * 15_000, RenderConfig())
    whole = body(SCENE)
    for length in (1, 100, len(whole) // 2, len(whole) - 100, len(whole) - 10):
        assert "cut short" in refused(whole[:length])
    near, far = part("near", b"0.01"), part("far", b"10")
    cut_in_far = near + far[:-4]
    where = f"after {len(cut_in_far)} bytes, before the closing boundary"
    assert refused(cut_in_far) == f"the upload was cut short {where}; the last complete part is 'near'"


def test_encoded_parts_are_decoded() -> None:
    fields = [part(name, value.encode()) for name, value in drake_fields(width=None).items()]
    width = part("width", b"NjQ=", ("Content-Transfer-Encoding: base64",))
    scene = part("scene", b64encode(SCENE), ("Content-Transfer-Encoding: BASE64",), filename="scene.gltf")
    request = read(closed(width, *fields, scene), step=7)
    assert (request.width, bytes(request.scene)) == (64, SCENE)
    broken = part("width", b"NjQ", ("Content-Transfer-Encoding: base64",))
    assert "part 1 of the form: There are 3 bytes remaining" in refused(closed(broken))


@pytest.mark.parametrize("encoding", ["binary", "", "gzip"])
def test_parts_in_other_encodings_are_read_as_they_are(encoding: str) -> None:
    request = read(body(SCENE, scene_headers=(f"Content-Transfer-Encoding: {encoding}",)))
    assert (request.width, bytes(request.scene)) == (64, SCENE)


def test_bounds() -> None:
    tight = RenderConfig(max_parts=3, max_field_bytes=10, max_part_headers=2, max_header_bytes=120, max_body_bytes=5000)
    many = closed(*(part(f"x{i}", b"") for i in range(4)))
    assert refused(many, config=tight) == "the form has more than 3 parts"
    assert "'width' is longer than 10 bytes" in refused(closed(part("width", b"1" * 11)), config=tight)
    assert "header count" in refused(closed(part("width", b"1", ("A: b", "C: d"))), config=tight)
    assert "header size" in refused(closed(part("width", b"1", ("A: " + "b" * 120,))), config=tight)
    with pytest.raises(RequestError, match=r"limit is 5000 \(max_body_bytes\)") as error:
        read(closed(part("scene", b"x" * 5000)), config=tight)
    assert error.value.status == 413


@settings(deadline=None, max_examples=150)
@given(st.data())
def test_mutated_forms_give_a_request_or_an_error(data: st.DataObject) -> None:
    """In pieces and in a buffer. Values at damaged boundaries depend on the pieces that python-multipart gets."""
    image_type = data.draw(st.sampled_from(("color", "depth", "label")))
    whole = bytearray(body(SCENE, drake_fields(image_type)))
    for _ in range(data.draw(st.integers(1, 6))):
        start = data.draw(st.integers(0, len(whole)))
        length = data.draw(st.integers(0, 40))
        whole[start : start + length] = data.draw(st.binary(max_size=40))
    content_type = data.draw(st.just(CONTENT_TYPE) | st.text(max_size=60).map(lambda t: f"multipart/form-data; {t}"))
    step = data.draw(st.integers(1, len(whole) + 1))
    request, error = None, None
    try:
        in_buffer(bytes(whole), content_type, CONFIG, step)
        request = feed(bytes(whole), content_type, CONFIG, step)
    except RequestError as refusal:
        error = refusal
    if error is not None:
        assert error.status in (400, 413)
        assert 0 < len(message_bytes(error.sentence)) <= MAX_MESSAGE_BYTES
    if request is not None:
        assert request.scene
        assert 0 < request.width * request.height <= CONFIG.max_pixels


@given(st.text(max_size=300))
def test_messages_are_plain_utf8_text_below_drakes_limit(text: str) -> None:
    for sentence in (text, text * 100, quoted(text), quoted(text.encode("utf-8", "surrogatepass"))):
        decoded = message_bytes(sentence).decode()
        assert len(message_bytes(sentence)) <= MAX_MESSAGE_BYTES
        assert all(character == "\n" or character.isprintable() or ord(character) >= 0xA0 for character in decoded)
