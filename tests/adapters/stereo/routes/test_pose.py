"""The place of a camera over HTTP."""

import numpy as np
from fastapi import FastAPI
from fastapi.testclient import TestClient

from gateway.adapters.stereo.imaging.scene_view import SceneView
from gateway.adapters.stereo.routes.camera_routes import pose_router
from gateway.scene.draw.flatten import Flattener
from gateway.scene.draw.mount import Mount, parse_mount_pose
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.transforms import translation

TEXT = "eye=2,0,1;target=1,0,1;up=0,0,1"


def test_a_camera_is_placed_and_its_pose_is_text() -> None:
    views = {
        name: SceneView(LiveTree(), Flattener(LabelTable()), mount)
        for name, mount in (("stereo", Mount(np.eye(4))), ("wrist", Mount(translation(1, 2, 3), ("hand",))))
    }
    app = FastAPI()
    app.include_router(pose_router(views))
    client = TestClient(app)
    assert client.get("/cameras/0/pose").json() == {"pose": "eye=0,0,0;target=0,0,1;up=0,-1,0"}
    placed = client.put("/cameras/stereo/pose", params={"pose": TEXT})
    assert (placed.status_code, placed.json()) == (200, {"pose": TEXT})
    np.testing.assert_allclose(views["stereo"].state().X_world_left, parse_mount_pose(TEXT))
    assert client.get("/cameras/1/pose").json() == {"pose": "eye=1,2,3;target=1,2,4;up=0,-1,0"}
    refusals = {("stereo", "eye=1,2"): 400, ("1", TEXT): 409, ("9", TEXT): 404, ("x", TEXT): 404}
    for (name, pose), status in refusals.items():
        response = client.put(f"/cameras/{name}/pose", params={"pose": pose})
        assert response.status_code == status, response.text
        assert response.json()["message"]
