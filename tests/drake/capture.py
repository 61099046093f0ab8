"""Run by an interpreter that has pydrake: records what Drake's client posts, and what RenderEngineVtk draws instead.

    python -m tests.drake.capture FOLDER [STEP]      all scenes, or one of STEP and those with vertex colours

FOLDER/NAME gets, for each of color, depth and label, the posted scene (``color.gltf``) and form fields
(``color.json``), and RenderEngineVtk's image: ``color.png``, ``depth.npy`` (float32, metres), ``label.npy`` (int16).
``color_copy.png`` is the colour image of a copy of the context, for which RenderEngineVtk draws in another order.
"""

import email
import email.policy
import json
import multiprocessing
import shutil
import sys
import tempfile
from collections.abc import Callable, Iterable, Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import numpy as np
from pydrake.geometry import (
    Box,
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    GeometryInstance,
    MakeRenderEngineGltfClient,
    MakeRenderEngineVtk,
    PerceptionProperties,
    RenderCameraCore,
    RenderEngineGltfClientParams,
    RenderEngineVtkParams,
    RenderLabel,
    Rgba,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.systems.sensors import CameraInfo

from tests.drake.assets import png
from tests.drake.scenes import SCENES, Body, Scene


class Recorder(BaseHTTPRequestHandler):
    """Answers a posted scene with a black image, and writes it into the folder."""

    folder: Path

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        head = f"Content-Type: {self.headers['Content-Type']}\r\n\r\n".encode()
        message: Any = email.message_from_bytes(head + body, policy=email.policy.HTTP)
        form = {
            part.get_param("name", header="content-disposition"): part.get_payload(decode=True)
            for part in message.iter_parts()
        }
        self.write(form["image_type"].decode(), form, body)
        answer = png(np.zeros((int(form["height"]), int(form["width"]), 3), np.uint8))
        self.send_response(200)
        self.send_header("Content-Type", "image/png")
        self.send_header("Content-Length", str(len(answer)))
        self.end_headers()
        self.wfile.write(answer)

    def write(self, kind: str, form: dict[str, bytes], body: bytes) -> None:
        fields = {field: value.decode() for field, value in form.items() if field != "scene"}
        (self.folder / f"{kind}.json").write_text(json.dumps(fields, indent=1) + "\n")
        (self.folder / f"{kind}.gltf").write_bytes(form["scene"])

    def log_message(self, *_: Any) -> None:
        """Keep quiet."""


def record(recorder: type[Recorder], names: Iterable[str], capture: Callable[[str, Path, str], None]) -> Iterator[Path]:
    """Yield for each name a folder with what ``capture(name, folder, base_url)`` writes and posts; then empty it."""
    with tempfile.TemporaryDirectory() as incoming:
        folder = recorder.folder = Path(incoming)
        server = ThreadingHTTPServer(("127.0.0.1", 0), recorder)
        # A process of its own, since Drake's client holds the interpreter's lock while it waits for an image.
        process = multiprocessing.get_context("fork").Process(target=server.serve_forever, daemon=True)
        process.start()
        for name in names:
            capture(name, folder, f"http://127.0.0.1:{server.server_port}")
            yield folder
            for file in folder.iterdir():
                file.unlink()
        process.terminate()


def properties(body: Body, label: int) -> PerceptionProperties:
    result = PerceptionProperties()
    if body.diffuse is not None:
        result.AddProperty("phong", "diffuse", Rgba(*body.diffuse))
    if body.diffuse_map is not None:
        result.AddProperty("phong", "diffuse_map", str(body.diffuse_map))
    result.AddProperty("label", "id", RenderLabel(label))
    return result


HIDDEN = Body(Box(0.01, 0.01, 0.01), (0.0, -50.0, 0.0))
"""A body out of sight: the client sends no camera where all is glTF."""


def add_engines(scene_graph: SceneGraph, base_url: str) -> None:
    scene_graph.AddRenderer("vtk", MakeRenderEngineVtk(RenderEngineVtkParams()))
    scene_graph.AddRenderer("client", MakeRenderEngineGltfClient(RenderEngineGltfClientParams(base_url=base_url)))


def register(scene_graph: SceneGraph, bodies: Iterable[Body]) -> None:
    source = scene_graph.RegisterSource("test")
    for index, body in enumerate(bodies):
        instance = GeometryInstance(body.pose, body.shape, f"body{index}")
        instance.set_perception_properties(properties(body, body.label or index + 1))
        scene_graph.RegisterAnchoredGeometry(source, instance)


def scene_graph_of(bodies: Iterable[Body], base_url: str) -> SceneGraph:
    scene_graph = SceneGraph()
    add_engines(scene_graph, base_url)
    register(scene_graph, bodies)
    return scene_graph


def image(query: Any, engine: str, kind: str, scene: Scene) -> Any:
    """Return the image of an engine; the recorder's answers cannot be read as depth and label images."""
    core = RenderCameraCore(
        engine, CameraInfo(*scene.size, np.pi / 4), ClippingRange(0.01, scene.far), RigidTransform()
    )
    view = SceneGraph.world_frame_id(), scene.camera_pose
    if kind == "depth":
        return query.RenderDepthImage(DepthRenderCamera(core, DepthRange(0.05, scene.far)), *view).data[..., 0]
    render = query.RenderColorImage if kind == "color" else query.RenderLabelImage
    pixels = render(ColorRenderCamera(core, False), *view).data
    return pixels[..., :3] if kind == "color" else pixels[..., 0]


def capture(name: str, folder: Path, base_url: str) -> None:
    with tempfile.TemporaryDirectory() as files:
        scene = SCENES[name](Path(files))
        scene_graph = scene_graph_of([*scene.bodies, HIDDEN], base_url)  # a query does not keep it alive
        context = scene_graph.CreateDefaultContext()
        query, copy = (scene_graph.get_query_output_port().Eval(each) for each in (context, context.Clone()))
        (folder / "color_copy.png").write_bytes(png(image(copy, "vtk", "color", scene)))
        (folder / "color.png").write_bytes(png(image(query, "vtk", "color", scene)))
        for kind in ("label", "depth"):
            np.save(folder / f"{kind}.npy", image(query, "vtk", kind, scene))
        image(query, "client", "color", scene)
        try:
            for kind in ("label", "depth"):
                image(query, "client", kind, scene)
        except RuntimeError as error:
            if not (folder / "depth.gltf").exists():
                raise SystemExit(f"{name}: {error}") from error


def main() -> None:
    folder, step = Path(sys.argv[1]), int(sys.argv[2]) if len(sys.argv) > 2 else 1
    names = [name for number, name in enumerate(SCENES) if number % step == 0 or name.startswith("vertex_")]
    for name, captured in zip(names, record(Recorder, names, capture), strict=True):
        shutil.copytree(captured, folder / name, dirs_exist_ok=True)


if __name__ == "__main__":
    main()
