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
    GeometryInstance,
    HalfSpace,
    MakeRenderEngineGltfClient,
    MakeRenderEngineVtk,
    Mesh,
    PerceptionProperties,
    RenderCameraCore,
    RenderEngineGltfClientParams,
    RenderEngineVtkParams,
    RenderLabel,
    Rgba,
    SceneGraph,
    Sphere,
)
from pydrake.math import RigidTransform, RollPitchYaw
from pydrake.systems.sensors import CameraInfo

from tests.drake.assets import Gltf, quad, write_obj
from tests.drake.scenes import looking_at


def gltf_of(positions: np.ndarray, path: Path) -> str:
    """Write a glTF file of triangles, (3 N, 3), and return its path."""
    document = Gltf()
    attributes = {"POSITION": positions}
    material = document.matte([0.2, 0.7, 0.3, 1], doubleSided=True)
    document.node(document.mesh(attributes, np.arange(len(positions)), material))
    return str(document.write(path))


def triangle_gltf(folder: Path) -> str:
    return gltf_of(np.array([[-0.2, 0, 0], [0.2, 0, 0], [0, 0.3, 0]]), folder / "triangle.gltf")


def properties(label: int, rgba: list[float] | None) -> PerceptionProperties:
    result = PerceptionProperties()
    if rgba is not None:
        result.AddProperty("phong", "diffuse", Rgba(*rgba))
    result.AddProperty("label", "id", RenderLabel(label))
    return result


def primitives(folder: Path) -> list[tuple[object, RigidTransform, PerceptionProperties]]:
    quad_obj = write_obj(folder / "quad.obj", *quad(0.2, 0.2), "Kd 0.9 0.4 0.1")
    box = RigidTransform(RollPitchYaw(0.2, 0.3, 0.4), [0.0, 0.0, 0.0])
    cylinder = RigidTransform(RollPitchYaw(1.0, 0, 0), [-0.25, 0.0, 0])
    tilted = RigidTransform(RollPitchYaw(0.5, 0, 0), [0.3, 0.3, 0.1])
    return [
        (HalfSpace(), RigidTransform([0, 0, -0.15]), properties(10, [0.6, 0.6, 0.55, 1])),
        (Box(0.2, 0.15, 0.1), box, properties(1, [1, 0.2, 0.2, 1])),
        (Sphere(0.08), RigidTransform([0.25, 0.0, 0.0]), properties(2, [0.2, 1, 0.2, 1])),
        (Cylinder(0.05, 0.2), cylinder, properties(3, [0.2, 0.2, 1, 1])),
        (Capsule(0.05, 0.15), RigidTransform([0.0, 0.25, 0.0]), properties(300, [1, 1, 0.2, 1])),
        (Ellipsoid(0.1, 0.05, 0.07), RigidTransform([0.0, -0.25, 0.0]), properties(4660, [0.2, 1, 1, 1])),
        (Mesh(str(quad_obj), 1.0), tilted, properties(7, None)),
    ]


def build(shapes: list[Any], base_url: str) -> SceneGraph:
    scene_graph = SceneGraph()
    engines = {
        "vtk": MakeRenderEngineVtk(RenderEngineVtkParams()),
        "gateway": MakeRenderEngineGltfClient(RenderEngineGltfClientParams(base_url=base_url)),
    }
    for name, engine in engines.items():
        scene_graph.AddRenderer(name, engine)
    source = scene_graph.RegisterSource("test")
    for index, (shape, pose, props) in enumerate(shapes):
        instance = GeometryInstance(pose, shape, f"shape{index}")
        instance.set_perception_properties(props)
        scene_graph.RegisterAnchoredGeometry(source, instance)
    return scene_graph


def refusal(folder: Path, base_url: str) -> str:
    """Return the message of the error that Drake raises for an image that takes too long; empty if it was rendered.

    Each of the triangles is larger than what the camera "above" sees, and in front of the last.
    """
    count = 50_000
    corners = np.array([[-8, -8, 0], [24, -8, 0], [-8, 24, 0]], np.float32)
    positions = np.repeat(corners[None], count, axis=0)
    positions[:, :, 2] = np.linspace(0.0, 0.5, count)[:, None]
    slow = gltf_of(positions.reshape(-1, 3), folder / "slow.gltf")
    upright = RigidTransform(RollPitchYaw(-np.pi / 2, 0, 0), [0, 0, 0])  # Drake turns glTF's Y to its own Z
    shapes = [
        (Mesh(slow, 1.0), upright, properties(9, None)),
        (Box(0.2, 0.15, 0.1), RigidTransform([0, 0, -1]), properties(1, [1, 0.2, 0.2, 1])),
    ]
    scene_graph = build(shapes, base_url)
    query = scene_graph.get_query_output_port().Eval(scene_graph.CreateDefaultContext())
    try:
        render(query, "gateway", "above")
    except RuntimeError as error:
        return str(error)
    return ""


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


def digests(shapes: list[Any], base_url: str, camera: str) -> list[str]:
    scene_graph = build(shapes, base_url)
    query = scene_graph.get_query_output_port().Eval(scene_graph.CreateDefaultContext())
    rounds = (render(query, "gateway", camera) for _ in range(4))
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
            shapes = primitives(folder)
            if look == "pbr":
                pose = RigidTransform(RollPitchYaw(0.3, 0.2, 0), [0, 0, 0.3])
                shapes.append((Mesh(triangle_gltf(folder), 1.0), pose, properties(9, None)))
            scene_graph = build(shapes, base_url)
            query = scene_graph.get_query_output_port().Eval(scene_graph.CreateDefaultContext())
            for camera in ("front", "offcentre"):
                ours, vtk = (render(query, engine, camera) for engine in ("gateway", "vtk"))
                results["comparisons"][f"{look}/{camera}"] = compare(ours, vtk)
        only = [(Mesh(triangle_gltf(folder), 1.0), RigidTransform(), properties(9, None))]
        scene_graph = build(only, base_url)
        query = scene_graph.get_query_output_port().Eval(scene_graph.CreateDefaultContext())
        try:
            render(query, "gateway", "front")
            results["error"] = ""
        except RuntimeError as error:
            results["error"] = str(error)
    print(json.dumps(results))


if __name__ == "__main__":
    main()
