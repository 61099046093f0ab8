"""Which of several surfaces at a pixel is seen, against the definition: the nearest, of equally near ones the last."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.drawlist import AlphaMode, DrawList, Instance, Material
from renderers.interface import Look, LookName, Output, SampleCount
from renderers.primitives import box
from renderers.raster import CpuRenderer
from renderers.visibility_buffer import Visibility
from tests.renderers.scenes import camera, grid, mesh, sphere

RENDERER, SEVERAL = CpuRenderer(1), CpuRenderer(3)
VIEW = camera(61, 47)
DEPTHS = (2.0, 2.5, 4.0)


def plates(rng: np.random.Generator) -> DrawList:
    """Overlapping plates in few planes, so that ties are frequent: of large triangles, and of some below a pixel."""
    instances = []
    for k in range(10):
        cells = (1, 1, 3, 90)[k % 4]
        z = DEPTHS[rng.integers(0, 3)]
        x, y, width, height = rng.uniform((-1.0, -1.0, 0.5, 0.5), (0.3, 0.3, 1.5, 1.5)) * z / 2.0
        corners = ((x, y, z), (x + width, y, z), (x + width, y + height, z), (x, y + height, z))
        instances.append(Instance(grid(cells, cells, corners), Material(), np.eye(4), k, k))
    return DrawList(tuple(instances))


def values(layer: Visibility) -> tuple[NDArray[np.int32], NDArray[np.float32]]:
    return layer.ids.copy(), layer.inv_z.copy()


@pytest.mark.parametrize("seed", range(8))
def test_layers_of_coplanar_surfaces(seed: int) -> None:
    """Each layer is the first one beyond the previous one; what is not behind another begins with the first."""
    scene = plates(np.random.default_rng(seed))
    seen = []
    for k in range(len(scene.instances)):
        alone = RENDERER.visibility(scene, VIEW, select=np.arange(len(scene.instances)) == k)
        seen.append(values(alone))
    ids, inv_z = (np.stack(arrays) for arrays in zip(*seen, strict=True))
    inv_z = np.where(ids >= 0, inv_z, 0.0)
    order = np.lexsort((-ids, -inv_z), axis=0)
    ids, inv_z = np.take_along_axis(ids, order, 0), np.take_along_axis(inv_z, order, 0)
    layers: list[Visibility] = []
    for number in range(6):
        layer = RENDERER.visibility(scene, VIEW, behind=layers[-1] if layers else None)
        np.testing.assert_array_equal(layer.ids, ids[number])
        np.testing.assert_array_equal(layer.inv_z[layer.ids >= 0], inv_z[number][layer.ids >= 0])
        layers.append(layer)
    assert (ids[4] >= 0).any()
    assert (inv_z[0] == inv_z[1])[ids[1] >= 0].mean() > 0.1, "ties are frequent"
    for number, layer in enumerate(layers):
        front = RENDERER.visibility(scene, VIEW, in_front_of=layer)
        np.testing.assert_array_equal(front.ids, ids[0])
        for later in layers[number + 2 :]:
            between = RENDERER.visibility(scene, VIEW, behind=layer, in_front_of=later)
            inside = later.ids >= 0
            np.testing.assert_array_equal(between.ids[inside], ids[number + 1][inside])
        layer_ids = layer.ids >= 0
        assert layer_ids.any()


TWINS = {
    "tiny triangles": sphere(150, 80),
    "small triangles": sphere(24, 12),
    "large triangles": box(),
    "through the near plane": mesh(((-9, 0, -9), (9, 0, -9), (0, 0, 9), (0, 1, -9)), ((0, 1, 2), (0, 2, 3))),
    "lines": mesh(((-1, -1, 0), (1, 1, 0), (1, -1, 0), (-1, 1, 0.5)), ((0, 1), (2, 3))),
    "points": mesh(((-1, -1, 0), (1, 1, 0), (1, -1, 0), (-1, 1, 0.5)), ((0,), (1,), (2,), (3,))),
}


@pytest.mark.parametrize("name", TWINS)
@pytest.mark.parametrize(("look", "samples"), [("phong", 1), ("phong", 4), ("plain", 8), ("studio", 1), ("studio", 4)])
def test_of_two_identical_things_the_later_one_is_seen(name: str, look: LookName, samples: SampleCount) -> None:
    """As OpenGL's LEQUAL decides: in colour, label and instance, with any number of threads."""
    X = np.eye(4)
    X[2, 3] = 3.0
    red, green = ((1.0, 0.0, 0.0, 1.0), (0.0, 1.0, 0.0, 1.0))

    def instance(color: tuple[float, float, float, float], label: int) -> Instance:
        material = Material(color, unlit=True, double_sided=True, point_size=5.0, line_width=3.0)
        return Instance(TWINS[name], material, X, label, label)

    outputs = Output.COLOR | Output.LABEL | Output.INSTANCE | Output.DEPTH
    both = DrawList((instance(red, 1), instance(green, 2)))
    alone = DrawList((instance(green, 2),))
    seen = RENDERER.render(both, VIEW, outputs, Look(look, samples=samples))
    expected = RENDERER.render(alone, VIEW, outputs, Look(look, samples=samples))
    other = SEVERAL.render(both, VIEW, outputs, Look(look, samples=samples))
    assert seen.label is not None
    assert (seen.label == 2).any()
    for output in ("color", "label", "instance", "depth"):
        np.testing.assert_array_equal(getattr(seen, output), getattr(expected, output))
        assert getattr(seen, output).tobytes() == getattr(other, output).tobytes()


def test_a_translucent_surface_on_an_opaque_one_is_blended_over_it_in_any_order() -> None:
    """Opaque surfaces are drawn first, and translucent ones at the same depth pass the test."""
    X = np.eye(4)
    X[2, 3] = 3.0
    wall = Instance(box(), Material((1.0, 0.0, 0.0, 1.0), unlit=True), X)
    film = Instance(box(), Material((0.0, 0.0, 1.0, 0.5), unlit=True, alpha_mode=AlphaMode.BLEND), X)
    for look in ("phong", "plain"):
        images = []
        for instances in ((wall, film), (film, wall)):
            frame = RENDERER.render(DrawList(instances), VIEW, Output.COLOR, Look(look))
            images.append(frame.color.copy())
        np.testing.assert_array_equal(images[0], images[1])
        assert (images[0][VIEW.height // 2, VIEW.width // 2] == (128, 0, 128)).all()


@pytest.mark.parametrize("seed", range(8))
def test_coplanar_fronts_and_backs(seed: int) -> None:
    """Colour culls back faces, labels do not: drawn together, fronts come before backs, and still the last wins."""
    rng = np.random.default_rng(seed)
    instances = tuple(
        replace(instance, mesh=replace(instance.mesh, elements=instance.mesh.elements[:, ::-1].copy()))
        if rng.random() < 0.5
        else instance
        for instance in plates(rng).instances
    )
    scene = DrawList(instances)
    seen = RENDERER.visibility(scene, VIEW)
    frame = RENDERER.render(scene, VIEW, Output.COLOR | Output.INSTANCE, Look())
    first = np.searchsorted(seen.first_ids, seen.ids, side="right") - 1
    np.testing.assert_array_equal(frame.instance, np.where(seen.ids >= 0, first, -1))
