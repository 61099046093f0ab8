"""A frame with all outputs equals separate frames, although colour culls back faces and geometry does not."""

from dataclasses import replace

import numpy as np
import pytest

from renderers.camera import Camera
from renderers.drawlist import DrawList, Instance, Material, Mesh
from renderers.interface import Look, Output
from renderers.raster import CpuRenderer
from tests.renderers.scenes import images
from tests.renderers.shading.reference import ball, placed, quad

GEOMETRY = Output.DEPTH | Output.LABEL | Output.INSTANCE | Output.NORMAL


def views() -> list[Camera]:
    """From outside and from within, where triangles are clipped; odd and even widths."""
    inside = np.eye(4)
    inside[2, 3] = -2.6
    outside = np.eye(4)
    return [
        Camera(96, 131, 80.0, 80.0, 48.0, 65.0, 0.05, 50.0, outside),
        Camera(61, 300, 50.0, 200.0, 30.0, 150.0, 0.05, 50.0, inside),
    ]


def scene(seed: int) -> DrawList:
    """Single- and double-sided triangle soups, some mirrored; closed balls; coplanar walls of opposite facing."""
    rng = np.random.default_rng(seed)
    instances = []
    for k in range(8):
        count = 40
        size = float(rng.choice((0.03, 0.2, 0.6)))
        corners = rng.uniform(-1.2, 1.2, (count, 1, 3)) + rng.normal(scale=size, size=(count, 3, 3))
        mesh = Mesh(corners.reshape(-1, 3).astype(np.float32), np.arange(3 * count, dtype=np.uint32).reshape(-1, 3))
        X = np.diag((1.0, -1.0 if k % 3 == 0 else 1.0, 1.0, 1.0))
        X[2, 3] = 3.0
        instances.append(Instance(mesh, Material((*rng.random(3), 1.0), double_sided=k % 4 == 3), X, k, k))
    instances.append(replace(placed(ball(12, 0.7), Material((1.0, 0.5, 0.2, 1.0)), z=3.0), label=100, instance_id=100))
    for k, cells in enumerate((8, 60)):  # bowls, of large triangles and of some that hold a pixel or none
        bowl = ball(cells, 0.6)
        low = bowl.positions[bowl.elements].mean(axis=1)[:, 1] > -0.1
        open_above = replace(bowl, elements=np.ascontiguousarray(bowl.elements[low]))
        X = np.eye(4)
        X[:3, 3] = 0.5 - k, 0.4, 2.2
        instances.append(Instance(open_above, Material((0.1, 0.9, 0.3, 1.0)), X, 101 + k, 101 + k))
    wall = quad(1.0, 4.0)
    away = replace(wall, elements=np.ascontiguousarray(wall.elements[:, ::-1]))
    for k, mesh in enumerate((away, wall, away)):
        instances.append(replace(placed(mesh, Material((0.2, 0.4, 0.9, 1.0))), label=200 + k, instance_id=200 + k))
    return DrawList(tuple(instances))


@pytest.mark.parametrize("threads", [1, 3])
@pytest.mark.parametrize("seed", range(3))
def test_outputs_equal_those_of_separate_frames(seed: int, threads: int) -> None:
    renderer = CpuRenderer(threads)
    drawn = scene(seed)
    for camera in views():
        together = renderer.render(drawn, camera, GEOMETRY | Output.COLOR, Look())
        geometry = renderer.render(drawn, camera, GEOMETRY)
        color = renderer.render(drawn, camera, Output.COLOR, Look())
        expected = images(geometry) | images(color)
        assert images(together).keys() == expected.keys()
        for name, image in images(together).items():
            np.testing.assert_array_equal(image, expected[name], err_msg=name)
        # The scene shows both: what only geometry sees, and the nearest of surfaces in one place.
        both_sided = replace_sides(drawn)
        other = renderer.render(both_sided, camera, Output.COLOR, Look())
        assert (images(other)["color"] != expected["color"]).any()
    renderer.close()


def replace_sides(drawn: DrawList) -> DrawList:
    return DrawList(tuple(replace(i, material=replace(i.material, double_sided=True)) for i in drawn.instances))


def test_coplanar_faces_label_of_the_last_and_color_of_the_front() -> None:
    wall = quad(2.0, 3.0)
    away = replace(wall, elements=np.ascontiguousarray(wall.elements[:, ::-1]))
    red, green = Material((1.0, 0.0, 0.0, 1.0)), Material((0.0, 1.0, 0.0, 1.0))
    drawn = DrawList((replace(placed(wall, green), label=2), replace(placed(away, red), label=1)))
    camera = Camera(40, 40, 40.0, 40.0, 20.0, 20.0, 0.05, 50.0, np.eye(4))
    renderer = CpuRenderer(1)
    frame = renderer.render(drawn, camera, Output.COLOR | Output.LABEL, Look())
    assert frame.color is not None
    assert frame.label is not None
    assert (frame.label == 1).all()
    assert (frame.color == (0, 255, 0)).all()
