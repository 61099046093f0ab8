"""Reads robot files that the client cannot read alone, for ``scenegate.robots``, which finds it by its entry point.

Meshes are sent as triangles, as viewers other than Scenegate require.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import fields
from pathlib import Path
from typing import Literal

from gateway.robots.gltf_up import RobotGltfUp
from gateway.robots.part_geometry import geometries_of
from gateway.robots.part_images import PartImages
from gateway.robots.reader import read_robot
from gateway.robots.robot import Robot
from scenegate.messages.geometry import Geometry
from scenegate.robots import robot as client


def read_published_robot(
    path: str | Path,
    *,
    roots: Iterable[str | Path],
    geometry: Literal["visual", "collision"],
    keyframe: str,
    gltf_up: RobotGltfUp,
    strict: bool,
    textures: bool,
) -> client.Robot[Geometry]:
    """Read a robot file of any kind. See ``TreeViewer.robot``."""
    robot = read_robot(path, roots=roots, geometry=geometry, keyframe=keyframe, gltf_up=gltf_up, strict=strict)
    images = PartImages() if textures else None
    parts = tuple(tuple(each for part in link for each in geometries_of(part, images)) for link in robot.parts)
    others = {field.name: getattr(robot, field.name) for field in fields(Robot) if field.name != "parts"}
    return client.Robot(**others, parts=parts)
