"""Robot files that tests write."""

from pathlib import Path

from gateway.files.robots.reader import read_robot
from gateway.files.robots.robot import Robot

ARM = """<robot name="arm">
  <material name="red"><color rgba="1 0 0 0.5"/></material>
  <link name="base"><visual><geometry><box size="0.4 0.4 0.1"/></geometry><material name="red"/></visual></link>
  <link name="upper">
    <visual><origin xyz="0 0 0.5"/><geometry><cylinder radius="0.05" length="1"/></geometry></visual>
    <collision><geometry><sphere radius="0.2"/></geometry></collision>
  </link>
  <link name="hand"/>
  <link name="finger"/>
  <link name="tool"/>
  <joint name="shoulder" type="revolute">
    <parent link="base"/><child link="upper"/><origin xyz="0 0 0.05"/><axis xyz="0 2 0"/>
    <limit lower="-1" upper="2" effort="1" velocity="1"/>
  </joint>
  <joint name="elbow" type="continuous">
    <parent link="upper"/><child link="hand"/><origin xyz="0 0 1" rpy="0.1 0.2 0.3"/><axis xyz="1 0 0"/>
  </joint>
  <joint name="grip" type="prismatic">
    <parent link="hand"/><child link="finger"/><axis xyz="0 1 0"/><mimic joint="elbow" multiplier="0.5" offset="0.1"/>
  </joint>
  <joint name="mount" type="fixed"><parent link="hand"/><child link="tool"/><origin xyz="0.1 0 0"/></joint>
</robot>
"""
"""An arm of five links, with a joint of most kinds."""

TRIANGLE = "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n"
"""A mesh in OBJ."""


def link(content: str) -> str:
    """Return a robot of one link ``a``."""
    return f'<robot name="r"><link name="a">{content}</link></robot>'


def visual(geometry: str, rest: str = "") -> str:
    """Return a robot of one link with a visual geometry."""
    return link(f"<visual><geometry>{geometry}</geometry>{rest}</visual>")


def write(folder: Path, content: str | bytes, name: str = "robot.urdf") -> Path:
    """Write a file below a folder."""
    path = folder / name
    path.parent.mkdir(parents=True, exist_ok=True)
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return path


def read(folder: Path, content: str | bytes) -> Robot:
    """Write and read a robot file."""
    return read_robot(write(folder, content))
