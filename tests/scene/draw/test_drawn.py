"""Rendering of flattened trees: front faces, labels and instance ids."""

from typing import Any

import numpy as np
import pytest

from gateway.scene.draw.cameras import parse_camera
from gateway.scene.draw.flatten import Flattener
from gateway.scene.draw.viewpoints import resolve_camera
from gateway.scene.tree import transforms as tf
from gateway.scene.tree.geometry import Line, Part, Shape
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import LiveTree
from renderers.drawlist import LABEL_NONE, Material
from renderers.interface import Look, Output
from renderers.raster import CpuRenderer
from scenegate.messages.geometry import Box, Capsule, Cylinder, Ellipsoid, Sphere

ONE_SIDED = Material(base_color=(1, 1, 1, 1), metallic=0.0, roughness=1.0)
ARROW = Line(np.array([(0, 0, -1), (0, 0, 1)], np.float32), 0.2, end_head=True, head_radius=0.5)
BENT = Line(np.array([(-1, 0, 0), (0, 0, 1), (1, 0, 0)], np.float32), 0.2)


@pytest.fixture(scope="module")
def renderer() -> CpuRenderer:
    return CpuRenderer(1)


@pytest.mark.parametrize(
    "shape",
    [Box((1, 2, 1)), Sphere(1), Ellipsoid((1, 2, 0.5)), Cylinder(1, 2), Capsule(0.5, 1), ARROW, BENT],
    ids=lambda shape: type(shape).__name__,
)
@pytest.mark.parametrize("mirror", [1.0, -1.0])
@pytest.mark.parametrize("eye", ["5,2,3", "-4,-3,-2"])
def test_fronts_are_in_front_also_in_a_mirror(renderer: CpuRenderer, shape: Shape, mirror: float, eye: str) -> None:
    """Colour culls back faces, depth does not: wherever depth sees the near side, colour must have drawn it."""
    tree = LiveTree()
    with tree.edit() as edit:
        edit.set_parts(("shape",), (Part(shape, ONE_SIDED),))
        edit.set_matrix(("shape",), tf.scaling(mirror, 1, 1))
    drawn = Flattener(LabelTable()).flatten(tree.snapshot)
    camera = resolve_camera(parse_camera(f"eye={eye};target=0,0,0"), tree.snapshot.root, 80, 60)
    f: Any = renderer.render(drawn, camera, Output.COLOR | Output.DEPTH | Output.NORMAL, Look("phong", (255, 0, 255)))
    seen = np.isfinite(f.depth)
    background = (f.color == (255, 0, 255)).all(axis=2)
    assert seen.sum() > 40
    np.testing.assert_array_equal(seen, ~background)
    row, column = np.nonzero(seen)
    rays = np.stack(((column + 0.5 - camera.cx) / camera.fx, (row + 0.5 - camera.cy) / camera.fy), axis=1)
    towards = (f.normal[seen][:, :2] * rays).sum(axis=1) + f.normal[seen][:, 2]
    assert towards.max() <= 0.05  # smooth normals lean over the silhouette by up to half a facet


def test_labels_and_instance_numbers_lead_back_to_the_path(renderer: CpuRenderer) -> None:
    tree, labels = LiveTree(), LabelTable()
    with tree.edit() as edit:
        for index, name in enumerate(("left", "middle", "right")):
            edit.set_parts((name,), (Part(Sphere(0.4), ONE_SIDED),))
            edit.set_pose((name,), (index - 1.0, 0, 0, 1, 0, 0, 0))
    drawn = Flattener(labels).flatten(tree.snapshot)
    camera = resolve_camera(parse_camera("eye=0,-4,0;target=0,0,0"), tree.snapshot.root, 90, 30)
    frame = renderer.render(drawn, camera, Output.LABEL | Output.INSTANCE, Look())
    at = [int(np.flatnonzero(frame.instance[15] == number).mean()) for number in range(3)]
    assert at == sorted(at)
    assert [labels.path_of(int(frame.label[15, column])) for column in at] == [("left",), ("middle",), ("right",)]
    assert frame.label[0, 0] == LABEL_NONE
    assert [drawn.instances[int(frame.instance[15, c])].label for c in at] == [int(frame.label[15, c]) for c in at]
