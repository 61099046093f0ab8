"""``scenegate publish``, ``record`` and ``play`` with a running tree viewer."""

import asyncio
import json
import sys
from asyncio.subprocess import Process
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.adapters.treeviewer.service import TreeViewerService
from gateway.scene.tree.geometry import PointCloud, Surface
from gateway.scene.tree.live import LiveTree
from tests.adapters.treeviewer.transports import serving
from tests.client.test_tree_controls import change, shown
from tests.files.robots.files import ARM, TRIANGLE, write
from tests.support import command
from tests.support.liblcm import liblcm
from tests.support.waiting import SECONDS, until

REQUEST = {
    "delete": [{"path": ["gone"]}],
    "setgeometry": [
        {"path": ["a"], "geometry": {"type": "box", "lengths": [1, 1, 1]}},
        {"path": "b/c", "geometries": [{"type": "sphere", "radius": 1}, {"type": "triad"}]},
    ],
    "settransform": [{"path": ["a"], "transform": {"translation": [0, 0, 2]}}],
}
PLY = """ply
format ascii 1.0
element vertex 3
property float x
property float y
property float z
property uchar red
property uchar green
property uchar blue
"""
ROWS = "0 0 0 255 0 0\n1 0 0 0 255 0\n0 1 0 0 0 255\n"
PATIENT = ("--timeout", str(SECONDS))
FACES = "element face 1\nproperty list uchar int vertex_indices\n"

pytestmark = pytest.mark.lcm


@pytest.fixture(autouse=True)
def lcm() -> None:
    liblcm()


@asynccontextmanager
async def publishing(service: TreeViewerService, path: Path, *options: str) -> AsyncIterator[Process]:
    arguments = ("publish", str(path), *options, "--lcm-url", url_of(service), *PATIENT)
    process = await asyncio.create_subprocess_exec(sys.executable, "-m", "scenegate", *arguments)
    try:
        yield process
    finally:
        process.terminate()
        await process.wait()


def url_of(service: TreeViewerService) -> str:
    return f"tcpq://127.0.0.1:{service.tcpq_port}"


async def scenegate(*arguments: str | Path) -> command.Ran:
    return await asyncio.to_thread(command.scenegate, *map(str, arguments))


@pytest.mark.slow
async def test_a_robot_is_published_again_when_its_files_change(tmp_path: Path) -> None:
    live, path, mesh = LiveTree(), tmp_path / "robot.urdf", tmp_path / "m.obj"

    def write_robot(links: str) -> None:
        path.write_text(f"<robot>{links}</robot>")

    def parts_of(link: str) -> int:
        node = live.snapshot.root.find(("robot", link))
        return len(node.parts or ()) if node is not None else -1

    visual = '<visual><geometry><mesh filename="m.obj"/></geometry></visual>'
    mesh.write_text(TRIANGLE)
    write_robot(f'<link name="a">{visual}</link>')
    async with serving(live=live) as service, publishing(service, path, "--reload"):
        await until(lambda: parts_of("a") == 1)
        write_robot("<link")  # an error is printed, and the next change is awaited
        write_robot('<link name="b"/>')
        await until(lambda: parts_of("b") == 0 and parts_of("a") == -1)
        write_robot(f'<link name="a">{visual}</link>')
        await until(lambda: parts_of("a") == 1)
        mesh.write_text("")
        await until(lambda: parts_of("a") <= 0)
        mesh.write_text(TRIANGLE)
        await until(lambda: parts_of("a") == 1)


async def test_sliders_move_a_robot_until_the_command_ends(tmp_path: Path) -> None:
    live, robot = LiveTree(), write(tmp_path, ARM)
    async with serving(live=live) as service:
        async with publishing(service, robot, "--path", "arm", "--joint", "shoulder=0.5") as process:
            await until(lambda: shown(service) == {"arm/shoulder": 0.5, "arm/elbow": 0.0, "arm/Reset": 0})
            hand = live.snapshot.root.children["arm"].children["hand"].matrix
            change(service, "arm/shoulder", 1.0)
            await until(lambda: (live.snapshot.root.children["arm"].children["hand"].matrix != hand).any())
        assert process.returncode == 0
        await until(lambda: not shown(service))


@pytest.mark.slow
async def test_sliders_stay_when_a_robot_is_published_again(tmp_path: Path) -> None:
    robot = write(tmp_path, ARM)
    async with serving() as service, publishing(service, robot, "--path", "arm", "--reload"):
        await until(lambda: shown(service) == {"arm/shoulder": 0.0, "arm/elbow": 0.0, "arm/Reset": 0})
        change(service, "arm/shoulder", 1.0)
        robot.write_text(ARM.replace('name="elbow"', 'name="knee"').replace('joint="elbow"', 'joint="knee"'))
        await until(lambda: shown(service) == {"arm/shoulder": 1.0, "arm/knee": 0.0, "arm/Reset": 0})


async def test_requests_are_published_below_a_path(tmp_path: Path) -> None:
    live = LiveTree()
    (tmp_path / "scene.json").write_text(json.dumps(REQUEST))
    async with serving(live=live) as service:
        done = await scenegate(
            "publish", tmp_path / "scene.json", "--path", "robot/base", "--lcm-url", url_of(service), *PATIENT
        )
    assert done.exit_code == 0, done.stderr
    assert "deleted: robot/base/gone\nset: robot/base/a, robot/base/b/c\nmoved: robot/base/a\n" in done.stdout
    base: Any = live.snapshot.root.find(("robot", "base"))
    assert base.children["a"].matrix[2, 3] == 2.0
    assert len(base.children["b"].children["c"].parts or ()) == 2


@pytest.mark.parametrize("faces", [True, False], ids=["mesh", "points"])
async def test_mesh_files_are_published(faces: bool, tmp_path: Path) -> None:
    live = LiveTree()
    text = f"{PLY}{FACES if faces else ''}end_header\n{ROWS}{'3 0 1 2' if faces else ''}\n"
    (tmp_path / "thing.ply").write_text(text)
    async with serving(live=live) as service:
        done = await scenegate("publish", tmp_path / "thing.ply", "--lcm-url", url_of(service), *PATIENT)
    assert done.exit_code == 0, done.stderr
    (part,) = live.snapshot.root.children["thing"].parts or ()
    if faces:
        assert isinstance(part.shape, Surface)
        corners, colors = part.shape.mesh.positions, part.shape.mesh.colors
        assert colors is not None
    else:
        assert isinstance(part.shape, PointCloud)
        corners, colors = part.shape.points, part.shape.channels["rgb"]
    np.testing.assert_allclose(sorted(corners.tolist()), [(0, 0, 0), (0, 1, 0), (1, 0, 0)])
    np.testing.assert_allclose(sorted(colors[:, :3].tolist()), np.eye(3)[::-1])


@pytest.mark.parametrize(
    ("name", "text", "reason"),
    [
        ("x.json", "{", "is not JSON"),
        ("x.json", "[" * 100_000, "nested too deeply"),
        ("x.json", "[1]", "is not a request of the protocol"),
        ("x.json", '{"setgeometry": [{}]}', r"setgeometry[0] has no path"),
        ("x.json", '{"setgeometry": true}', r"setgeometry is not a list"),
        ("x.json", '{"setgeometry": [{"path": ["a"], "geometries": 5}]}', r"geometries of ('a',)"),
        ("x.json", '{"delete": [{"path": [[1]]}]}', r"delete[0].path"),
        ("x.txt", "", "x.txt"),
    ],
)
async def test_rejects_files_that_cannot_be_published(name: str, text: str, reason: str, tmp_path: Path) -> None:
    (tmp_path / name).write_text(text)
    done = await scenegate("publish", tmp_path / name, "--lcm-url", "memq://")
    assert done.exit_code != 0
    assert reason in done.stderr


async def test_fields_that_are_ignored_are_named(tmp_path: Path) -> None:
    file = tmp_path / "x.json"
    file.write_text(json.dumps({"settransfrom": [], "setgeometry": [{"path": ["a"], "geometri": {}}]}))
    async with serving() as service:
        done = await scenegate("publish", file, "--lcm-url", url_of(service), *PATIENT)
    assert done.exit_code == 0
    assert "'settransfrom'" in done.stderr
    assert "'geometri'" in done.stderr


async def test_a_broken_mesh_is_named(tmp_path: Path) -> None:
    (tmp_path / "x.obj").write_text("v 1\n")
    async with serving() as service:
        done = await scenegate("publish", tmp_path / "x.obj", "--lcm-url", url_of(service), *PATIENT)
        refused = await scenegate("publish", tmp_path / "x.obj", "--strict", "--lcm-url", url_of(service), *PATIENT)
    assert "x.obj" in done.stderr
    assert refused.exit_code == 1
    assert "(refused: --strict)" in refused.stderr


async def test_plays_a_recorded_log(tmp_path: Path) -> None:
    log, live = tmp_path / "out.lcmlog", LiveTree()
    (tmp_path / "scene.json").write_text(json.dumps(REQUEST))
    async with serving() as service:
        recorder: Any = await asyncio.create_subprocess_exec(
            sys.executable,
            "-m",
            "scenegate",
            "record",
            str(log),
            "--lcm-url",
            url_of(service),
            stderr=asyncio.subprocess.PIPE,
        )
        async with asyncio.timeout(SECONDS):
            assert await recorder.stderr.readline() == b"Recording ...\n"
            assert (
                await scenegate("publish", tmp_path / "scene.json", "--lcm-url", url_of(service), *PATIENT)
            ).exit_code == 0
            recorder.terminate()
            assert b"messages" in await recorder.stderr.read()
            assert await recorder.wait() == 0
    async with serving(live=live) as service:
        done = await scenegate("play", log, "--lcm-url", url_of(service), "--rate", "0", "--channels", ".*REQUEST.*")
        assert done.exit_code == 0, done.stderr
        assert "messages played" in done.stderr
        await until(lambda: set(live.snapshot.root.children) == {"a", "b"})
