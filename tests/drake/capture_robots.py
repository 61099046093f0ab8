"""Run by an interpreter that has pydrake: records requests and RenderEngineVtk's images of Drake's own robots.

    python -m tests.drake.capture_robots FOLDER MODELS SUFFIX [NAME ..]

MODELS is a checkout of RobotLocomotion/models. ``FOLDER/NAME_SUFFIX`` gets the posted bodies (``color.multipart.xz``
and ``color.ctype``, likewise depth and label) and ``vtk.npz`` with RenderEngineVtk's color, depth and label.
"""

import lzma
import shutil
import sys
from functools import partial
from pathlib import Path

import numpy as np
from pydrake.geometry import (
    ClippingRange,
    ColorRenderCamera,
    DepthRange,
    DepthRenderCamera,
    RenderCameraCore,
    SceneGraph,
)
from pydrake.math import RigidTransform
from pydrake.multibody.parsing import Parser
from pydrake.multibody.plant import AddMultibodyPlantSceneGraph
from pydrake.systems.framework import DiagramBuilder
from pydrake.systems.sensors import CameraInfo

from tests.drake.capture import HIDDEN, Recorder, add_engines, record, register
from tests.drake.scenes import looking_at

Vector = tuple[float, float, float]

ROBOTS: dict[str, tuple[str, Vector, Vector]] = {
    "allegro": ("allegro_hand_description/sdf/allegro_hand_description_right.sdf", (0.35, 0.25, 0.2), (0, 0, 0.05)),
    "atlas": ("atlas/atlas_convex_hull.urdf", (2.2, 1.6, 0.6), (0, 0, 0)),
    "d415": ("realsense2_description/urdf/d415.urdf", (0.15, 0.1, 0.08), (0, 0, 0)),
    "dishes": ("dishes/evo_bowl.sdf", (0.5, 0.5, 0.4), (0, 0, 0)),
    "franka": ("franka_description/urdf/panda_arm_hand.urdf", (1.4, 1.0, 0.9), (0.2, 0, 0.5)),
    "homecart": ("tri_homecart/homecart_bimanual.urdf", (2.5, 1.8, 1.6), (0, 0, 0.8)),
    "iiwa": ("iiwa_description/sdf/iiwa7_no_collision.sdf", (1.4, 1.0, 0.9), (0, 0, 0.6)),
    "jaco": ("jaco_description/urdf/j2s7s300.urdf", (1.2, 1.0, 0.9), (0, 0, 0.5)),
    "pr2": ("pr2_description/urdf/pr2_simplified.urdf", (2.5, 1.8, 1.6), (0, 0, 0.8)),
    "skydio": ("skydio_2/quadrotor.urdf", (0.4, 0.3, 0.25), (0, 0, 0)),
    "tea": ("tutorials/models/tea_set.sdf", (0.5, 0.5, 0.4), (0, 0, 0.05)),
    "ur3e": ("ur_description/urdf/ur3e_cylinders_collision.urdf", (1.0, 0.8, 0.6), (0, 0, 0.2)),
    "wsg": ("wsg_50_description/sdf/schunk_wsg_50_with_tip.sdf", (0.3, 0.25, 0.2), (0, 0.05, 0)),
}
"""File, position of the camera and the point that it looks at, by name."""


class BodyRecorder(Recorder):
    """Writes the body of a request as it was received."""

    def write(self, kind: str, form: dict[str, bytes], body: bytes) -> None:
        (self.folder / f"{kind}.multipart.xz").write_bytes(lzma.compress(body))
        (self.folder / f"{kind}.ctype").write_text(self.headers["Content-Type"])


def capture(models: Path, name: str, folder: Path, base_url: str) -> None:
    """Record the three requests and images of a robot, in the joint positions of its file."""
    file, eye, target = ROBOTS[name]
    builder = DiagramBuilder()
    plant, scene_graph = AddMultibodyPlantSceneGraph(builder, 0.0)
    parser = Parser(plant)
    parser.package_map().Remove("drake_models")
    parser.package_map().Add("drake_models", str(models))
    (model,) = parser.AddModels(str(models / file))
    base = plant.get_body(plant.GetBodyIndices(model)[0])
    if not plant.GetBodiesWeldedTo(plant.world_body())[1:]:
        plant.WeldFrames(plant.world_frame(), base.body_frame())
    plant.Finalize()
    register(scene_graph, [HIDDEN])
    add_engines(scene_graph, base_url)
    diagram = builder.Build()
    query = scene_graph.get_query_output_port().Eval(scene_graph.GetMyContextFromRoot(diagram.CreateDefaultContext()))
    images = {}
    for engine in ("vtk", "client"):
        core = RenderCameraCore(engine, CameraInfo(640, 480, np.pi / 4), ClippingRange(0.01, 10), RigidTransform())
        view = (SceneGraph.world_frame_id(), looking_at(eye, target))
        for kind, render, camera in (
            ("color", query.RenderColorImage, ColorRenderCamera(core, False)),
            ("label", query.RenderLabelImage, ColorRenderCamera(core, False)),
            ("depth", query.RenderDepthImage, DepthRenderCamera(core, DepthRange(0.05, 10))),
        ):
            try:
                image = render(camera, *view).data
            except RuntimeError:  # the recorder's answers are no depth and label images
                if not (folder / f"{kind}.ctype").exists():
                    raise
            else:
                images[engine, kind] = image
    color, depth, label = (images["vtk", kind] for kind in ("color", "depth", "label"))
    np.savez_compressed(folder / "vtk.npz", color=color[..., :3], depth=depth[..., 0], label=label[..., 0])


def main() -> None:
    folder, models, suffix, names = Path(sys.argv[1]), Path(sys.argv[2]).resolve(), sys.argv[3], sys.argv[4:]
    names = names or list(ROBOTS)
    for name, captured in zip(names, record(BodyRecorder, names, partial(capture, models)), strict=True):
        shutil.copytree(captured, folder / f"{name}_{suffix}", dirs_exist_ok=True)


if __name__ == "__main__":
    main()
