"""Light in closed rooms: the camera's lamp, sky and ground, the projector, and lights of the scene."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.adapters.stereo.device.camera_config import StereoConfig
from gateway.adapters.stereo.imaging.rendered_images import Imaging
from gateway.adapters.stereo.imaging.scene_view import Capture, SceneView
from gateway.files.assets.mesh_formats import MESH_LIMITS, parse_mesh
from gateway.scene.draw.flatten import Flattener
from gateway.scene.draw.mount import Mount
from gateway.scene.tree.geometry import Part
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.transforms import look_at, translation
from renderers.drawlist import Light, LightKind, Material
from renderers.raster import CpuRenderer
from renderers.stereo.light.levels import LightLevels
from renderers.stereo.realism import REALISM_PARTS, RealismPart
from renderers.stereo.sensor.exposure import Exposure
from scenegate.messages.geometry import Box
from tests.adapters.stereo.camera_images import expose
from tests.adapters.stereo.conftest import SMALL
from tests.adapters.stereo.rooms import noise_texture, room, walls_seen

BOX = [(-3.0, -2.0), (3.0, -2.0), (3.0, 2.0), (-3.0, 2.0)]
CORRIDOR = [(-6.0, -0.8), (6.0, -0.8), (6.0, 0.8), (-6.0, 0.8)]
L_SHAPE = [(0.0, 0.0), (6.0, 0.0), (6.0, 2.0), (2.0, 2.0), (2.0, 6.0), (0.0, 6.0)]
HEIGHT = 2.6


@pytest.mark.parametrize(
    ("corners", "eye", "target", "realism"),
    [
        (BOX, (-2.5, 0.0, 1.2), (3.0, 0.0, 1.2), ()),
        (BOX, (-2.0, -1.0, 1.2), (3.0, 2.0, 1.2), REALISM_PARTS),
        (CORRIDOR, (-5.5, 0.0, 1.2), (6.0, 0.0, 1.2), ()),
        (CORRIDOR, (-5.5, 0.0, 1.2), (6.0, 0.0, 1.2), REALISM_PARTS),
        (L_SHAPE, (1.0, 1.0, 1.2), (6.0, 1.0, 1.2), REALISM_PARTS),
    ],
)
def test_every_wall_is_lit_and_measured(
    renderer: CpuRenderer,
    corners: list[tuple[float, float]],
    eye: tuple[float, float, float],
    target: tuple[float, float, float],
    realism: tuple[RealismPart, ...],
) -> None:
    scene = room(corners, HEIGHT, noise_texture())
    walls = walls_seen(renderer, scene, eye, target, realism=frozenset(realism))
    greys = [wall.grey for wall in walls.values()]
    assert len(greys) >= 4
    assert min(greys) > 30.0
    assert max(greys) < 220.0
    assert max(greys) / min(greys) <= 6.0
    for number, wall in walls.items():
        assert not wall.fill < 0.8, (number, wall)


def test_a_texture_that_repeats_is_matched_with_itself(renderer: CpuRenderer) -> None:
    """At 5.5 m, the texture of 1 m repeats after 98 pixels; the repetition is nearer to a whole pixel."""
    scene = room(BOX, HEIGHT, noise_texture(1024), tile=1.0)
    walls = walls_seen(renderer, scene, (-2.5, 0.0, 1.2), (3.0, 0.0, 1.2))
    for number, wall in walls.items():
        assert not wall.fill < 0.8, (number, wall)
        assert not wall.right < 0.8, (number, wall)


@pytest.mark.parametrize(("corners", "eye"), [(BOX, (0.0, 1.2, 1.2)), (CORRIDOR, (-5.5, 0.0, 1.2))])
def test_the_projector_measures_plain_walls(
    renderer: CpuRenderer, corners: list[tuple[float, float]], eye: tuple[float, float, float]
) -> None:
    walls = walls_seen(renderer, room(corners, HEIGHT, None), eye, (6.0, 0.0, 1.2), projector=True, max_depth=3.0)
    fills = [wall.fill for wall in walls.values() if not np.isnan(wall.fill)]
    assert len(fills) >= 2
    assert min(fills) >= 0.7


def light_image(renderer: CpuRenderer, levels: LightLevels, *lights: Light) -> NDArray[np.float64]:
    """Return the light in a grey image of the plain room without noise, white is 1."""
    config = StereoConfig(model=SMALL, noise=False, light=levels)
    pose = look_at((-2.5, 0.0, 1.2), (3.0, 0.0, 1.2), (0.0, 0.0, 1.0))
    capture = Capture(0, replace(room(BOX, HEIGHT, None), lights=lights), 1, pose, 0)
    return expose(Imaging(config, renderer), capture, Exposure(0.005)).image / 255.0


def test_light_adds_up(renderer: CpuRenderer) -> None:
    dark = LightLevels(lamp=0.0, sky=0.0, ground=0.0)
    lamp, ambient = replace(dark, lamp=1.0), replace(dark, sky=2.0, ground=1.0)
    spot = Light(LightKind.SPOT, (1.0, 1.0, 1.0), 8.0, (2.0, 0.0, 2.5), (0.0, 0.0, -1.0), outer_cone=0.4)
    by_lamp, by_ambient = light_image(renderer, lamp), light_image(renderer, ambient)
    by_spot = light_image(renderer, dark, spot)
    together = light_image(renderer, replace(ambient, lamp=1.0), spot)
    rest = light_image(renderer, dark)
    assert np.abs(together - (by_lamp + by_ambient + by_spot - 2 * rest)).max() < 0.02  # rounding of four images
    assert by_spot.max() > 0.1
    row, column = SMALL.height - 20, SMALL.width // 2
    assert by_spot[row, column] == pytest.approx(rest[row, column], abs=0.01), "outside of the spot"
    half = light_image(renderer, replace(dark, scene=0.5), spot)
    assert (half - rest).sum() == pytest.approx((by_spot - rest).sum() / 2, rel=0.05)


def spot_file(**node: Any) -> bytes:
    """Return a glTF file with a spot that shines down its axis -z, at a node with these properties."""
    extension = "KHR_lights_punctual"
    light = {"type": "spot", "intensity": 8.0, "spot": {"outerConeAngle": 0.3}}
    return json.dumps(
        {
            "asset": {"version": "2.0"},
            "nodes": [{"extensions": {extension: {"light": 0}}, **node}],
            "extensions": {extension: {"lights": [light]}},
        }
    ).encode()


def test_a_light_of_a_file_shines_from_its_node_while_it_is_shown(renderer: CpuRenderer) -> None:
    """A spot 2 m above the floor of a dark hall: what it lights is brighter than elsewhere."""
    tree = LiveTree()
    grey = Material(base_color=(0.5, 0.5, 0.5, 1.0), metallic=0.0, roughness=0.9)
    pose = look_at((0.0, -3.0, 2.0), (0.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    view = SceneView(tree, Flattener(LabelTable()), Mount(pose))
    camera = SMALL.camera(pose, offset=0.0, divisor=1, near=0.01, far=100.0)
    config = StereoConfig(model=SMALL, noise=False, light=LightLevels(lamp=0.0, sky=0.0, ground=0.0))
    warnings: list[str] = []
    down = [-math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)]  # from -z to -y, which is down in glTF
    parts = parse_mesh(spot_file(rotation=down), "gltf", lambda name: b"", MESH_LIMITS, warnings)
    assert warnings == []

    def lit_at(*places: float) -> list[float]:
        """Return the grey on the floor at places (x, 0, 0)."""
        capture = Capture(0, view.state().scene, 1, pose, 0)
        image = expose(Imaging(config, renderer), capture, Exposure(0.005)).image
        found = []
        for x in places:
            point = camera.X_camera_world @ (x, 0.0, 0.0, 1.0)
            u, v = camera.fx * point[0] / point[2] + camera.cx, camera.fy * point[1] / point[2] + camera.cy
            found.append(float(image[int(v) - 2 : int(v) + 3, int(u) - 2 : int(u) + 3].mean()))
        return found

    with tree.edit() as edit:
        edit.set_parts(("floor",), (Part(Box((9.0, 9.0, 0.1)), grey, translation(0.0, 0.0, -0.05)),))
    dark = lit_at(-1.0, 1.0)
    assert max(dark) < 5.0
    with tree.edit() as edit:
        edit.set_parts(("lamp", "head"), parts)
        edit.set_matrix(("lamp",), translation(-1.0, 0.0, 2.0))
    left, right = lit_at(-1.0, 1.0)
    assert left > 40.0
    assert right == pytest.approx(dark[1], abs=1.0)
    with tree.edit() as edit:
        edit.set_matrix(("lamp",), translation(1.0, 0.0, 2.0))
    assert lit_at(1.0, -1.0) == pytest.approx([left, dark[0]], abs=2.0)
    with tree.edit() as edit:
        edit.set_visible(("lamp",), False)
    assert lit_at(-1.0, 1.0) == pytest.approx(dark, abs=1.0)
    with tree.edit() as edit:
        edit.set_visible(("lamp",), True)
        edit.delete(("lamp", "head"))
    assert lit_at(-1.0, 1.0) == pytest.approx(dark, abs=1.0)


def test_the_lamp_is_a_point(renderer: CpuRenderer) -> None:
    """Light of albedo 0.5 under a lamp of 3 is 0.5 / pi * 3 * (1.5 / distance)^2 * cosine, besides a little gloss."""
    image = light_image(renderer, LightLevels(lamp=3.0, sky=0.0, ground=0.0))
    k = SMALL.intrinsics()
    rows, columns = np.mgrid[0 : k.height, 0 : k.width] + 0.5
    x = (columns - k.cx) / k.focal_length
    y = (rows - k.cy) / k.focal_length
    lamp_x = SMALL.baseline / 2
    for name, z, normal in (("wall ahead", 5.5, (0.0, 0.0, -1.0)), ("floor", 1.2 / y, (0.0, -1.0, 0.0))):
        with np.errstate(divide="ignore"):
            point = np.stack(np.broadcast_arrays(x * z, y * z, z + 0.0 * x), axis=-1)
        to_lamp = np.array((lamp_x, 0.0, 0.0)) - point
        distance = np.linalg.norm(to_lamp, axis=-1)
        expected = 0.5 / np.pi * 3.0 * np.minimum((1.5 / distance) ** 2, 4.0) * (to_lamp @ normal) / distance
        seen = np.s_[110:130, 100:220] if name == "wall ahead" else np.s_[200:235, 100:220]
        assert image[seen] == pytest.approx(expected[seen], abs=0.012), name


@pytest.mark.parametrize("has_ceiling", [True, False])
def test_the_key_light_stays_outside_of_a_closed_room(renderer: CpuRenderer, has_ceiling: bool) -> None:
    """The end of a corridor is beyond the shadow map; on seams of walls, the map cannot tell them from the ceiling."""
    corridor = room(CORRIDOR, HEIGHT, None)
    scene = corridor if has_ceiling else replace(corridor, instances=corridor.instances[:-1])
    pose = look_at((-5.5, 0.0, 1.2), (6.0, 0.0, 1.2), (0.0, 0.0, 1.0))
    with_key, without = (
        expose(
            Imaging(
                StereoConfig(model=SMALL, noise=False, light=LightLevels(key=key), realism=frozenset({"shadows"})),
                renderer,
            ),
            Capture(0, scene, 1, pose, 0),
            Exposure(0.005),
        ).image
        for key in (2.4, 0.0)
    )
    assert bool((with_key > without).any()) != has_ceiling
