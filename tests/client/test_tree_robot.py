"""Robots in a tree viewer: geometry once, then transforms."""

import asyncio
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.transforms import from_pose
from scenegate import AsyncTreeViewer, TreeViewer
from scenegate.messages.changes import Changes
from scenegate.robots import read_robot
from scenegate.tree.answer import Answer
from scenegate.tree.node_handles import PublishedRobot
from tests.adapters.treeviewer.transports import serving
from tests.files.robots.files import ARM, write
from tests.support.liblcm import liblcm
from tests.support.waiting import SECONDS


class Sent:
    """Keeps what is sent."""

    def __init__(self) -> None:
        self.changes: list[Changes] = []

    def send(self, changes: Changes) -> Answer:
        """Keep the changes."""
        self.changes.append(changes)
        return Answer(0)


def published(folder: Path) -> tuple[Sent, PublishedRobot]:
    """Publish the arm at the path ``cell/arm``."""
    sent = Sent()
    return sent, PublishedRobot(sent, ("cell", "arm"), read_robot(write(folder, ARM)), {"elbow": 0.5})


def poses_of(changes: Changes) -> dict[str, np.ndarray]:
    """Return the transforms in changes by link."""
    return {
        str(path[-1]): from_pose(entry.transform["translation"], entry.transform["quaternion"])
        for path, entry in changes.entries.items()
        if entry.transform is not None
    }


def test_links_are_published_with_their_poses(tmp_path: Path) -> None:
    sent, robot = published(tmp_path)
    (changes,) = sent.changes
    assert list(changes.deleted) == [("cell", "arm")]
    assert list(changes.entries) == [("cell", "arm", link) for link in robot.links]
    kinds = [[geometry["type"] for geometry in entry.geometries or ()] for entry in changes.entries.values()]
    assert kinds == [["box"], ["cylinder"], [], [], []]
    expected = read_robot(tmp_path / "robot.urdf").link_poses({"elbow": 0.5})
    for X, (link, Y) in zip(expected, poses_of(changes).items(), strict=True):
        np.testing.assert_allclose(Y, X, atol=1e-15, err_msg=link)


def test_joints_move_only_what_they_carry_and_send_no_geometry(tmp_path: Path) -> None:
    sent, robot = published(tmp_path)
    robot.set_joints({"elbow": 0.7})
    moved = sent.changes[-1]
    assert [path[-1] for path in moved.entries] == ["hand", "finger", "tool"]
    assert all(entry.geometries is None for entry in moved.entries.values())
    assert robot.joint_values == {"shoulder": (0.0,), "elbow": (0.7,), "grip": (pytest.approx(0.45),)}
    robot.set_joints({"shoulder": 0.1})
    assert [path[-1] for path in sent.changes[-1].entries] == ["upper", "hand", "finger", "tool"]
    expected = read_robot(tmp_path / "robot.urdf").link_poses({"elbow": 0.7, "shoulder": 0.1})
    np.testing.assert_allclose(poses_of(sent.changes[-1])["tool"], expected[-1], atol=1e-15)
    robot.set_joints({"shoulder": 0.1})
    assert len(sent.changes) == 3  # nothing moved, nothing is sent


def test_a_wrong_joint_changes_nothing(tmp_path: Path) -> None:
    sent, robot = published(tmp_path)
    with pytest.raises(ValueError, match=r"'elbo'.* elbow"):
        robot.set_joints({"shoulder": 1.0, "elbo": 0.0})
    with pytest.raises(ValueError, match=r"'elbow' .*'up'"):
        robot.set_joints({"shoulder": 1.0, "elbow": "up"})
    with pytest.raises(ValueError, match=r"joint values .*\[0.5\]"):
        robot.set_joints([0.5])  # type: ignore[arg-type]  # refused at run time
    assert len(sent.changes) == 1
    assert robot.joint_values["shoulder"] == (0.0,)


@pytest.mark.parametrize(
    ("change", "error", "reason"),
    [
        (lambda node: node.set_visible("no"), TypeError, "visible must be True or False, not 'no'"),
        (lambda node: node.set_opacity("half"), ValueError, "opacity must be a number, not 'half'"),
        (lambda node: node.set_opacity(50), ValueError, "opacity must be from 0 to 1, not 50"),
    ],
)
def test_wrong_properties_are_not_sent(
    change: Callable[[PublishedRobot], Answer], error: type[Exception], reason: str, tmp_path: Path
) -> None:
    sent, robot = published(tmp_path)
    with pytest.raises(error, match=reason):
        change(robot)
    assert len(sent.changes) == 1


def test_the_robot_is_moved_and_deleted_as_a_whole(tmp_path: Path) -> None:
    sent, robot = published(tmp_path)
    robot.transform((1, 2, 3))
    transform = {"translation": [1, 2, 3], "quaternion": [1, 0, 0, 0]}
    assert sent.changes[-1].entries[("cell", "arm")].transform == transform
    robot.delete()
    assert list(sent.changes[-1].deleted) == [("cell", "arm")]


@pytest.mark.lcm
async def test_in_a_real_viewer(tmp_path: Path) -> None:
    liblcm()
    path, live = write(tmp_path, ARM), LiveTree()
    async with serving(live=live) as service:
        url = f"tcpq://localhost:{service.tcpq_port}"

        def session() -> None:
            with TreeViewer(url, timeout=SECONDS) as viewer:
                robot = viewer.robot("arm", path)
                geometry = live.snapshot.root.find(("arm", "upper"))
                assert geometry is not None
                for angle in np.linspace(0.0, 1.0, 5):
                    assert robot.set_joints({"shoulder": angle}).status == 0
                moved = live.snapshot.root.find(("arm", "upper"))
                assert moved is not None
                assert moved.parts is geometry.parts

        await asyncio.to_thread(session)
        expected = read_robot(path).link_poses({"shoulder": 1.0})
        for link, X in zip(read_robot(path).links, expected, strict=True):
            found = live.snapshot.root.world_matrix(("arm", link))
            assert found is not None
            np.testing.assert_allclose(found, X, atol=1e-12)
        async with AsyncTreeViewer(url, timeout=SECONDS) as viewer:
            robot = await viewer.robot("arm", path, joints={"elbow": 1.0})
            await robot.set_joints({"elbow": 0.5})
            await robot.transform((0, 0, 1))
            assert robot.published.joint_values["elbow"] == (0.5,)
            await robot.delete()
        assert live.snapshot.root.find(("arm",)) is None
