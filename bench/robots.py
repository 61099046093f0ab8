"""Robots from packages: a contact sheet, and the time to move one.

    python -m bench.robots FOLDER [SHEET.jpg]

FOLDER has the packages example-robot-data and robosuite (``SCENEGATE_ROBOTS`` of the tests); MJCF needs the package
``mujoco``. The sheet (default: docs/images/gallery/robots.jpg) shows each robot with the studio look and the camera
``fit``. Then the links of a robot are moved, over TCPQ to a gateway of its own.
"""

from __future__ import annotations

import math
import sys
import time
from pathlib import Path
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.client import TreeViewer
from gateway.robots.reader import read_robot
from gateway.scene.cameras import parse_camera
from gateway.scene.flatten import flatten
from gateway.scene.viewpoints import resolve_camera
from renderers.encode import jpeg_rgb
from renderers.interface import Look, Output
from renderers.raster import CpuRenderer, warmup
from tests.support import clients
from tests.support.gateway_process import gateway_process

COLUMNS: Final = 6
WIDTH, HEIGHT = 280, 280
LABEL_ROWS: Final = 22
BACKGROUND: Final = (236, 239, 243)
MOVES: Final = 1000
_URDF: Final = "cmeel.prefix/share/example-robot-data/robots"
_MJCF: Final = "robosuite/models/assets/robots"
ROBOTS: Final[dict[str, tuple[str, dict[str, float]]]] = {
    "Panda": (f"{_URDF}/panda_description/urdf/panda.urdf", {"panda_joint4": -1.8, "panda_joint6": 1.8}),
    "UR5": (f"{_URDF}/ur_description/urdf/ur5_robot.urdf", {"shoulder_lift_joint": -1.2, "elbow_joint": 1.4}),
    "xArm 7": (f"{_URDF}/xarm_description/urdf/xarm7.urdf", {"joint4": 1.2}),
    "Kinova": (f"{_URDF}/kinova_description/robots/kinova.urdf", {"j2s6s200_joint_3": 2.0}),
    "SO-101": (f"{_URDF}/so_arm_description/urdf/so101.urdf", {}),
    "Z1": (f"{_URDF}/z1_description/urdf/z1.urdf", {"joint2": 1.2, "joint3": -1.0}),
    "Talos": (f"{_URDF}/talos_data/robots/talos_full_v2.urdf", {"arm_right_4_joint": -1.5}),
    "G1": (f"{_URDF}/g1_description/urdf/g1_29dof_rev_1_0.urdf", {}),
    "Romeo": (f"{_URDF}/romeo_description/urdf/romeo.urdf", {}),
    "TIAGo": (f"{_URDF}/tiago_description/robots/tiago.urdf", {"arm_4_joint": 1.6}),
    "TIAGo Pro": (f"{_URDF}/tiago_pro_description/robots/tiago_pro.urdf", {}),
    "PR2": (f"{_URDF}/pr2_description/urdf/pr2.urdf", {}),
    "ANYmal B": (f"{_URDF}/anymal_b_simple_description/robots/anymal.urdf", {}),
    "ANYmal C": (f"{_URDF}/anymal_c_simple_description/urdf/anymal.urdf", {}),
    "Go2": (f"{_URDF}/go2_description/urdf/go2.urdf", {}),
    "Laikago": (f"{_URDF}/laikago_description/urdf/laikago.urdf", {}),
    "Solo 12": (f"{_URDF}/solo_description/robots/solo12.urdf", {}),
    "Hextilt": (f"{_URDF}/hextilt_description/urdf/hextilt_flying_arm_5.urdf", {}),
    "iiwa (MJCF)": (f"{_MJCF}/iiwa/robot.xml", {"joint_2": 0.6, "joint_4": -1.4}),
    "UR5e (MJCF)": (f"{_MJCF}/ur5e/robot.xml", {"shoulder_lift_joint": -1.2, "elbow_joint": 1.4}),
    "Sawyer (MJCF)": (f"{_MJCF}/sawyer/robot.xml", {}),
    "Baxter (MJCF)": (f"{_MJCF}/baxter/robot.xml", {}),
    "Spot (MJCF)": (f"{_MJCF}/spot/robot.xml", {}),
    "Humanoid (MJCF)": ("dm_control/suite/humanoid.xml", {}),
}
"""Name of each robot with its file and joint values."""


def tile(renderer: CpuRenderer, name: str, path: Path, joints: dict[str, float]) -> NDArray[np.uint8]:
    """Return the image of a robot above its name, (HEIGHT + LABEL_ROWS, WIDTH, 3) uint8."""
    root = read_robot(path).tree(joints)
    draw_list = flatten(root)
    camera = resolve_camera(parse_camera("fit"), root, WIDTH, HEIGHT, draw_list=draw_list)
    with renderer.render(draw_list, camera, Output.COLOR, Look("studio", BACKGROUND, 8)) as frame:
        assert frame.color is not None
        label = np.full((LABEL_ROWS, WIDTH, 3), BACKGROUND, np.uint8)
        cv2.putText(label, name, (10, 15), cv2.FONT_HERSHEY_SIMPLEX, 0.45, (40, 40, 40), 1, cv2.LINE_AA)
        return np.vstack((frame.color, label))


def sheet(folder: Path) -> NDArray[np.uint8]:
    """Return the contact sheet of all robots."""
    renderer = CpuRenderer()
    tiles = [tile(renderer, name, folder / path, joints) for name, (path, joints) in ROBOTS.items()]
    rows = [np.hstack(tiles[start : start + COLUMNS]) for start in range(0, len(tiles), COLUMNS)]
    return np.ascontiguousarray(np.vstack(rows))


def time_moves(folder: Path, name: str) -> str:
    """Return a line with the time to move all joints of a robot."""
    with gateway_process("--only", "treeviewer", "--lcm-url", "off", "--tcpq-port", "0") as (_, url):
        hub = clients.get(f"{url}/healthz").json()["interfaces"]["treeviewer"]["tcpq"]["url"]
        with TreeViewer(hub) as viewer:
            robot = viewer.robot(name, folder / ROBOTS[name][0])
            free = [joint.name for joint in robot.joints.values() if len(joint.default) == 1]
            wall, cpu = time.perf_counter(), time.process_time()
            for step in range(MOVES):
                robot.set_joints({joint: 0.3 * math.sin(0.1 * step) for joint in free})
            wall, cpu = time.perf_counter() - wall, time.process_time() - cpu
    milliseconds = 1e3 / MOVES
    return (
        f"{name}, {len(robot.links)} links, {len(free)} joints: {wall * milliseconds:.2f} ms a move with its response, "
        f"{cpu * milliseconds:.2f} ms of the client's CPU ({cpu / MOVES * 100:.0%} of a core at 100 Hz)"
    )


def main() -> None:
    """Write the sheet, and print the times."""
    folder = Path(sys.argv[1])
    out = Path(sys.argv[2]) if len(sys.argv) > 2 else Path("docs/images/gallery/robots.jpg")
    warmup()
    out.write_bytes(jpeg_rgb(sheet(folder)))
    print(out)
    for name in ("Panda", "Go2", "Talos", "Spot (MJCF)"):
        print(time_moves(folder, name))


if __name__ == "__main__":
    main()
