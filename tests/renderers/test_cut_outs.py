"""What is cut out of depth, label, instance and normal images: the same as of the colour image."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray

from renderers.drawlist import AlphaMode, DrawList, Image, Instance, Material, Mesh, Sampler, Texture
from renderers.interface import Look, LookName, Output, SampleCount
from renderers.raster import CpuRenderer
from tests.renderers.scenes import camera, images

RENDERER, SEVERAL = CpuRenderer(1), CpuRenderer(3)
GEOMETRY = Output.DEPTH | Output.LABEL | Output.INSTANCE | Output.NORMAL
VIEW = camera(61, 47)
UNFILTERED = Sampler(mag_linear=False, min_linear=False, mipmaps=False)


def leaf(z: float, material: Material, label: int, tilt: float = 0.0) -> Instance:
    """A square of 2 m before the camera, with texture coordinates from 0 to 1."""
    positions = np.array(((-1, -1, z), (1, -1, z + tilt), (1, 1, z), (-1, 1, z - tilt)), np.float32)
    uv = np.array(((0, 0), (1, 0), (1, 1), (0, 1)), np.float32)
    mesh = Mesh(positions, np.array(((0, 1, 2), (0, 2, 3)), np.uint32), uv0=uv)
    return Instance(mesh, material, np.eye(4), label, 10 * label)


def painted(
    red: float, green: float, blue: float, alpha: NDArray[np.uint8] | None = None, **changes: object
) -> Material:
    """An unlit material whose texture, if there is one, has this alpha."""
    material = Material((red, green, blue, 1.0), unlit=True, double_sided=True)
    if alpha is not None:
        pixels = np.full((*alpha.shape, 4), 255, np.uint8)
        pixels[..., 3] = alpha
        texture = Texture(Image(alpha.tobytes(), lambda: pixels), UNFILTERED)
        material = replace(material, base_color_texture=texture, alpha_mode=AlphaMode.MASK)
    return replace(material, **changes)  # type: ignore[arg-type]  # fields of several types


def trees() -> DrawList:
    """Three leaves with holes before one another and before a wall."""
    rng = np.random.default_rng(4)
    leaves = [
        leaf(2.0 + k, painted(*color, alpha=rng.integers(0, 256, (8, 8), np.uint8)), k + 1, 0.2)
        for k, color in enumerate(((1, 0, 0), (0, 1, 0), (0, 0, 1)))
    ]
    return DrawList((*leaves, leaf(5.0, painted(1, 1, 1), 4)))


@pytest.mark.parametrize("look", ["plain", "gltf", "studio"])
def test_labels_follow_the_holes_of_the_colour_image(look: LookName) -> None:
    scene = trees()
    frame = RENDERER.render(scene, VIEW, Output.COLOR | GEOMETRY, Look(look, (0, 0, 0)))
    seen = {name: image.copy() for name, image in images(frame).items()}
    for label, channels in ((1, (1, 0, 0)), (2, (0, 1, 0)), (3, (0, 0, 1)), (4, (1, 1, 1))):
        pixels = seen["label"] == label
        assert pixels.sum() > 20
        np.testing.assert_array_equal(seen["color"][pixels] > 0, np.tile(channels, (pixels.sum(), 1)))
        assert (seen["instance"][pixels] == 10 * label).all()
        assert (np.abs(seen["depth"][pixels] - (1 + label)) < 0.3).all()
        assert (seen["normal"][pixels][:, 2] < -0.9).all()
    for renderer, outputs in ((RENDERER, GEOMETRY), (RENDERER, Output.LABEL), (SEVERAL, GEOMETRY)):
        frame = renderer.render(scene, VIEW, outputs, Look(look))
        for name, image in images(frame).items():
            assert image.tobytes() == seen[name].tobytes(), name


@pytest.mark.parametrize("look", ["phong", "pbr"])
@pytest.mark.parametrize("samples", [1, 4])
def test_rendervtk_cuts_nothing_out_of_labels(look: LookName, samples: SampleCount) -> None:
    frame = RENDERER.render(trees(), VIEW, Output.COLOR | Output.LABEL, Look(look, samples=samples))
    assert 4 not in frame.label
    assert (frame.label == 1).sum() > 500


@pytest.mark.parametrize(("threshold", "label"), [(0.0, 1), (0.29, 1), (0.3, 1), (0.31, 2), (1.0, 2)])
def test_the_threshold_decides_whether_a_blended_surface_has_a_label(threshold: float, label: int) -> None:
    film = leaf(2.0, painted(1, 0, 0, base_color=(1.0, 0.0, 0.0, 0.3), alpha_mode=AlphaMode.BLEND), 1)
    scene = DrawList((film, leaf(3.0, painted(1, 1, 1), 2)))
    frame = RENDERER.render(scene, VIEW, GEOMETRY, Look("gltf", alpha_threshold=threshold))
    assert frame.label[20, 30] == label
    assert frame.depth[20, 30] == 1 + label


def test_a_leaf_that_is_cut_out_everywhere_is_nowhere() -> None:
    scene = DrawList((leaf(2.0, painted(1, 0, 0, alpha=np.zeros((2, 2), np.uint8)), 1),))
    frame = RENDERER.render(scene, VIEW, GEOMETRY, Look("gltf"))
    assert frame.depth is not None
    assert np.isinf(frame.depth).all()


@pytest.mark.parametrize("look", ["phong", "plain", "gltf"])
@pytest.mark.parametrize("top", [-0.2, 4.0])
def test_a_see_through_instance_changes_only_the_bands_that_it_touches(look: LookName, top: float) -> None:
    """A band of glass and leaves at a height in the view, or beside it; another with alpha 0 in all of it."""
    view, solid = camera(160, 240), leaf(5.0, painted(0.2, 0.6, 0.4), 1, 0.7)
    low = np.eye(4)
    low[:3, 3], low[1, 1] = (0.0, top, 0.0), 0.1
    holes = np.random.default_rng(4).integers(0, 256, (8, 8), np.uint8)
    glass = replace(leaf(3.0, painted(0.9, 0.1, 0.1), 2), X_world_mesh=low)
    glass = replace(
        glass, material=replace(glass.material, base_color=(0.9, 0.1, 0.1, 0.4), alpha_mode=AlphaMode.BLEND)
    )
    cut = replace(leaf(3.5, painted(0.1, 0.1, 0.9, holes), 3), X_world_mesh=low)
    unseen = leaf(2.0, replace(glass.material, base_color=(0.0, 0.0, 0.0, 0.0)), 4)
    style, outputs = Look(look, (0, 0, 0), alpha_threshold=0.5), Output.COLOR | GEOMETRY
    some_bands = images(SEVERAL.render(DrawList((solid, glass, cut)), view, outputs, style))
    all_bands = images(RENDERER.render(DrawList((solid, glass, cut, unseen)), view, outputs, style))
    if look != "gltf":  # VTK's rule: what is translucent is opaque there
        some_bands, all_bands = {"color": some_bands["color"]}, {"color": all_bands["color"]}
    for name, image in some_bands.items():
        np.testing.assert_allclose(image, all_bands[name], rtol=1e-6, err_msg=name)
