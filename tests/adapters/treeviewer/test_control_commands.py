"""``setcontrols`` and ``setvalues``, in both formats."""

from typing import Any

import numpy as np
import pytest

from gateway.adapters.treeviewer.config import Limits
from scenegate.messages.request_encoding import pack
from tests.adapters.treeviewer.conversation import Viewer
from tests.adapters.treeviewer.test_commands import Talk

SLIDER = {"path": ["arm", "speed"], "type": "slider", "min": 0, "max": 2, "unit": "m/s"}
PLOT = {"path": "loads", "type": "plot", "series": ["a", "b"]}


@pytest.fixture(params=["json", "msgpack"])
def talk(request: Any) -> Talk:
    return Talk(binary=request.param == "msgpack")


def shown(talk: Talk) -> list[dict[str, Any]]:
    return talk.viewer.protocol.page.controls.controls_since(0) or []


def test_controls_are_added_and_changed(talk: Talk) -> None:
    answer = talk.tell(setcontrols=[SLIDER, {"path": "go", "type": "button"}])
    assert (answer["status"], answer["newer_commands"]) == (0, ["setcontrols"])
    assert shown(talk) == [
        {"id": 1, "value": 0.0, "type": "slider", "path": ("arm", "speed"), "min": 0.0, "max": 2.0, "unit": "m/s"},
        {"id": 2, "value": 0, "type": "button", "path": ("go",)},
    ]
    answer = talk.tell(setvalues=[{"path": "arm/speed", "value": 1}])
    assert (answer["status"], answer["newer_commands"]) == (0, ["setvalues"])
    store = talk.viewer.protocol.page.controls
    store.change(2, None)
    store.deliver_values()
    assert talk.values == [({("go",): 1}, 7)]
    talk.tell(setcontrols=[])
    assert shown(talk) == []


def test_controls_and_values_may_be_in_one_request(talk: Talk) -> None:
    talk.tell(setvalues={"path": "arm/speed", "value": 1.5}, setcontrols=SLIDER)
    assert [each["value"] for each in shown(talk)] == [1.5]


def test_a_gizmo_names_its_node(talk: Talk) -> None:
    talk.tell(setcontrols=[{"path": "target", "type": "gizmo", "node": "robot/hand"}])
    assert shown(talk)[0]["node"] == ("robot", "hand")


@pytest.mark.parametrize("rows", [3, 2000])  # many rows of JSON are parsed apart
def test_samples(talk: Talk, rows: int) -> None:
    talk.tell(setcontrols=[PLOT])
    times = 1.7e9 + 0.01 * np.arange(rows)
    samples = np.column_stack([times, np.sin(times), np.cos(times)])
    assert talk.tell(setvalues=[{"path": "loads", "samples": samples.tolist()}])["status"] == 0
    ((_, stored),) = talk.viewer.protocol.page.controls.samples_since(0)
    np.testing.assert_allclose(stored, samples, rtol=1e-15)


def test_samples_as_bytes() -> None:
    talk = Talk(binary=True)
    talk.tell(setcontrols=[PLOT])
    samples = np.array([[1.7e9, 1.0, np.nan]])
    talk.tell(setvalues=[{"path": "loads", "samples": pack(samples)}])
    ((_, stored),) = talk.viewer.protocol.page.controls.samples_since(0)
    np.testing.assert_array_equal(stored, samples)


@pytest.mark.parametrize(
    ("change", "reason"),
    [
        ({"type": "dial"}, "type is \"dial\": Invalid value 'dial'"),
        ({"min": "low"}, 'min is "low": Expected `float`, got `str`'),
        ({"min": 3}, "min is 3, it must be below max, which is 2"),
        ({"value": 7}, "value is 7, it must be from 0 to 2"),
        ({"path": None}, "path must be a list of strings, not null"),
        ({"path": []}, "path has 0 names, it must have 1 to 8"),
        ({"type": "gizmo", "node": 3}, "path must be a list of strings, not 3"),
        ({"type": "dropdown"}, "Object missing required field `options`"),
    ],
)
def test_invalid_controls_change_nothing(talk: Talk, change: dict[str, Any], reason: str) -> None:
    talk.tell(setcontrols=[SLIDER])
    assert talk.fails(setcontrols=[{"path": "go", "type": "button"}, SLIDER | change]) == reason
    assert [each["path"] for each in shown(talk)] == [("arm", "speed")]


@pytest.mark.parametrize("change", [{"min": "\ud800"}, {"type": "\ud800"}])
def test_controls_with_a_text_that_is_not_unicode_are_refused(change: dict[str, Any]) -> None:
    response = Viewer().tell({"setcontrols": [SLIDER | change]})
    assert response["error"].endswith("a control has a text that is not Unicode")


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        ({"value": 3}, "value is 3, it must be from 0 to 2"),
        ({"value": "a"}, 'value must be a number of at most 1e+15, not "a"'),
        ({}, "a command has either a value or samples"),
        ({"value": 1, "samples": []}, "a command has either a value or samples"),
        ({"samples": [[1, 2, 3]]}, "samples can be added to a plot, not to a slider"),
        ({"samples": [[1], [1]]}, "samples has rows of 1, not rows of 2 or 3 or 4"),
        ({"samples": "x"}, "samples must be a list of rows of 2 or 3"),
        ({"path": "other", "value": 1}, "this client has no such control; setcontrols adds it"),
        ({"path": "loads", "samples": [[1, 2]]}, "samples must be rows of a time and 2 numbers, not of shape (1, 2)"),
    ],
)
def test_invalid_values(talk: Talk, command: dict[str, Any], reason: str) -> None:
    talk.tell(setcontrols=[SLIDER, PLOT])
    assert talk.fails(setvalues=[{"path": "arm/speed", **command}]).startswith(reason)
    assert shown(talk)[0]["value"] == 0.0


def test_other_values_of_a_request_are_set(talk: Talk) -> None:
    talk.tell(setcontrols=[SLIDER])
    answer = talk.tell(setvalues=[{"path": "a", "value": 1}, {"path": "arm/speed", "value": 1}])
    assert (answer["status"], answer["errors"][0]["index"], answer["errors"][0]["path"]) == (-3, 0, ("a",))
    assert shown(talk)[0]["value"] == 1.0


def test_many_commands_are_refused_at_once() -> None:
    talk = Talk(binary=False, limits=Limits(controls=1))
    assert talk.fails(setcontrols=[SLIDER, SLIDER]) == "setcontrols has 2 elements, the limit is 1"
    assert talk.fails(setvalues=[{}, {}]) == "setvalues has 2 elements, the limit is 1"


def test_clients_without_an_id_are_refused(talk: Talk) -> None:
    talk.receiver = None
    for request in ({"setcontrols": [SLIDER]}, {"setvalues": [{"path": "a", "value": 1}]}):
        assert talk.fails(**request) == "clicks and values are sent only on a channel with a client id"
    assert shown(talk) == []
