"""Warnings about paths, which the page shows until the path is set without one or is deleted; ``--strict``."""

from typing import Any

import pytest

from gateway.adapters.treeviewer.apply import PageClient
from tests.adapters.treeviewer.conversation import BOX, Viewer, message

NEGATIVE = {"type": "sphere", "radius": -1}
NOT_FINITE = {"settransform": [{"path": ["a", "b"], "transform": {"translation": [float("nan"), 0, 0]}}]}


@pytest.mark.parametrize("geometry", [NEGATIVE, {"type": "cone"}], ids=["warning", "failure"])
@pytest.mark.parametrize(
    "end",
    [
        {"setgeometry": [{"path": ["a", "b"], "geometry": BOX}]},
        {"delete": [{"path": ["a", "b"]}]},
        {"delete": [{"path": ["a"]}]},
        {"delete": [{"path": []}]},
    ],
    ids=["set", "deleted", "deleted above", "everything deleted"],
)
def test_a_warning_holds_until_its_path_is_set_or_deleted(viewer: Viewer, geometry: Any, end: Any) -> None:
    viewer.publish(geometry, path=("a", "b"))
    viewer.publish(BOX, path=("other",))
    viewer.tell({"settransform": [{"path": ["a", "b"], "transform": {"translation": [1, 0, 0]}}]})
    viewer.tell({"delete": [{"path": ["a", "b", "c"]}, {"path": ["other"]}]})
    (warning,) = viewer.protocol.warnings.listed()
    assert warning.startswith('setgeometry[0] ["a", "b"]: ')
    viewer.tell(end)
    assert viewer.protocol.warnings.listed() == []


def test_a_transform_that_is_not_finite(viewer: Viewer) -> None:
    viewer.publish(BOX, path=("a", "b"))
    viewer.tell(NOT_FINITE)
    (warning,) = viewer.protocol.warnings.listed()
    assert "transform is not finite" in warning
    viewer.tell({"settransform": [{"path": ["a", "b"], "transform": {"translation": [1, 0, 0]}}]})
    assert viewer.protocol.warnings.listed() == []


def test_strict_refuses_what_would_have_a_warning() -> None:
    viewer = Viewer(strict=True)
    answer = viewer.publish(NEGATIVE)
    assert answer["status"] == -3
    assert answer["errors"][0]["reason"] == "radius is -1, it counts as 0 (refused: --strict)"
    assert viewer.paths() == set()
    assert viewer.publish(BOX, path=("a", "b"))["status"] == 0
    assert viewer.tell(NOT_FINITE)["errors"][0]["reason"].endswith("(refused: --strict)")


def test_every_warning_about_a_path_is_listed(viewer: Viewer) -> None:
    viewer.publish(NEGATIVE, {"type": "box", "lengths": [-1, 1, 1]})
    assert ["radius" in text or "lengths" in text for text in viewer.protocol.warnings.listed()] == [True, True]


@pytest.mark.parametrize(
    ("wrong", "right"),
    [
        ({"setproperty": [{"path": ["it"], "opacity": 3}]}, {"setproperty": [{"path": ["it"], "opacity": 1}]}),
        ({"setview": {"background": [3, 0, 0]}}, {"setview": {"background": [1, 0, 0]}}),
        ({"setclicks": 5}, {"setclicks": []}),
        ({"delete": 5}, {"delete": [{"path": ["other"]}]}),
        ({"setgeometry": [{"path": 3, "geometry": BOX}]}, {"setgeometry": [{"path": ["a"], "geometry": BOX}]}),
    ],
    ids=["property", "view", "clicks", "delete", "path"],
)
def test_the_next_valid_command_ends_a_warning(viewer: Viewer, wrong: Any, right: Any) -> None:
    viewer.publish(BOX)
    viewer.tell(wrong)
    assert len(viewer.protocol.warnings.listed()) == 1
    viewer.tell({"settransform": [{"path": ["it"], "transform": {}}]})
    assert len(viewer.protocol.warnings.listed()) == 1
    viewer.protocol.handle(message(right), PageClient("client", print))
    assert viewer.protocol.warnings.listed() == []
