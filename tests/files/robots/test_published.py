"""Robots that the server reads for clients."""

from pathlib import Path

from gateway.files.robots.published import read_published_robot
from tests.files.gltf.builder import Builder


def test_lights_of_meshes_are_not_published(tmp_path: Path) -> None:
    b = Builder()
    b.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    b.node(mesh=b.triangle(), extensions={"KHR_lights_punctual": {"light": 0}})
    (tmp_path / "lamp.gltf").write_bytes(b.text())
    visual = '<visual><geometry><mesh filename="lamp.gltf"/></geometry></visual>'
    path = tmp_path / "robot.urdf"
    path.write_text(f'<robot name="r"><link name="a">{visual}</link></robot>')
    robot = read_published_robot(
        path, roots=(), geometry="visual", keyframe="", gltf_up="y", strict=False, xacro_args={}, textures=True
    )
    assert [[geometry.kind for geometry in link] for link in robot.parts] == [["mesh_data"]]
    (warning,) = robot.warnings
    assert "1 lights" in warning
