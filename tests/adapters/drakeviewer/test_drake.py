"""Real simulations of pydrake, which publish over LCM: the tree equals what Drake itself computes."""

import asyncio
import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gateway.adapters.drakeviewer.contacts import NEWTONS_PER_METRE
from gateway.scene.tree.geometry import PointCloud, Surface
from gateway.scene.tree.nodes import Node
from tests.adapters.drakeviewer.test_service import hub_of, running
from tests.support import clients
from tests.support.gateway_process import gateway_process
from tests.support.waiting import SECONDS, until, wait_until

pytestmark = [pytest.mark.drake, pytest.mark.slow]
PUBLISHER = Path(__file__).with_name("drake_publisher.py")
VERSIONS = {"1.51.1": "SCENEGATE_DRAKE_PYTHON", "1.58.0": "SCENEGATE_NEW_DRAKE_PYTHON"}


def python_of(version: str) -> str:
    found = os.environ.get(VERSIONS[version])
    if not found:
        pytest.skip(f"{VERSIONS[version]} does not name an interpreter with pydrake")
    return found


class Seen:
    """The tree after a simulation, and what Drake says must be in it."""

    def __init__(self, root: Node, expected: dict[str, Any], status: dict[str, Any]) -> None:
        self.root = root
        self.expected = expected
        self.status = status

    def node(self, *path: str) -> Node:
        node = self.root.find(("drake", *path))
        assert node is not None, path
        return node


async def simulated(python: str) -> Seen:
    async with running() as found, hub_of(found) as url:
        done = await asyncio.to_thread(
            subprocess.run, [python, str(PUBLISHER), url], capture_output=True, text=True, timeout=SECONDS, check=False
        )
        assert done.returncode == 0, done.stderr
        # The publisher's last message is of a channel that is not shown; those before it may still be read in a thread.
        await until(lambda: found.service.status().get("unshown_channels"))
        await until(lambda: not found.live.unapplied_arrivals)
        root, status = found.live.snapshot.root, found.service.status()
    return Seen(root, json.loads(done.stdout.splitlines()[-1]), status)


@pytest.fixture(scope="module", params=VERSIONS)
def seen(request: pytest.FixtureRequest) -> Seen:
    return asyncio.run(simulated(python_of(request.param)))


def test_poses_equal_drakes(seen: Seen) -> None:
    assert len(seen.expected["poses"]) == 5
    for family, names in (("illustration", seen.expected["poses"]), ("proximity", ["arm::fore", "soft::soft"])):
        for name in names:
            path = ("drake", family, "plant", *name.split("::"))
            X = seen.root.world_matrix(path)
            assert X is not None, path
            np.testing.assert_allclose(X, seen.expected["poses"][name], atol=1e-6, err_msg=name)


def test_families_and_their_visibility(seen: Seen) -> None:
    visible = {name: seen.node(name).visible for name in ("illustration", "proximity", "inertia")}
    assert visible == {"illustration": True, "proximity": False, "inertia": False}
    assert seen.node("inertia", "arm", "fore").parts
    families = seen.status["families"]
    assert [families[name]["stale"] for name in ("illustration", "proximity")] == [0, 0]
    assert seen.status["undecodable"] == 0


def test_in_memory_mesh(seen: Seen) -> None:
    sources = [part.source for part in seen.node("illustration", "world").parts or ()]
    assert sources == ["", "tetrahedron.obj"]


def test_point_contacts(seen: Seen) -> None:
    (contact,) = seen.expected["points"]
    parts = seen.node("contacts", "point", "world(0)+hard(4)").parts or ()
    along = parts[0].X_node_part[:3, 2]
    assert np.linalg.norm(along) == pytest.approx(np.linalg.norm(contact["force"]) / NEWTONS_PER_METRE, rel=1e-9)
    np.testing.assert_allclose(parts[0].X_node_part[:3, 3], contact["point"], atol=1e-9)
    direction = np.array(contact["force"]) / np.linalg.norm(contact["force"])
    np.testing.assert_allclose(along / np.linalg.norm(along), direction, atol=1e-9)


def test_hydroelastic_contacts(seen: Seen) -> None:
    (contact,) = seen.expected["surfaces"]
    force, _, *_, surface = seen.node("contacts", "hydroelastic", "world+soft").parts or ()
    along = force.X_node_part[:3, 2]
    assert np.linalg.norm(along) == pytest.approx(np.linalg.norm(contact["force"]) / NEWTONS_PER_METRE, rel=1e-9)
    assert isinstance(surface.shape, Surface)
    assert len(surface.shape.mesh.positions) == contact["vertices"]
    start = force.X_node_part[:3, 3] - 0.5 * along
    np.testing.assert_allclose(start, contact["centroid"], atol=1e-9)


def test_deformable_vertices(seen: Seen) -> None:
    (part,) = seen.node("illustration", "deformable_geometries", "DefaultModelInstance", "jelly").parts or ()
    assert isinstance(part.shape, Surface)
    all_vertices = np.array(seen.expected["vertices"])  # of the volume; its surface is shown
    for vertex in part.shape.mesh.positions:
        assert np.abs(all_vertices - vertex).max(axis=1).min() < 1e-6
    low, high = part.shape.mesh.positions.min(axis=0), part.shape.mesh.positions.max(axis=0)
    np.testing.assert_allclose(low, all_vertices.min(axis=0), atol=1e-6)
    np.testing.assert_allclose(high, all_vertices.max(axis=0), atol=1e-6)


def test_point_cloud_and_frames(seen: Seen) -> None:
    (part,) = seen.node("point clouds", "TEST").parts or ()
    assert isinstance(part.shape, PointCloud)
    expected = np.array([[0, 0, 1], [0.1, 0, 1], [0, 0.1, 1], [0, 0, 1.1]], np.float32)
    np.testing.assert_allclose(part.shape.points, expected)
    np.testing.assert_allclose(part.shape.channels["rgb"][3], [0.2, 0.4, 0.6])
    assert seen.node("frames", "default", "goal", "a").pose == (0.0, 0.5, 1.0, 1.0, 0.0, 0.0, 0.0)


def test_unshown_channel(seen: Seen) -> None:
    assert seen.status["unshown_channels"] == {"DRAKE_VIEWER_LOAD_ROBOT_PERCEPTION": 1}


@pytest.mark.parametrize("version", VERSIONS)
def test_names_in_scene_and_healthz(version: str) -> None:
    python = python_of(version)
    flags = ("--lcm-url", "off", "--tcpq-port", "0", "--grpc-port", "0")
    with gateway_process(*flags) as (_, url), clients.Client(base_url=url) as http:
        hub = http.get("/healthz").json()["interfaces"]["treeviewer"]["tcpq"]["url"]
        subprocess.run([python, str(PUBLISHER), hub], check=True, capture_output=True, timeout=SECONDS)

        def nodes() -> dict[tuple[str, ...], Any]:
            return {tuple(node["path"]): node for node in http.get("/scene").json()["nodes"]}

        def drake() -> Any:
            return http.get("/healthz").json()["interfaces"]["drakeviewer"]

        wait_until(lambda: drake().get("unshown_channels"))
        shown = {
            ("drake", *path) for path in (("frames", "default", "goal", "b"), ("proximity", "plant", "arm", "fore"))
        }
        shown.add(("drake", "illustration", "plant", "arm", "fore"))
        wait_until(lambda: shown <= nodes().keys())
        found = nodes()
        assert found["drake", "illustration", "plant", "arm", "fore"]["kinds"] == ["box"]
        assert not found["drake", "proximity"]["visible"]
        assert found["drake", "proximity"]["bounds"] is None
        described = drake()
        assert described["unshown_channels"] == {"DRAKE_VIEWER_LOAD_ROBOT_PERCEPTION": 1}
        assert described["warnings"][-1].startswith("received, but not shown")
        assert described["simulation_seconds"] == 0.25
        assert http.get("/scene/render").status_code == 200
