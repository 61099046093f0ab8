"""Up axis of a robot's glTF meshes."""

from pathlib import Path
from typing import Literal

import numpy as np
import pytest

from gateway.files.robots.reader import MAX_LINKS_FOR_NOTE, read_robot
from scenegate.robots.robot_files import RobotFiles
from tests.files.gltf.builder import Builder
from tests.files.robots.files import link, write
from tests.files.robots.test_link_parts import corners

TOWER = np.array([(0, 0, 0), (0.1, 0, 0), (0, 0.1, 0), (0, 0, 3)], np.float32)
"""A tetrahedron that is 3 m high in a file with Z up, and lies in one with Y up."""


def robot_with(folder: Path, collision: str) -> Path:
    faces = [(0, 2, 1), (0, 1, 3), (0, 3, 2), (1, 2, 3)]
    write(folder, Builder().draw(TOWER, np.ravel(faces)).text(), "m.gltf")
    visual = '<visual><geometry><mesh filename="m.gltf"/></geometry></visual>'
    return write(folder, link(visual + f"<collision><geometry>{collision}</geometry></collision>"))


@pytest.mark.parametrize(
    ("gltf_up", "collision", "height", "note"),
    [
        ("y", '<box size="0.1 0.1 6"/>', 0.1, "Y up; with --robot-gltf-up z, their bounds are nearer"),
        ("y", '<box size="0.1 6 0.1"/>', 0.1, None),
        ("z", '<box size="0.1 6 0.1"/>', 3.0, None),
        ("auto", '<box size="0.1 0.1 6"/>', 3.0, "Z up: their bounds"),
        ("auto", '<box size="0.1 6 0.1"/>', 0.1, "Y up: their bounds"),
    ],
)
def test_up_axis(
    tmp_path: Path, gltf_up: Literal["y", "z", "auto"], collision: str, height: float, note: str | None
) -> None:
    robot = read_robot(robot_with(tmp_path, collision), gltf_up=gltf_up, strict=True)
    ((part,),) = robot.parts
    assert np.ptp(corners(part)[:, 2]) == pytest.approx(height)
    assert list(robot.digests) == ["robot.urdf", "m.gltf"]
    assert [text.startswith(f"glTF meshes are taken as {note}") for text in robot.notes] == [True] * (note is not None)


def test_the_note_needs_the_collision_meshes_of_a_few_links(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    names: list[str] = []
    find = RobotFiles.find

    def find_and_note(files: RobotFiles, name: str) -> Path:
        names.append(name)
        return find(files, name)

    monkeypatch.setattr(RobotFiles, "find", find_and_note)
    robot_with(tmp_path, "")
    geometry = "<{0}><geometry><mesh filename='{1}'/></geometry></{0}>"
    links = (
        f"<link name='{i}'>{geometry.format('visual', 'm.gltf')}{geometry.format('collision', f'{i}.stl')}</link>"
        for i in range(2 * MAX_LINKS_FOR_NOTE)
    )
    read_robot(write(tmp_path, f"<robot>{''.join(links)}</robot>"))
    assert [name for name in names if name != "m.gltf"] == [f"{i}.stl" for i in range(MAX_LINKS_FOR_NOTE)]
