"""Subscriptions to clicks: paths, limits and leases."""

from gateway.scene.page.live_page import ClickLimits, ClickSubscriptions
from gateway.scene.tree.nodes import Path
from scenegate.messages.clicks import Click


class World:
    """Subscriptions with a clock that the test sets, and the clicks that clients got."""

    def __init__(self, limits: ClickLimits | None = None) -> None:
        self.now = 0.0
        self.clicks = ClickSubscriptions(limits, lambda: self.now)
        self.received: list[tuple[str, Path]] = []

    def subscribe(self, client: str, *paths: Path) -> str:
        return self.clicks.subscribe(client, paths, lambda click: self.received.append((client, click.path)))

    def click(self, *path: str | int) -> list[tuple[str, Path]]:
        self.received.clear()
        self.clicks.click(Click(path, (0.0, 0.0, 0.0), "left"))
        return list(self.received)


def test_clicks_at_and_below_a_path_are_delivered_once() -> None:
    world = World()
    assert world.subscribe("one", ("a",), ("a", "b")) == ""
    assert world.subscribe("two", ("a", "b"), (1,)) == ""
    assert world.clicks.paths() == (("a",), ("a", "b"), (1,))
    assert world.click("a", "b", "c") == [("one", ("a", "b", "c")), ("two", ("a", "b", "c"))]
    assert world.click("a") == [("one", ("a",))]
    assert world.click("ab") == world.click("1") == world.click() == []


def test_the_root_is_everything() -> None:
    world = World()
    world.subscribe("one", ())
    assert world.click("any", 1) == [("one", ("any", 1))]
    assert world.click() == [("one", ())]


def test_a_subscription_replaces_the_earlier_one() -> None:
    world = World()
    world.subscribe("one", ("a",))
    world.subscribe("one", ("b",))
    assert world.click("a") == []
    assert world.click("b") == [("one", ("b",))]
    world.subscribe("one")
    assert world.click("b") == []
    assert world.clicks.paths() == ()


def test_limits() -> None:
    world = World(ClickLimits(clients=1, paths=2, path_chars=10))
    assert world.subscribe("one", *((i,) for i in range(3))) == ("3 paths are clickable, the limit for one client is 2")
    assert world.subscribe("one", ("abcdef",), ("x", 1234)) == (
        "the clickable paths have 11 characters, the limit for one client is 10"
    )
    assert world.subscribe("one", ("a",)) == ""
    assert world.subscribe("two", ("a",)) == "1 clients wait for clicks, which is the limit"
    assert world.subscribe("one", ("b",)) == ""
    assert world.click("b") == [("one", ("b",))]


def test_clients_that_vanish_are_forgotten() -> None:
    world = World(ClickLimits(clients=2, lease_seconds=10.0))
    world.subscribe("silent", ("a",))
    world.subscribe("alive", ("b",))
    world.now = 9.0
    world.subscribe("alive", ("b",))
    world.now = 11.0
    assert world.clicks.paths() == (("b",),)
    assert world.click("a") == []
    assert world.subscribe("new", ("a",)) == ""
