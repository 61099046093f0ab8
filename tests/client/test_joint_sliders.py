"""Sliders of a robot's joints with the service over TCPQ."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.adapters.treeviewer.service import TreeViewerService
from gateway.scene.tree.live import LiveTree
from scenegate import AsyncTreeViewer, TreeViewer
from tests.adapters.treeviewer.transports import serving
from tests.client.conftest import connected, hub_of, in_thread, talk_to
from tests.client.test_tree_controls import change, shown
from tests.files.robots.files import ARM, write
from tests.support.waiting import SECONDS, until

pytestmark = [pytest.mark.lcm, pytest.mark.usefixtures("lcm")]


def limits(service: TreeViewerService) -> dict[str, Any]:
    """Return limits and unit of each slider, by the name of its joint."""
    controls = service.protocol.page.controls.controls_since(0) or ()
    return {each["path"][-1]: (each["min"], each["max"], each["unit"]) for each in controls if "min" in each}


async def test_a_value_beyond_all_sliders_is_refused(tmp_path: Path) -> None:
    file = write(tmp_path, ARM)

    def talk(viewer: TreeViewer) -> None:
        robot = viewer.robot("arm", file, joints={"shoulder": 1e300})
        with pytest.raises(ValueError, match=r"'shoulder'.* 1e\+300"):
            viewer.controls.add_joint_sliders(robot)

    async with serving() as service:
        await talk_to(service, talk)
        assert shown(service) == {}


async def test_sliders_move_the_robot(tmp_path: Path) -> None:
    live, file = LiveTree(), write(tmp_path, ARM)
    async with serving(live=live) as service, connected(service) as viewer:
        robot = await in_thread(lambda: viewer.robot("cell/arm", file, joints={"shoulder": 0.5}))
        sliders = await in_thread(viewer.controls.add_joint_sliders, robot)
        assert shown(service) == {"cell/arm/shoulder": 0.5, "cell/arm/elbow": 0.0, "cell/arm/Reset": 0}
        assert limits(service) == {"shoulder": (-1.0, 2.0, "rad"), "elbow": (-math.pi, math.pi, "rad")}

        def pose(link: str) -> Any:
            return live.snapshot.root.children["cell"].children["arm"].children[link].matrix

        finger = pose("finger")
        change(service, "cell/arm/elbow", 0.4)
        await until(lambda: robot.joint_values["elbow"] == (0.4,))
        assert robot.joint_values["grip"] == pytest.approx((0.3,))  # it follows the elbow
        assert not np.allclose(pose("finger"), finger)
        change(service, "cell/arm/Reset", None)
        await until(lambda: shown(service)["cell/arm/elbow"] == 0.0)
        np.testing.assert_allclose(pose("finger"), finger, atol=1e-6)
        await in_thread(sliders.set, {"shoulder": 9.0, "elbow": 1.0})
        assert robot.joint_values["shoulder"] == (9.0,)
        assert sliders.values == {"shoulder": 2.0, "elbow": 1.0}
        with pytest.raises(ValueError, match="the robot has no joint 'elbo'"):
            await in_thread(sliders.set, {"elbo": 1.0})
        await in_thread(sliders.delete)
        assert shown(service) == {}


@pytest.mark.parametrize(
    ("joint", "expected"),
    [
        ('<joint name="j" type="revolute">', (-math.pi, math.pi, "rad")),
        ('<joint name="j" type="prismatic">', (-1.0, 1.0, "m")),
        ('<joint name="j" type="prismatic"><limit lower="0" upper="0"/>', (-1.0, 1.0, "m")),
        ('<joint name="j" type="prismatic"><limit lower="-1e30" upper="1e30"/>', (-1.0, 1.0, "m")),
        ('<joint name="j" type="revolute"><limit lower="1" upper="2"/>', (0.0, 2.0, "rad")),
        ('<joint name="j" type="floating">', None),
    ],
)
async def test_limits(joint: str, expected: tuple[float, float, str] | None, tmp_path: Path) -> None:
    file = write(
        tmp_path, f'<robot><link name="a"/><link name="b"/>{joint}<parent link="a"/><child link="b"/></joint></robot>'
    )
    async with serving() as service, connected(service) as viewer:
        robot = await in_thread(lambda: viewer.robot("it", file))
        sliders = await in_thread(viewer.controls.add_joint_sliders, robot, "Joints")
        assert limits(service).get("j") == expected
        assert shown(service).keys() == (set() if expected is None else {"Joints/j", "Joints/Reset"})
        assert bool(sliders.sliders) == (expected is not None)


async def test_async_client(tmp_path: Path) -> None:
    file = write(tmp_path, ARM)
    async with serving() as service, AsyncTreeViewer(hub_of(service), timeout=SECONDS) as viewer:
        robot = await viewer.robot("arm", file)
        sliders = await viewer.controls.add_joint_sliders(robot)
        await sliders.set({"elbow": 1.0})
        assert shown(service)["arm/elbow"] == 1.0
        await sliders.reset()
        assert sliders.values == {"shoulder": 0.0, "elbow": 0.0}
        await sliders.delete()
        assert shown(service) == {}
