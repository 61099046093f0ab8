"""Points of the scene's messages, which NumPy encodes: the bytes are those of the libraries."""

from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scenegate.recording.values import Entity, Primitive

pytest.importorskip("mcap_ros2", reason="needs the extra mcap")
pytest.importorskip("mcap_protobuf", reason="needs the extra mcap")

from foxglove_schemas_protobuf.SceneUpdate_pb2 import SceneUpdate
from mcap_ros2.writer import serialize_dynamic

from scenegate.recording import foxglove_messages, ros2_messages

NUMBERS = st.floats(width=32, allow_nan=False)
COLORS = st.lists(st.tuples(*[st.floats(0, 1, width=32)] * 4), max_size=3)


def rows(values: Any, columns: int) -> Any:
    return np.array(values, np.float32).reshape(-1, columns)


PRIMITIVES = st.builds(
    Primitive,
    points=st.lists(st.tuples(NUMBERS, NUMBERS, NUMBERS), max_size=5).map(lambda values: rows(values, 3)),
    color=st.tuples(*[st.floats(0, 1)] * 4),
    colors=st.none() | COLORS.map(lambda values: rows(values, 4)),
    is_lines=st.booleans(),
)
ENTITIES = st.lists(
    st.builds(
        Entity,
        frame=st.text("ab/", max_size=9),
        primitives=st.lists(PRIMITIVES, max_size=2),
        earlier_primitive_count=st.integers(0, 3),
    ),
    max_size=3,
)


def dicts(array: Any, names: str) -> list[dict[str, float]]:
    return [] if array is None else [dict(zip(names, row, strict=True)) for row in array.tolist()]


@given(ENTITIES)
def test_markers(entities: list[Entity]) -> None:
    message = ros2_messages.entities(entities, 1_500_000_000)
    encode = serialize_dynamic(message.type, ros2_messages.definition(message.type))[message.type]
    markers = [
        {**fields, "points": dicts(fields.get("points"), "xyz"), "colors": dicts(fields.get("colors"), "rgba")}
        for fields in message.fields["markers"]
    ]
    assert ros2_messages.encode("/scene", message).data == encode({"markers": markers})


@given(ENTITIES)
def test_foxglove_s_primitives(entities: list[Entity]) -> None:
    update = SceneUpdate.FromString(
        foxglove_messages.encode("/scene", foxglove_messages.entities(entities, 1_500_000_000)).data
    )
    drawn = [entity for entity in entities if entity.primitives]
    assert len(update.entities) == len(drawn)
    for entity, ours in zip(update.entities, drawn, strict=True):
        for is_lines, messages in ((False, entity.triangles), (True, entity.lines)):
            primitives = [each for each in ours.primitives if each.is_lines is is_lines]
            assert len(messages) == len(primitives)
            for message, primitive in zip(messages, primitives, strict=True):
                points = [{"x": each.x, "y": each.y, "z": each.z} for each in message.points]
                colors = [{"r": each.r, "g": each.g, "b": each.b, "a": each.a} for each in message.colors]
                assert points == dicts(primitive.points, "xyz")
                assert colors == dicts(primitive.colors, "rgba")
                assert (message.color.r, message.color.g, message.color.b, message.color.a) == primitive.color
                assert message.pose.orientation.w == 1.0
                assert not is_lines or (message.type, message.thickness, message.scale_invariant) == (2, 1.0, True)
