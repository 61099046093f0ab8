"""OGRE's material scripts, which SDF files name."""

from __future__ import annotations

from pathlib import Path

import pytest

from scenegate.robots.limits import RobotFileLimits
from scenegate.robots.reader import read_robot
from tests.files.robots.files import write

BOX = "<box><size>1 1 1</size></box>"
UNKNOWN = "link 'a', visual: the material script {!r} is not known, the default colour is used"


def robot_file(folder: Path, name: str, *uris: str, visuals: int = 1) -> Path:
    """Write an SDF file whose link ``a`` has boxes with a material of scripts."""
    script = "".join(f"<uri>{uri}</uri>" for uri in uris) + f"<name>{name}</name>"
    visual = f"<visual><geometry>{BOX}</geometry><material><script>{script}</script></material></visual>"
    sdf = f"<sdf version='1.9'><model name='m'><link name='a'>{visual * visuals}</link></model></sdf>"
    return write(folder, sdf, "robot.sdf")


def color_of_script(folder: Path, name: str, script: str | bytes) -> tuple[object, tuple[str, ...]]:
    """Return the colour of a box with a material of a script, and the warnings."""
    write(folder, script, "m.material")
    robot = read_robot(robot_file(folder, name, "m.material"))
    return robot.parts[0][0].color, robot.warnings


@pytest.mark.parametrize(
    "script", ["// nothing yet\n", "", b"\xff\x00\x80", "version https://git-lfs.github.com/spec/v1\n"]
)
def test_a_script_without_materials_is_a_warning(tmp_path: Path, script: str | bytes) -> None:
    _, warnings = color_of_script(tmp_path, "A", script)
    assert warnings == (UNKNOWN.format("A"),)


def test_a_script_above_its_limit_is_a_warning(tmp_path: Path) -> None:
    _, (warning,) = color_of_script(tmp_path, "A", "material A {}\n" + " " * (4 << 20))
    assert warning == UNKNOWN.format("A")


@pytest.mark.parametrize(
    ("diffuse", "color"),
    [
        ("9 0.5 -0.9", (1, 0.5, 0, 1)),
        ("1e30 -5 0 2", (1, 0, 0, 1)),
        ("nan 0 0", (1, 1, 1, 1)),
        ("1e999 0 0", (1, 1, 1, 1)),
        ("vertexcolour", (1, 1, 1, 1)),
    ],
)
def test_colours_of_scripts_are_from_0_to_1(tmp_path: Path, diffuse: str, color: tuple[float, ...]) -> None:
    assert color_of_script(tmp_path, "A", f"material A\n{{\n diffuse {diffuse}\n}}\n") == (color, ())


def test_a_texture_with_too_long_a_name_is_a_warning(tmp_path: Path) -> None:
    script = f"material A {{\n diffuse 0 1 0\n texture {'x' * 300}.png\n}}\n"
    color, (warning,) = color_of_script(tmp_path, "A", script)
    assert (color, warning.endswith("of its material is not shown: File name too long")) == ((0, 1, 0, 1), True)


OGRE_SCRIPT = """abstract material Parent
{ technique { pass { diffuse 1 0 0 1 } } }
material Child : Parent
{
}
material Grandchild:"Child"
{
  pass { texture_unit { texture paint.png } }
}
material "With Space" // a comment "
{
  diffuse 0 1 0 // green
}
/*
material Comment
{
}
*/
// material Comment
material Path//Name
{
  diffuse 0 0 1
}
material Circle : Other { }
material Other : Circle { }
material Orphan : Nobody { }
material "Orphan with a colour" : Nobody {
  diffuse 0 1 1
}
"""


@pytest.mark.parametrize(
    ("name", "color"),
    [
        ("Parent", (1, 0, 0, 1)),
        ("Child", (1, 0, 0, 1)),
        ("Grandchild", (1, 0, 0, 1)),
        ("With Space", (0, 1, 0, 1)),
        ("Path//Name", (0, 0, 1, 1)),
        ("Orphan with a colour", (0, 1, 1, 1)),
        ("With", None),
        ("Comment", None),
        ("Circle", None),
        ("Orphan", None),
    ],
)
def test_scripts_follow_the_rules_of_ogre(tmp_path: Path, name: str, color: tuple[float, ...] | None) -> None:
    found, warnings = color_of_script(tmp_path, name, OGRE_SCRIPT)
    if color is None:
        assert warnings == (UNKNOWN.format(name),)
    else:
        assert found == color
        assert [("paint.png" in warning) for warning in warnings] == [True] * (name == "Grandchild")


def test_a_parent_may_be_in_another_script_of_the_folder(tmp_path: Path) -> None:
    write(tmp_path, "material Parent\n{\n diffuse 1 0 0\n}\n", "scripts/b.material")
    write(tmp_path, "material Child : Parent\n{\n}\n", "scripts/a.material")
    robot = read_robot(robot_file(tmp_path, "Child", "scripts"))
    assert (robot.parts[0][0].color, robot.warnings) == ((1, 0, 0, 1), ())


def test_a_script_is_read_once(tmp_path: Path) -> None:
    """The limit leaves room for both scripts once. One is named by itself and with its folder, both by two visuals."""
    write(tmp_path, "material A\n{\n}\n" + " " * 2000, "m.material")
    write(tmp_path, "material B\n{\n diffuse 1 0 0\n}\n" + " " * 2500, "last/b.material")
    path = robot_file(tmp_path, "B", "m.material", ".", "last", visuals=2)
    robot = read_robot(path, limits=RobotFileLimits(max_total_bytes=path.stat().st_size + 5000))
    assert ([part.color for part in robot.parts[0]], robot.warnings) == ([(1, 0, 0, 1)] * 2, ())
