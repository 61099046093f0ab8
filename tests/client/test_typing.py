"""A user's program under ``mypy --strict``: the installed package is typed, and wrong names are errors."""

import importlib.metadata
import subprocess
import sys
from pathlib import Path

import pytest

pytest.importorskip("mypy", reason="mypy is in the group lint only")

PROGRAM = """
import asyncio
from typing import assert_type

import numpy as np

from scenegate import Answer, AsyncTreeViewer, Box, MeshFile, PointCloud, Sphere, TreeViewer
from scenegate.camera import StreamOptions, depth, receive
from scenegate.datasets import Dataset
from scenegate.robots import read_robot

with TreeViewer("tcpq://localhost:7700") as viewer:
    answer = viewer["robot"]["base"].set(Box((1, 1, 1), color="orange"), transform=np.eye(4))
    assert_type(answer, Answer)
    robot = viewer.robot("arm", "arm.urdf", joints={"elbow": 0.5})
    robot.set_joints({"elbow": [0.5]})
    viewer.set(Box((1, 1, 1)))
    with viewer.batch() as batch:
        batch["cloud"].set(PointCloud(np.zeros((5, 3)), colors=np.zeros((5, 3), np.uint8)))
        batch["box"].set(Box(np.ones(3)), Sphere(1.0, transform=np.arange(7)))
        batch["mesh"].set(MeshFile.read("mesh.obj"))


async def publish() -> None:
    async with AsyncTreeViewer() as viewer:
        assert_type(await viewer["a"].set(Box((1, 1, 1))), Answer)
        robot = await viewer.robot("arm", "arm.urdf", textures=False)
        assert_type(await robot.set_joints({"elbow": 1.0}), Answer)


asyncio.run(publish())
for images, size in receive(StreamOptions("localhost", depth=True)):
    print(depth(images.disparity).shape, size)
print([sample.color.shape for sample in Dataset("out")], read_robot("arm.urdf").links)
"""
MISTAKES = {
    'TreeViewer().publish("a")': '"TreeViewer" has no attribute "publish"',
    'TreeViewer()["a"].move((0, 0, 1))': '"NodeHandle" has no attribute "move"',
    "Box((1, 1, 1), colour='red')": 'Unexpected keyword argument "colour" for "Box"',
    "AsyncTreeViewer().clear()": '"AsyncTreeViewer" has no attribute "clear"',
    'AsyncTreeViewer().robot("arm")': "Too few arguments",
    'AsyncTreeViewer()["a"].set_visible("yes")': 'incompatible type "str"; expected "bool"',
    "from scenegate import Sphaere": 'Module "scenegate" has no attribute "Sphaere"',
}


def check(folder: Path, program: str) -> str:
    try:
        importlib.metadata.distribution("scenegate-client")
    except importlib.metadata.PackageNotFoundError:
        pytest.skip("scenegate-client is not installed")
    file = folder / "program.py"
    file.write_text(program)
    command = (sys.executable, "-m", "mypy", "--strict", "--config-file=", "--no-error-summary", file.name)
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False).stdout


@pytest.mark.slow
def test_a_program_is_accepted_and_each_mistake_found(tmp_path: Path) -> None:
    assert check(tmp_path, PROGRAM) == ""
    first = PROGRAM.count("\n") + 1
    reported = check(tmp_path, "\n".join((PROGRAM, *MISTAKES))).splitlines()
    for number, (mistake, message) in enumerate(MISTAKES.items(), first + 1):
        errors = [line for line in reported if line.startswith(f"program.py:{number}: error: ")]
        assert any(message in line for line in errors), (mistake, reported)
