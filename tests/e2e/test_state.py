"""``--state`` as its users have it: the whole gateway is killed and started again."""

import asyncio
import signal
import sqlite3
from pathlib import Path
from typing import Any

import pytest

from tests.adapters.treeviewer.conversation import BOX, decoded, message
from tests.adapters.treeviewer.transports import HubClient
from tests.support import clients
from tests.support.gateway_process import gateway_process, refused

FLAGS = ("--lcm-url", "off", "--tcpq-port", "0", "--grpc-port", "0", "--only", "scene,treeviewer,stereo")
CLOUD = {"type": "pointcloud", "points": [[0.1 * i, 0, 0] for i in range(500)], "channels": {"rgb": [[1, 0, 0]] * 500}}


def send(url: str, request: Any) -> dict[str, Any]:
    hub = clients.get(f"{url}/healthz").json()["interfaces"]["treeviewer"]["tcpq"]["url"]

    async def ask() -> dict[str, Any]:
        client = await HubClient.connect(int(hub.rpartition(":")[2]))
        await client.subscribe("DIRECTOR_TREE_VIEWER_RESPONSE_<e2e>")
        await client.publish("DIRECTOR_TREE_VIEWER_REQUEST_<e2e>", message(request))
        _, data = await client.next()
        await client.close()
        return decoded(data)

    return asyncio.run(ask())


def observe(url: str) -> tuple[Any, bytes, Any]:
    scene = clients.get(f"{url}/scene").json()
    picture = clients.get(f"{url}/scene/render", params={"width": 64, "height": 48, "camera": "fit"})
    assert picture.status_code == 200, picture.text
    parameters = clients.get(f"{url}/api/v2/pipelines/0/nodes/rc_camera/parameters").json()
    return {key: value for key, value in scene.items() if key != "revision"}, picture.content, parameters


@pytest.mark.slow
def test_tree_and_parameters_survive_kill_9_and_a_restart(tmp_path: Path) -> None:
    state = tmp_path / "gateway.state"
    with gateway_process(*FLAGS, "--state", str(state)) as (process, url):
        placed = {"translation": [1, 2, 3], "quaternion": [0.5, 0.5, 0.5, 0.5]}
        moves = [{"path": [path], "transform": placed} for path in ("box", "nothing yet")]
        shapes = [{"path": ["box", "it"], "geometry": BOX}, {"path": ["cloud"], "geometry": CLOUD}]
        answer = send(url, {"setgeometry": shapes, "settransform": moves})
        assert answer["status"] == 1, answer
        assert answer["missing_paths"] == [["nothing yet"]]
        put = clients.put(f"{url}/api/v2/pipelines/0/nodes/rc_camera/parameters/fps", json={"value": 7.5})
        assert put.status_code == 200
        before = observe(url)
        process.process.send_signal(signal.SIGKILL)
        process.process.wait()
    with gateway_process(*FLAGS, "--state", str(state)) as (process, url):
        assert observe(url) == before
        assert {p["name"]: p["value"] for p in before[2]}["fps"] == 7.5
        assert clients.get(f"{url}/healthz").json()["interfaces"]["state"]["restored_nodes"] == 4
        assert process.stop() == 0
    assert [entry.name for entry in tmp_path.iterdir()] == ["gateway.state"], "a clean end leaves one file"


@pytest.mark.slow
@pytest.mark.parametrize(("flag", "nodes"), [("--demo", 2), ("--no-drake-viewer", 4)])
def test_the_demo_and_what_drake_publishes_are_not_stored(tmp_path: Path, flag: str, nodes: int) -> None:
    state = tmp_path / "gateway.state"
    arrow = {"path": ["drake", "contacts"], "geometry": BOX}
    with gateway_process(*FLAGS, flag, "--state", str(state)) as (process, url):
        send(url, {"setgeometry": [{"path": ["box"], "geometry": BOX}, arrow]})
        process.kill()  # the demo deletes itself at a clean end
    connection = sqlite3.connect(state)
    assert connection.execute("SELECT count(*) FROM tree_node").fetchone() == (nodes,)
    connection.close()


@pytest.mark.slow
def test_damaged_tree_ends_the_start_and_is_unchanged(tmp_path: Path) -> None:
    state = tmp_path / "gateway.state"
    with gateway_process(*FLAGS, "--state", str(state)) as (process, url):
        send(url, {"setgeometry": [{"path": ["box"], "geometry": BOX}]})
        assert process.stop() == 0
    connection = sqlite3.connect(state)
    connection.execute("UPDATE tree_blob SET data = x'90'")
    connection.commit()
    connection.close()
    before = state.read_bytes()
    code, log = refused("--http-port", "0", *FLAGS, "--state", str(state))
    assert code == 1
    assert any("is damaged (" in entry["event"] for entry in log)
    assert state.read_bytes() == before


@pytest.mark.slow
def test_a_replaced_file_and_lost_commits_are_said(tmp_path: Path) -> None:
    state = tmp_path / "gateway.state"
    with gateway_process(*FLAGS, "--state", str(state)) as (process, url):
        for number in range(3):
            assert send(url, {"setgeometry": [{"path": [str(number)], "geometry": BOX}]})["status"] == 0
        state.rename(tmp_path / "moved")
        assert send(url, {"setgeometry": [{"path": ["later"], "geometry": BOX}]})["status"] == -3
        ready = clients.get(f"{url}/readyz")
        assert (ready.status_code, ready.json()["interfaces"]["state"]["state"]) == (503, "failed")
        (tmp_path / "moved").rename(state)
        assert send(url, {"setgeometry": [{"path": ["at last"], "geometry": BOX}]})["status"] == 0
        assert clients.get(f"{url}/readyz").status_code == 200
        process.process.send_signal(signal.SIGKILL)
        process.process.wait()
    (tmp_path / "gateway.state-wal").write_bytes(b"")
    with gateway_process(*FLAGS, "--state", str(state)) as (process, url):
        described = clients.get(f"{url}/healthz").json()["interfaces"]["state"]
        assert described["warnings"][0].startswith("4 of 4 commits ")
        assert process.stop() == 0
