"""Which of several surfaces at a pixel is seen, against the definition: the nearest, of equally near ones the first."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.drawlist import DrawList, Instance, Material
from renderers.interface import Look, Output
from renderers.raster import CpuRenderer
from renderers.visibility_buffer import Visibility
from tests.renderers.scenes import camera, grid

RENDERER = CpuRenderer(1)
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
    """Each layer is the first one beyond the previous one; the layers before another are the same from the front."""
    scene = plates(np.random.default_rng(seed))
    seen = []
    for k in range(len(scene.instances)):
        with RENDERER.visibility(scene, VIEW, select=np.arange(len(scene.instances)) == k) as alone:
            seen.append(values(alone))
    ids, inv_z = (np.stack(arrays) for arrays in zip(*seen, strict=True))
    inv_z = np.where(ids >= 0, inv_z, 0.0)
    order = np.lexsort((ids, -inv_z), axis=0)
    ids, inv_z = np.take_along_axis(ids, order, 0), np.take_along_axis(inv_z, order, 0)
    layers: list[Visibility] = []
    for number in range(6):
        layer = RENDERER.visibility(scene, VIEW, beyond=layers[-1] if layers else None)
        np.testing.assert_array_equal(layer.ids, ids[number])
        np.testing.assert_array_equal(layer.inv_z[layer.ids >= 0], inv_z[number][layer.ids >= 0])
        layers.append(layer)
    assert (ids[4] >= 0).any()
    assert (inv_z[0] == inv_z[1])[ids[1] >= 0].mean() > 0.1, "ties are frequent"
    for number, layer in enumerate(layers):
        with RENDERER.visibility(scene, VIEW, before=layer) as front:
            # Where nothing is seen, everything is before it.
            nothing = layer.ids < 0
            np.testing.assert_array_equal(front.ids[nothing], ids[0][nothing])
            np.testing.assert_array_equal(front.ids[~nothing], ids[0][~nothing] if number else -1)
        for later in layers[number + 2 :]:
            with RENDERER.visibility(scene, VIEW, beyond=layer, before=later) as between:
                inside = later.ids >= 0
                np.testing.assert_array_equal(between.ids[inside], ids[number + 1][inside])
        layer_ids = layer.ids >= 0
        assert layer_ids.any()
    for layer in layers:
        layer.close()


@pytest.mark.parametrize("seed", range(8))
def test_coplanar_fronts_and_backs(seed: int) -> None:
    """Colour culls back faces, labels do not: drawn together, fronts come before backs, and still the first wins."""
    rng = np.random.default_rng(seed)
    instances = tuple(
        replace(instance, mesh=replace(instance.mesh, elements=instance.mesh.elements[:, ::-1].copy()))
        if rng.random() < 0.5
        else instance
        for instance in plates(rng).instances
    )
    scene = DrawList(instances)
    with (
        RENDERER.visibility(scene, VIEW) as seen,
        RENDERER.render(scene, VIEW, Output.COLOR | Output.INSTANCE, Look()) as frame,
    ):
        first = np.searchsorted(seen.first_ids, seen.ids, side="right") - 1
        np.testing.assert_array_equal(frame.instance, np.where(seen.ids >= 0, first, -1))
