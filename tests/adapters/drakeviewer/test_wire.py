"""The decoders against lcm-gen's classes, Drake's own classes, damage and limits."""

import importlib
import json
import os
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from gateway.adapters.drakeviewer import wire
from gateway.adapters.drakeviewer.config import Limits
from gateway.adapters.drakeviewer.wire import MessageError
from tests.adapters.drakeviewer import encoding
from tests.support.lcm_gen import generate
from tests.support.waiting import SECONDS

TYPES = {
    "lcmt_viewer_load_robot": wire.LOAD_ROBOT,
    "lcmt_viewer_link_data": wire.LINK_DATA,
    "lcmt_viewer_draw": wire.DRAW,
    "lcmt_contact_results_for_viz": wire.CONTACT_RESULTS,
    "lcmt_point_cloud": wire.POINT_CLOUD,
}
LIMITS = Limits()
DECODERS = {
    wire.decode_load_robot: encoding.load(encoding.link("a", 0, encoding.geometry(1, [1, 2, 3]))),
    wire.decode_link_data: encoding.deformables(encoding.geometry(4, encoding.TETRAHEDRON)),
    wire.decode_draw: encoding.draw({(0, "a"): encoding.IDENTITY}),
    wire.decode_contacts: encoding.contacts(
        [encoding.point_contact("a", "b", (1, 2, 3), (4, 5, 6))], [encoding.surface_contact()]
    ),
    wire.decode_point_cloud: encoding.cloud(bytes(12), 1, [("x", 0, 7, 1)], 12),
}


@pytest.fixture(scope="module")
def drake(tmp_path_factory: pytest.TempPathFactory) -> Any:
    folder = tmp_path_factory.mktemp("lcmgen")
    generate(folder, "lcmt_*.lcm")
    sys.path.insert(0, str(folder))
    sys.modules.pop("drake", None)
    try:
        yield importlib.import_module("drake")
    finally:
        sys.path.remove(str(folder))
        for name in [name for name in sys.modules if name.partition(".")[0] == "drake"]:
            del sys.modules[name]


@pytest.mark.parametrize("name", TYPES)
def test_definitions_have_the_fingerprints_that_the_decoders_expect(drake: Any, name: str) -> None:
    assert int.from_bytes(getattr(drake, name)._get_packed_fingerprint(), "big") == TYPES[name]  # noqa: SLF001 - LCM's own


@pytest.mark.drake
@pytest.mark.parametrize("variable", ["SCENEGATE_DRAKE_PYTHON", "SCENEGATE_NEW_DRAKE_PYTHON"])
def test_fingerprints_are_those_of_drake(variable: str) -> None:
    python = os.environ.get(variable)
    if not python:
        pytest.skip(f"{variable} does not name an interpreter with pydrake")
    code = "import drake, json, sys; types = [getattr(drake, name) for name in sys.argv[1:]]\n"
    code += "print(json.dumps([found._get_packed_fingerprint().hex() for found in types]))"
    done = subprocess.run([python, "-c", code, *TYPES], capture_output=True, text=True, check=True, timeout=SECONDS)
    assert [int(value, 16) for value in json.loads(done.stdout)] == list(TYPES.values())


def test_helpers_encode_as_lcm_gen(drake: Any) -> None:
    message = drake.lcmt_viewer_load_robot()
    message.num_links = 1
    link = drake.lcmt_viewer_link_data()
    link.name, link.robot_num, link.num_geom = "größe::a", 3, 1
    shape = drake.lcmt_viewer_geometry_data()
    shape.type, shape.position, shape.quaternion, shape.color = 6, [1, 2, 3], [1, 0, 0, 0], [0.5, 0.25, 0, 1]
    shape.string_data, shape.num_float_data, shape.float_data = "text", 3, [1, 2, 3]
    link.geom, message.link = [shape], [link]
    ours = encoding.geometry(6, [1, 2, 3], (0.5, 0.25, 0, 1), (1, 2, 3, 1, 0, 0, 0), "text")
    assert message.encode() == encoding.load(encoding.link("größe::a", 3, ours))
    poses = {(1, "a"): (1, 2, 3, 1, 0, 0, 0), (2, "b"): (4, 5, 6, 0, 1, 0, 0)}
    theirs = drake.lcmt_viewer_draw.decode(encoding.draw(poses))
    assert (theirs.link_name, list(theirs.robot_num)) == (["a", "b"], [1, 2])
    assert np.column_stack((theirs.position, theirs.quaternion)).tolist() == [list(p) for p in poses.values()]
    for kind, name in (
        (wire.decode_contacts, "lcmt_contact_results_for_viz"),
        (wire.decode_link_data, "lcmt_viewer_link_data"),
        (wire.decode_point_cloud, "lcmt_point_cloud"),
    ):
        assert getattr(drake, name).decode(DECODERS[kind]).encode() == DECODERS[kind]


def test_draw_reuses_known_names() -> None:
    poses = {(1, "a"): (1, 2, 3, 1, 0, 0, 0), (2, "b"): (4, 5, 6, 0, 1, 0, 0)}
    first = wire.decode_draw(encoding.draw(poses), LIMITS)
    again = wire.decode_draw(memoryview(encoding.draw(poses)), LIMITS, first.names)
    assert again.names is first.names
    assert again.poses.tolist() == [list(pose) for pose in poses.values()]
    other = wire.decode_draw(
        encoding.draw({(1, "a"): encoding.IDENTITY, (3, "b"): encoding.IDENTITY}), LIMITS, first.names
    )
    assert other.names.keys == ((1, "a"), (3, "b"))


@pytest.mark.parametrize("decode", DECODERS)
def test_rejects_damage(decode: Any) -> None:
    message = DECODERS[decode]
    decode(message, LIMITS)
    for size in range(len(message)):
        with pytest.raises(MessageError):
            decode(message[:size], LIMITS)
    with pytest.raises(MessageError, match="fingerprint"):
        decode(b"\0" + message[1:], LIMITS)
    for position in range(8, len(message)):
        for value in (0x7F, 0xFF):
            changed = bytearray(message)
            changed[position] = value
            try:
                decode(bytes(changed), LIMITS)
            except MessageError:
                pass


@pytest.mark.parametrize(
    ("decode", "limits", "reason"),
    [
        (wire.decode_load_robot, Limits(links=0), "num_links is 1, the limit is 0"),
        (wire.decode_load_robot, Limits(geometries=0), "num_geom is 1, the limit is 0"),
        (wire.decode_load_robot, Limits(name_bytes=0), "a text has 2 bytes with its NUL, the limit is 1"),
        (wire.decode_link_data, Limits(vertices=1, triangles=1), "num_float_data is 26, the limit is 8"),
        (wire.decode_contacts, Limits(contacts=0), "num_point_pair_contacts is 1, the limit is 0"),
        (wire.decode_point_cloud, Limits(points=0), "1 x 1 points, the limit is 0"),
    ],
)
def test_limits(decode: Any, limits: Limits, reason: str) -> None:
    with pytest.raises(MessageError, match=reason):
        decode(DECODERS[decode], limits)
