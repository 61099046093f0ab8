"""Robots whose mesh and texture files the client sends: the viewer shows what the server's own reader gives."""

import asyncio
import os
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.files.robots.reader import read_robot
from gateway.scene.draw.bounds import instance_bounds
from gateway.scene.draw.flatten import flatten
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Node
from renderers.encode import png_rgb
from scenegate import TreeViewer
from tests.adapters.treeviewer.transports import serving
from tests.files.robots.files import write
from tests.support.waiting import SECONDS

QUAD = "v 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
PLAIN, TEXTURED = QUAD + "f 1 2 3\n", QUAD + "f 1/1 2/2 3/3\nf 1/1 3/3 4/4\n"
COLORED = "mtllib some colors.mtl\n" + QUAD + "usemtl m\nf 1/1 2/2 3/3\n"
MATERIAL = "newmtl m\nKd 0 1 0\nmap_Kd -clamp on images/red.png\n"
CELL = """<robot name="cell">
  <material name="green"><color rgba="0 1 0 0.5"/></material>
  <link name="plain"><visual><geometry><mesh filename="package://cell/meshes/plain.obj" scale="1 -2 3"/></geometry>
    <material name="green"/></visual></link>
  <link name="default"><visual><origin xyz="1 2 3" rpy="0.1 0.2 0.3"/>
    <geometry><mesh filename="meshes/plain.obj"/></geometry></visual></link>
  <link name="textured"><visual><geometry><mesh filename="meshes/textured.obj"/></geometry>
    <material name="t"><texture filename="meshes/images/red.png"/></material></visual></link>
  <link name="own"><visual><geometry><mesh filename="meshes/colored.obj"/></geometry>
    <material name="green"/></visual></link>
  <link name="box"><visual><geometry><box size="1 2 3"/></geometry><material name="green"/></visual></link>
  <link name="tag"><visual><geometry><box size="1 2 3"/></geometry>
    <material name="t"/></visual></link>
  <joint name="e" type="fixed"><parent link="plain"/><child link="tag"/></joint>
  <joint name="a" type="fixed"><parent link="plain"/><child link="default"/></joint>
  <joint name="b" type="fixed"><parent link="plain"/><child link="textured"/></joint>
  <joint name="c" type="fixed"><parent link="plain"/><child link="own"/></joint>
  <joint name="d" type="fixed"><parent link="plain"/><child link="box"/></joint>
</robot>
"""


def cell(folder: Path) -> Path:
    """Write a robot with meshes, materials and textures of all kinds."""
    for name, content in (("plain", PLAIN), ("textured", TEXTURED), ("colored", COLORED)):
        write(folder, content, f"cell/meshes/{name}.obj")
    write(folder, MATERIAL, "cell/meshes/some colors.mtl")
    image = folder / "cell/meshes/images/red.png"
    image.parent.mkdir()
    image.write_bytes(png_rgb(np.full((4, 4, 3), (255, 0, 0), np.uint8)))
    return write(folder, CELL, "cell/cell.urdf")


def shown(parts: tuple[Part, ...] | None) -> list[Any]:
    """Return colours, textures and bounds of parts, in the order of their bounds."""
    parts = parts or ()
    materials = [part.material for part in parts]
    textures = [each.base_color_texture for each in materials]
    bounds = [instance_bounds(flatten(Node((part,))).instances) for part in parts]
    rows = [
        (
            np.round([np.min([b[0] for b in boxes], 0), np.max([b[1] for b in boxes], 0)], 5).tolist(),
            np.round(material.base_color, 4).tolist(),
            None if texture is None else texture.image.decode().mean((0, 1)).round().tolist(),
        )
        for material, texture, all_boxes in zip(materials, textures, bounds, strict=True)
        if (boxes := [box for box in all_boxes if box is not None])
    ]
    return sorted(rows, key=repr)


async def assert_published_as_read(path: Path) -> None:
    """Publish a robot, and compare each link with what the server reads."""
    expected, live = read_robot(path), LiveTree()
    async with serving(live=live) as service:

        def publish() -> tuple[str, ...]:
            with TreeViewer(f"tcpq://127.0.0.1:{service.tcpq_port}", timeout=SECONDS) as viewer:
                robot = viewer.robot("robot", path)
                return (*robot.warnings, *robot.answer.warnings)

        warnings = await asyncio.to_thread(publish)
    assert len(warnings) == len(expected.warnings), (warnings, expected.warnings)
    for link, parts in zip(expected.links, expected.parts, strict=True):
        node = live.snapshot.root.find(("robot", link))
        assert node is not None
        assert shown(node.parts) == shown(parts), (path, link)


async def test_meshes_materials_and_textures_arrive(tmp_path: Path) -> None:
    await assert_published_as_read(cell(tmp_path))


async def test_a_broken_mesh_costs_itself_only(tmp_path: Path) -> None:
    path, live = cell(tmp_path), LiveTree()
    write(tmp_path, "no numbers\n", "cell/meshes/plain.obj")
    async with serving(live=live) as service:

        def publish(**options: Any) -> tuple[str, ...]:
            with TreeViewer(f"tcpq://127.0.0.1:{service.tcpq_port}", timeout=SECONDS) as viewer:
                return viewer.robot("robot", path, **options).answer.warnings

        warnings = await asyncio.to_thread(publish)
        about_plain = [warning for warning in warnings if "plain.obj" in warning]
        assert len(about_plain) == 2
        assert all(warning.endswith("so nothing is drawn") for warning in about_plain)
        node = live.snapshot.root.find(("robot", "own"))
        assert node is not None
        assert node.parts
        with pytest.raises(ValueError, match=r"cell\.urdf: .*plain\.obj.*refused: --strict"):
            await asyncio.to_thread(publish, strict=True)
        assert live.snapshot.root.find(("robot",)) is None


@pytest.mark.slow
@pytest.mark.parametrize("name", ["panda", "talos_reduced", "tiago", "ur5_robot", "spot", "hyq_no_sensors", "xarm7"])
async def test_real_robots(name: str) -> None:
    found = os.environ.get("SCENEGATE_ROBOTS")
    if not found:
        pytest.skip("SCENEGATE_ROBOTS does not name a folder with packages of robot files")
    paths = sorted(Path(found).rglob(f"{name}.urdf"))  # noqa: ASYNC240 - nothing else runs
    if not paths:
        pytest.skip(f"there is no {name}.urdf")
    await assert_published_as_read(paths[0])
