"""The commands that Director does not have, in both formats."""

from typing import Any

import msgspec
import pytest

from gateway.adapters.treeviewer.apply import PageClient
from gateway.adapters.treeviewer.config import Limits
from gateway.adapters.treeviewer.responses import ClickMessage, PageMessage
from gateway.scene.draw.cameras import LookAtCamera
from gateway.scene.page.live_page import ClickLimits, ClickSubscriptions, PageView
from gateway.scene.tree.nodes import Path
from scenegate.messages import wire
from scenegate.messages.clicks import Click
from scenegate.messages.controls import Value
from tests.adapters.treeviewer.conversation import BOX, Viewer, message


class Talk:
    """A client of a viewer, with clicks that it got."""

    def __init__(self, *, binary: bool, limits: Limits | None = None) -> None:
        self.viewer = Viewer(limits)
        self._binary = binary
        self.clicks: list[Click] = []
        self.values: list[tuple[dict[Path, Value], int]] = []
        """Values of controls and ``after`` of each message."""
        self.receiver: PageClient | None = PageClient("DIRECTOR_TREE_VIEWER_REQUEST_<me>", self._receive)

    def _receive(self, message: PageMessage) -> None:
        if isinstance(message, ClickMessage):
            self.clicks.append(message.click)
        else:
            self.values.append(({each.path: each.value for each in message.controls}, message.after))

    def tell(self, **request: Any) -> dict[str, Any]:
        if self._binary:
            data = wire.encode(msgspec.msgpack.encode(request), 7, wire.BINARY)
        else:
            data = message(request)
        response = self.viewer.protocol.handle(data, self.receiver)
        answer: dict[str, Any] = msgspec.to_builtins(response)
        return answer

    def fails(self, **request: Any) -> str:
        answer = self.tell(**request)
        assert answer["status"] == -3
        (error,) = answer["errors"]
        assert error["command"] == next(iter(request))
        reason: str = error["reason"]
        return reason


@pytest.fixture(params=["json", "msgpack"])
def talk(request: Any) -> Talk:
    talk = Talk(binary=request.param == "msgpack")
    talk.tell(setgeometry=[{"path": ["robot", "arm"], "geometry": BOX}])
    return talk


def test_visibility_and_opacity(talk: Talk) -> None:
    answer = talk.tell(setproperty=[{"path": ["robot"], "visible": False}, {"path": ["robot", "arm"], "opacity": 0.5}])
    assert (answer["status"], answer["newer_commands"]) == (0, ["setproperty"])
    robot, arm = talk.viewer.node("robot"), talk.viewer.node("robot", "arm")
    assert (robot.visible, robot.opacity, arm.visible, arm.opacity) == (False, 1.0, True, 0.5)
    talk.tell(setproperty={"path": ["robot"], "visible": True, "opacity": 0})
    robot = talk.viewer.node("robot")
    assert (robot.visible, robot.opacity) == (True, 0.0)


def test_properties_are_set_after_deletes_and_geometry(talk: Talk) -> None:
    talk.tell(
        setproperty=[{"path": ["robot"], "visible": False}],
        setgeometry=[{"path": ["robot"], "geometry": BOX}],
        delete=[{"path": ["robot"]}],
    )
    assert talk.viewer.paths() == {("robot",)}
    assert not talk.viewer.node("robot").visible


def test_a_property_of_a_missing_path_is_reported(talk: Talk) -> None:
    answer = talk.tell(setproperty=[{"path": ["other"], "opacity": 0.5}])
    assert (answer["status"], answer["missing_paths"]) == (1, [("other",)])
    assert talk.viewer.node("other").opacity == 0.5


@pytest.mark.parametrize(
    ("command", "reason"),
    [
        ({"path": ["a"]}, "visible and opacity are missing"),
        ({"path": ["a"], "visible": 1}, "visible must be true or false, not 1"),
        ({"path": ["a"], "opacity": "x"}, 'opacity must be a number, not "x"'),
        ({"path": ["a"], "opacity": 1.5}, "opacity must be from 0 to 1, not 1.5"),
        ({"path": ["a"], "opacity": float("nan")}, "opacity must be from 0 to 1, not NaN"),
        ({"visible": True}, "path is missing"),
    ],
)
def test_invalid_properties(talk: Talk, command: dict[str, Any], reason: str) -> None:
    assert talk.fails(setproperty=[command]) == reason
    assert talk.viewer.paths() == {("robot", "arm")}


def test_properties_count_against_the_limit_of_nodes() -> None:
    talk = Talk(binary=False, limits=Limits(nodes=3))
    reason = talk.fails(setproperty=[{"path": ["a", "b", "c"], "visible": False}])
    assert reason == "the tree has 1 nodes, the limit is 3"


def test_view_settings_are_changed_one_by_one(talk: Talk) -> None:
    page = talk.viewer.protocol.page
    changes: list[PageView] = []
    page.listen(lambda: changes.append(page.view))
    answer = talk.tell(setview={"background": [1, 0.5, 0], "grid": False})
    assert (answer["status"], answer["newer_commands"]) == (0, ["setview"])
    assert page.view == PageView((1.0, 0.5, 0.0), grid=False)
    talk.tell(setview={"background": None, "home": {"eye": [1, 2, 3], "target": [0, 0, 0]}})
    home = LookAtCamera((1, 2, 3), (0, 0, 0), (0, 0, 1))
    assert page.view == PageView(None, grid=False, home=home)
    talk.tell(setview={"grid": None, "home": {"eye": [0, 0, 3], "target": [0, 0, 0], "up": [0, 1, 0]}})
    assert page.view == PageView(None, None, LookAtCamera((0, 0, 3), (0, 0, 0), (0, 1, 0)))
    assert len(changes) == 3


@pytest.mark.parametrize(
    ("view", "reason"),
    [
        ([], "setview must be an object, not []"),
        ({"background": [1, 2, 3]}, "background must have numbers from 0 to 1, not [1, 2, 3]"),
        ({"background": "red"}, 'background must be a list of 3 numbers, not "red"'),
        ({"grid": 1}, "grid must be true, false or null, not 1"),
        ({"home": []}, "home must be an object with eye, target and up, not []"),
        ({"home": {"eye": [0, 0, 0]}}, "home.target must be a list of 3 numbers, not null"),
        ({"home": {"eye": [0, 0, 0], "target": [0, 0, 0]}}, "home.eye and home.target are the same point"),
        ({"home": {"eye": [0, 0, 9], "target": [0, 0, 0]}}, "home.up must not be zero nor along the line of sight"),
        (
            {"home": {"eye": [0, 0, 1e300], "target": [0, 0, 0]}},
            "home.eye must have numbers up to 1e+15, not [0, 0, 1e+300]",
        ),
    ],
)
def test_invalid_view(talk: Talk, view: Any, reason: str) -> None:
    assert talk.fails(setview=view) == reason
    assert talk.viewer.protocol.page.view == PageView()


def test_clicks_reach_the_client_that_wants_them(talk: Talk) -> None:
    clicks = talk.viewer.protocol.page.clicks
    answer = talk.tell(setclicks=[{"path": ["robot"]}])
    assert (answer["status"], answer["newer_commands"]) == (0, ["setclicks"])
    click = Click(("robot", "arm"), (1.0, 2.0, 3.0), "right")
    clicks.click(click)
    clicks.click(Click(("other",), (1.0, 2.0, 3.0), "left"))
    assert talk.clicks == [click]
    talk.tell(setclicks=[])
    clicks.click(click)
    assert talk.clicks == [click]


def test_invalid_clicks_change_nothing(talk: Talk) -> None:
    page = talk.viewer.protocol.page
    page.clicks = ClickSubscriptions(ClickLimits(paths=1))
    talk.tell(setclicks=[{"path": ["robot"]}])
    assert talk.fails(setclicks=[{"path": None}]) == "path must be a list of strings, not null"
    assert talk.fails(setclicks=[{"path": [1]}, {"path": [2]}]) == (
        "2 paths are clickable, the limit for one client is 1"
    )
    assert page.clicks.paths() == (("robot",),)
    for receiver in (None, PageClient(None, print)):
        talk.receiver = receiver
        assert talk.fails(setclicks=[{"path": []}]) == "clicks and values are sent only on a channel with a client id"


def test_requests_without_them_are_answered_as_before(talk: Talk) -> None:
    answer = talk.tell(setgeometry=[{"path": ["a"], "geometry": BOX}])
    assert "newer_commands" not in answer
    answer = talk.tell(setproperty=None, setview=None, setclicks=None)
    assert "newer_commands" not in answer
