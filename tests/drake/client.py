"""Run by an interpreter that has pydrake: renders through a running gateway and through RenderEngineVtk, compares.

    python -m tests.drake.client BASE_URL            compares all views
    python -m tests.drake.client BASE_URL CAMERA     renders one camera again and again
    python -m tests.drake.client BASE_URL slow       renders 50,000 triangles that each fill the picture; prints the
                                                     exception

Prints one JSON document.
"""

import hashlib
import json
import sys
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import (
    Box,
    Capsule,
    ClippingRange,
    ColorRenderCamera,
    Cylinder,
    DepthRange,
    DepthRenderCamera,
    Ellipsoid,
    HalfSpace,
    Mesh,
    RenderCameraCore,
    RenderLabel,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.sensors import CameraInfo

from tests.drake.assets import Gltf, quad, write_obj
from tests.drake.capture import scene_graph_of
from tests.drake.scenes import Body, gltf, looking_at


def gltf_of(positions: np.ndarray, folder: Path, name: str) -> Mesh:
    """Write a glTF file of triangles, (3 N, 3)."""
    document = Gltf()
    attributes = {"POSITION": positions}
    material = document.matte([0.2, 0.7, 0.3, 1], doubleSided=True)
    document.node(document.mesh(attributes, np.arange(len(positions)), material))
    return gltf(folder, document, name)


def triangle(folder: Path) -> Mesh:
    return gltf_of(np.array([[-0.2, 0, 0], [0.2, 0, 0], [0, 0.3, 0]]), folder, "triangle")


def primitives(folder: Path) -> list[Body]:
    quad_obj = write_obj(folder / "quad.obj", *quad(0.2, 0.2), "Kd 0.9 0.4 0.1")
    return [
        Body(HalfSpace(), (0, 0, -0.15), diffuse=(0.6, 0.6, 0.55, 1), label=10),
        Body(Box(0.2, 0.15, 0.1), roll_pitch_yaw=(0.2, 0.3, 0.4), diffuse=(1, 0.2, 0.2, 1), label=1),
        Body(Sphere(0.08), (0.25, 0, 0), diffuse=(0.2, 1, 0.2, 1), label=2),
        Body(Cylinder(0.05, 0.2), (-0.25, 0, 0), (1, 0, 0), diffuse=(0.2, 0.2, 1, 1), label=3),
        Body(Capsule(0.05, 0.15), (0, 0.25, 0), diffuse=(1, 1, 0.2, 1), label=300),
        Body(Ellipsoid(0.1, 0.05, 0.07), (0, -0.25, 0), diffuse=(0.2, 1, 1, 1), label=4660),
        Body(Mesh(str(quad_obj), 1.0), (0.3, 0.3, 0.1), (0.5, 0, 0), label=7),
    ]


def refusal(folder: Path, base_url: str) -> str:
    """Return the message of the error that Drake raises for an image that takes too long.

    Each of the triangles is larger than what the camera "above" sees, and in front of the last.
    """
    count = 50_000
    corners = np.array([[-8, -8, 0], [24, -8, 0], [-8, 24, 0]], np.float32)
    positions = np.repeat(corners[None], count, axis=0)
    positions[:, :, 2] = np.linspace(0.0, 0.5, count)[:, None]
    slow = gltf_of(positions.reshape(-1, 3), folder, "slow")
    upright = (-np.pi / 2, 0, 0)  # Drake turns glTF's Y to its own Z
    box = Body(Box(0.2, 0.15, 0.1), (0, 0, -1), diffuse=(1, 0.2, 0.2, 1))
    return error_of([Body(slow, roll_pitch_yaw=upright), box], base_url, "above")


def error_of(bodies: list[Body], base_url: str, camera: str) -> str:
    """Return the message of the error that Drake raises for an image; empty if it was rendered."""
    scene_graph = scene_graph_of(bodies, base_url)
    try:
        render(query_of(scene_graph), "client", camera)
    except RuntimeError as error:
        return str(error)
    return ""


def query_of(scene_graph: SceneGraph) -> Any:
    """Return a query, which does not keep the scene graph alive."""
    return scene_graph.get_query_output_port().Eval(scene_graph.CreateDefaultContext())


CAMERAS = {
    "front": (CameraInfo(640, 480, np.pi / 4), looking_at([0.9, -0.9, 0.6], [0, 0, 0])),
    "above": (CameraInfo(1024, 1024, np.pi / 4), RigidTransform(RollPitchYaw(np.pi, 0, 0), [0, 0, 3])),
    "offcentre": (CameraInfo(320, 200, 260.0, 240.0, 150.5, 110.0), looking_at([-0.7, 0.5, 0.5], [0, 0, 0])),
}


def render(query: Any, engine: str, camera: str) -> dict[str, np.ndarray]:
    info, X_WC = CAMERAS[camera]
    core = RenderCameraCore(engine, info, ClippingRange(0.01, 10.0), RigidTransform())
    world = SceneGraph.world_frame_id()
    color = query.RenderColorImage(ColorRenderCamera(core, False), world, X_WC)
    depth = query.RenderDepthImage(DepthRenderCamera(core, DepthRange(0.05, 5.0)), world, X_WC)
    label = query.RenderLabelImage(ColorRenderCamera(core, False), world, X_WC)
    return {"color": color.data[..., :3].copy(), "depth": depth.data[..., 0].copy(), "label": label.data[..., 0].copy()}


def digests(bodies: list[Body], base_url: str, camera: str) -> list[str]:
    scene_graph = scene_graph_of(bodies, base_url)
    query = query_of(scene_graph)
    rounds = (render(query, "client", camera) for _ in range(4))
    return [
        hashlib.sha256(b"".join(images[kind].tobytes() for kind in sorted(images))).hexdigest() for images in rounds
    ]


def compare(ours: dict[str, np.ndarray], vtk: dict[str, np.ndarray]) -> dict[str, float]:
    """Fractions of values beyond the limits of Drake's own integration test: 20/255, 1 mm (inf as 0), equal labels."""
    color = np.abs(ours["color"].astype(int) - vtk["color"].astype(int)) > 20
    finite = [np.where(np.isfinite(image["depth"]), image["depth"], 0) for image in (ours, vtk)]
    expected = np.where(vtk["label"] == int(RenderLabel.kEmpty), int(RenderLabel.kDontCare), vtk["label"])
    return {
        "color": float(color.mean()),
        "depth": float((np.abs(finite[0] - finite[1]) > 1e-3).mean()),
        "label": float((ours["label"] != expected).mean()),
        "covered": float((expected != int(RenderLabel.kDontCare)).mean()),
    }


def main() -> None:
    base_url = sys.argv[1]
    results: dict[str, Any] = {"comparisons": {}}
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        if sys.argv[2:] == ["slow"]:
            print(json.dumps(refusal(folder, base_url)))
            return
        if len(sys.argv) > 2:
            print(json.dumps(digests(primitives(folder), base_url, sys.argv[2])))
            return
        for look in ("phong", "pbr"):
            bodies = primitives(folder)
            if look == "pbr":
                bodies.append(Body(triangle(folder), (0, 0, 0.3), (0.3, 0.2, 0), label=9))
            scene_graph = scene_graph_of(bodies, base_url)
            query = query_of(scene_graph)
            for camera in ("front", "offcentre"):
                ours, vtk = (render(query, engine, camera) for engine in ("client", "vtk"))
                results["comparisons"][f"{look}/{camera}"] = compare(ours, vtk)
        results["error"] = error_of([Body(triangle(folder))], base_url, "front")
    print(json.dumps(results))


if __name__ == "__main__":
    main()
