"""Every limit of a request at exactly its value, and one beyond it."""

import json
from typing import Any

import msgspec
import pytest

from gateway.adapters.treeviewer.config import Limits
from scenegate.messages import wire
from tests.adapters.treeviewer.conversation import BOX, Viewer

POINT = [0.0, 0.0, 0.0]
LONG = 1000
"""Length of arrays that are taken out of the JSON text."""


def geometry(**fields: Any) -> dict[str, Any]:
    return {"setgeometry": [{"path": ["a"], "geometry": fields}]}


def mesh(vertices: int, faces: int) -> dict[str, Any]:
    return geometry(type="mesh_data", vertices=[POINT] * vertices, faces=[[0, 1, 2]] * faces)


def cloud(points: int, channels: int = 0) -> dict[str, Any]:
    named = {f"c{i}": [1.0] * points for i in range(channels)}
    return geometry(type="pointcloud", points=[POINT] * points, channels=named)


def line(points: int) -> dict[str, Any]:
    return geometry(type="line", points=[POINT] * points)


def lidar(ranges: int) -> dict[str, Any]:
    return geometry(type="planar_lidar", ranges=[1.0] * ranges, angle_start=0, angle_step=1)


def heightmap(rows: int) -> dict[str, Any]:
    return geometry(type="heightmap", heights=[[0.0, 0.0]] * rows, lengths=[1, 1])


def texts(*values: str) -> dict[str, Any]:
    labels = ({"type": "text", "text": text} for text in values)
    return {"setgeometry": [{"path": [index], "geometry": label} for index, label in enumerate(labels)]}


def boxes(count: int, name: str = "a") -> dict[str, Any]:
    return {"setgeometry": [{"path": [name], "geometries": [BOX] * count}]}


def nested(depth: int) -> dict[str, Any]:
    return {"setgeometry": [{"path": ["x"] * depth, "geometry": BOX}]}


@pytest.mark.parametrize("odd", [False, True], ids=["typed", "untyped"])
@pytest.mark.parametrize(
    ("limits", "allowed", "refused"),
    [
        (Limits(path_elements=5), nested(5), nested(6)),
        (Limits(element_chars=5), boxes(1, "x" * 5), boxes(1, "x" * 6)),
        (Limits(parts_per_path=3), boxes(3), boxes(4)),
        *((Limits(points=n), each(n), each(n + 1)) for n in (3, LONG) for each in (cloud, line, lidar)),
        *((Limits(vertices=n), mesh(n, 1), mesh(n + 1, 1)) for n in (3, LONG)),
        *((Limits(faces=n), mesh(3, n), mesh(3, n + 1)) for n in (3, LONG)),
        (Limits(channels=3), cloud(2, 3), cloud(2, 4)),
        (Limits(heights=6), heightmap(3), heightmap(4)),
        (Limits(text_chars=3), texts("abc"), texts("abcd")),
        (Limits(text_labels=2), texts("a", "b"), texts("a", "b", "c")),
        (Limits(nodes=4), nested(3), nested(4)),
        (Limits(parts=3), boxes(3), boxes(4)),
        (Limits(geometry_bytes=12_000), cloud(1000), cloud(1001)),
        (Limits(failed_commands=2), {"delete": [5] * 2}, {"delete": [5] * 3}),
    ],
    ids=lambda value: next(iter(_changed(value))) if isinstance(value, Limits) else "",
)
def test_limits_at_their_value(limits: Limits, allowed: dict[str, Any], refused: dict[str, Any], odd: bool) -> None:
    more: dict[str, Any] = {"draw": None} if odd else {}
    ((name, value),) = _changed(limits).items()
    reason = "more than 2 commands" if name == "failed_commands" else f"the limit is {value}"
    assert reason not in json.dumps(Viewer(limits).tell(allowed | more))
    assert reason in Viewer(limits).tell(refused | more)["error"]


def _changed(limits: Limits) -> dict[str, int]:
    default = Limits()
    names = Limits.__dataclass_fields__
    return {name: getattr(limits, name) for name in names if getattr(limits, name) != getattr(default, name)}


def test_labels_of_the_tree_count_until_they_are_deleted() -> None:
    viewer = Viewer(Limits(text_labels=2))
    assert viewer.tell(texts("a", "b"))["status"] == 0
    more = {"setgeometry": [{"path": ["c"], "geometry": {"type": "text", "text": "c"}}]}
    assert "3 different text labels would be in use, the limit is 2" in viewer.tell(more)["error"]
    viewer.tell({"delete": [{"path": [0]}]})
    assert viewer.tell(more)["status"] == 0


@pytest.mark.parametrize("name", ["message_bytes", "json_bytes"])
def test_limits_of_the_text_at_their_value(name: str) -> None:
    text = '{"delete": []}'
    viewer = Viewer(Limits(**{name: len(text)}))
    assert viewer.tell(text)["status"] == 0
    assert f"the limit is {len(text)}" in viewer.tell(text + " ")["error"]


def test_limit_of_binary_values_at_its_value() -> None:
    data = msgspec.msgpack.encode({"x": [1] * 97})  # the map, its key, the list and 97 numbers
    for limit, status in ((100, 0), (99, -3)):
        response = Viewer(Limits(binary_objects=limit)).protocol.handle(wire.encode(data, name=wire.BINARY))
        assert response.status == status


def test_format_name_of_the_maximum_length() -> None:
    name = "x" * (wire.MAX_FORMAT_BYTES - 1)
    assert wire.decode(wire.encode(b"", name=name)).format == name
    with pytest.raises(wire.WireError, match="257 bytes"):
        wire.decode(wire.encode(b"", name=name + "x"))
