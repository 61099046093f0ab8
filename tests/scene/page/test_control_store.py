"""The controls of clients: values, samples, sharing, limits and leases."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest

from gateway.scene.page.control_store import ControlLimits, ControlStore
from gateway.scene.tree.nodes import Path
from scenegate.messages.controls import AnyControl, Button, Checkbox, Dropdown, Gizmo, Plot, Pose, Slider, Value

SPEED = Slider(("speed",), 0.0, 10.0, value=1.0)
GO = Button(("go",))
PLOT = Plot(("loads",), ("a",))
GIZMO = Gizmo(("target",), ("box",))


class World:
    """A store with a clock that the test sets, and the values that clients got."""

    def __init__(self, limits: ControlLimits | None = None) -> None:
        self.now = 0.0
        self.store = ControlStore(limits, lambda: self.now)
        self.changes = 0
        self.store.listen(self._count)
        self.received: list[tuple[str, dict[Path, Value], int]] = []
        self.requests = 0

    def _count(self) -> None:
        self.changes += 1

    def set(self, client: str, *controls: AnyControl) -> str:
        def deliver(values: Sequence[tuple[Path, Value]], after: int) -> None:
            self.received.append((client, dict(values), after))

        self.requests += 1
        return self.store.set_controls(client, controls, deliver, self.requests)

    def delivered(self) -> list[tuple[str, dict[Path, Value], int]]:
        self.store.deliver_values()
        received, self.received = self.received, []
        return received

    def shown(self) -> dict[Path, Any]:
        """Return the values that a new page gets, by path."""
        return {each["path"]: each["value"] for each in self.store.controls_since(0) or ()}

    def id_of(self, *path: str) -> int:
        (found,) = [each["id"] for each in self.store.controls_since(0) or () if each["path"] == path]
        return int(found)


def test_a_page_gets_what_has_changed() -> None:
    world = World()
    store = world.store
    assert (store.revision, store.controls_since(0)) == (0, None)
    world.set("one", SPEED, GO)
    assert store.controls_since(0) == [
        {"id": 1, "value": 1.0, "type": "slider", "path": ("speed",), "min": 0.0, "max": 10.0},
        {"id": 2, "value": 0, "type": "button", "path": ("go",)},
    ]
    seen = store.revision
    store.set_value("one", ("speed",), 3, 5)
    assert store.controls_since(seen) is None
    assert store.values_since(seen) == [(1, 3.0)]
    assert store.values_since(store.revision) == []
    assert world.changes == 2


def test_changes_of_a_page_reach_the_client_together() -> None:
    world = World()
    world.set("one", SPEED, GO)
    for value in (2.0, 3.0, 4.0):
        entry = world.store.change(1, value)
        assert entry.value == value
    world.store.change(2, None)
    world.store.change(2, None)
    assert world.delivered() == [("one", {("speed",): 4.0, ("go",): 2}, 1)]
    assert world.delivered() == []
    assert world.store.change(99, 1.0) is None


def test_an_invalid_change_is_taken_back() -> None:
    world = World()
    world.set("one", SPEED)
    seen = world.store.revision
    world.store.change(1, "fast")
    assert world.store.values_since(seen) == [(1, 1.0)]


def test_a_value_that_a_client_sets_is_not_sent_back() -> None:
    world = World()
    world.set("one", SPEED)
    world.store.change(1, 2.0)
    world.store.set_value("one", ("speed",), 3.0, 8)
    assert world.delivered() == [("one", {("speed",): 3.0}, 8)]  # the change of the page was before
    world.store.set_value("one", ("speed",), 4.0, 9)
    assert world.delivered() == []


def test_values_stay_when_the_controls_are_sent_again() -> None:
    world = World()
    world.set("one", SPEED, GO, PLOT)
    world.store.change(1, 5.0)
    world.store.add_samples("one", ("loads",), np.array([[0.0, 1.0]]), 2)
    world.delivered()
    revision = world.store.revision
    world.set("one", SPEED, GO, PLOT)
    assert world.store.revision == revision
    assert world.shown() == {("speed",): 5.0, ("go",): 0, ("loads",): None}
    # again, because a message over UDP may be lost
    assert world.delivered() == [("one", {("speed",): 5.0, ("go",): 0}, 2)]


def test_definitions_change() -> None:
    world = World()
    world.set("one", SPEED)
    world.store.change(1, 9.0)
    seen = world.store.revision
    world.set("one", Slider(("speed",), 0.0, 20.0))
    assert [(each["id"], each["max"], each["value"]) for each in world.store.controls_since(seen) or ()] == [
        (1, 20.0, 9.0)
    ]
    world.set("one", Slider(("speed",), 0.0, 2.0, value=1.5))
    assert world.shown() == {("speed",): 1.5}  # 9 is beyond the new limit
    world.set("one", Checkbox(("speed",)))
    assert world.shown() == {("speed",): False}
    assert world.id_of("speed") != 1
    assert world.store.change(1, 3.0) is None


def test_controls_that_are_left_out_are_removed() -> None:
    world = World()
    world.set("one", SPEED, GO)
    world.set("one", GO)
    assert world.shown() == {("go",): 0}
    world.set("one")
    assert world.shown() == {}
    with pytest.raises(ValueError, match=r"no such control.* setcontrols"):
        world.store.set_value("one", ("go",), 1, 1)


def test_clients_share_a_control() -> None:
    world = World()
    world.set("one", SPEED)
    world.store.change(1, 5.0)
    world.delivered()
    world.set("two", SPEED)  # a program that starts: its value counts
    assert world.shown() == {("speed",): 1.0}
    assert world.delivered() == [("one", {("speed",): 1.0}, 1)]
    world.store.set_value("two", ("speed",), 7.0, 3)
    assert world.delivered() == [("one", {("speed",): 7.0}, 1)]
    world.set("one")
    assert world.shown() == {("speed",): 7.0}
    world.set("two")
    assert world.shown() == {}


def test_clients_with_different_limits_do_not_flip_a_control() -> None:
    world = World()
    wide = Slider(("speed",), 0.0, 100.0, value=1.0)

    def limit() -> Any:
        (control,) = list(world.store.controls_since(0) or ())
        return control.get("max", control["type"])

    world.set("one", SPEED)
    world.set("two", wide)
    seen, control_id = world.store.revision, world.id_of("speed")
    for _ in range(3):
        world.set("one", SPEED)
        world.set("two", wide)
    assert (limit(), world.store.controls_since(seen)) == (100.0, None)
    world.set("one", Slider(("speed",), 0.0, 20.0))
    world.set("two", wide)
    assert limit() == 20.0
    world.store.change(control_id, 15.0)
    world.set("one")
    assert (limit(), world.shown(), world.id_of("speed")) == (100.0, {("speed",): 15.0}, control_id)
    world.set("one", Checkbox(("speed",)))
    world.set("two", wide)
    assert limit() == "checkbox"
    world.set("one")
    assert limit() == 100.0


def test_controls_of_clients_that_vanish_are_removed() -> None:
    world = World(ControlLimits(lease_seconds=10.0))
    world.set("silent", SPEED, GO)
    world.set("alive", GO)
    world.now = 9.0
    world.set("alive", GO)
    world.now = 11.0
    world.store.remove_vanished()
    assert world.shown() == {("go",): 0}
    world.store.change(world.id_of("go"), None)
    assert [client for client, _, _ in world.delivered()] == ["alive"]


def test_samples() -> None:
    world = World()
    world.set("one", PLOT)
    store = world.store
    store.add_samples("one", ("loads",), np.array([[0.0, 1.0], [1.0, np.nan]]), 2)
    seen = store.revision
    store.add_samples("one", ("loads",), np.array([[2.0, 3.0]]), 3)
    for since, rows in ((0, [[0, 1], [1, np.nan], [2, 3]]), (seen, [[2, 3]])):
        ((control_id, samples),) = store.samples_since(since)
        assert control_id == 1
        np.testing.assert_array_equal(samples, rows)
    assert store.samples_since(store.revision) == []
    store.add_samples("one", ("loads",), np.array([[1.0, 4.0], [0.5, 5.0], [0.6, 6.0]]), 4)
    ((_, samples),) = store.samples_since(0)
    np.testing.assert_array_equal(samples, [[0.5, 5], [0.6, 6]])  # the time went backwards
    times = np.arange(2000.0)
    store.add_samples("one", ("loads",), np.column_stack([times + 1, times]), 5)
    ((_, samples),) = store.samples_since(0)
    assert (len(samples), samples[0, 0]) == (2000, 1.0)
    world.set("one", Plot(("loads",), ("a", "b")))
    assert store.samples_since(0) == []


def test_values_of_plots_and_gizmos() -> None:
    world = World()
    world.set("one", PLOT, GIZMO, SPEED)
    pose = Pose((1.0, 2.0, 3.0), (1.0, 0.0, 0.0, 0.0))
    assert world.store.change(1, 1.0) is None
    world.store.change(2, {"translation": [1, 2, 3], "quaternion": [1, 0, 0, 0]})
    assert world.delivered() == [("one", {("target",): pose}, 1)]
    with pytest.raises(ValueError, match="1 cannot be set: the control has no value"):
        world.store.set_value("one", ("loads",), 1, 2)
    with pytest.raises(ValueError, match=r"gizmo .*settransform"):
        world.store.set_value("one", ("target",), pose, 2)
    with pytest.raises(ValueError, match=r"plot, not .*slider"):
        world.store.add_samples("one", ("speed",), np.zeros((1, 2)), 2)


def test_limits() -> None:
    world = World(ControlLimits(clients=2, controls=3, plots=1, option_chars=20))
    assert world.set("one", GO, GO) == "two controls have the same path"
    many = [Button((str(i),)) for i in range(4)]
    assert world.set("one", *many) == "there would be 4 controls in the page, the limit is 3"
    assert world.set("one", GO, SPEED) == ""
    assert world.set("two", PLOT, GIZMO) == "there would be 4 controls in the page, the limit is 3"
    assert world.set("two", GO, PLOT) == ""
    assert world.set("one", Plot(("more",), ("a",))) == "there would be 2 plots in the page, the limit is 1"
    assert world.set("three", GO) == "2 clients have controls, which is the limit"
    assert world.set("one", Dropdown(("menu",), ("a" * 9, "b" * 8))) == (
        "the controls have 21 characters, the limit for one client is 20"
    )
    assert world.shown().keys() == {("go",), ("speed",), ("loads",)}
