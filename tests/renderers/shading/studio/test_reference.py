"""The studio look against ``reference``: light, textures, normal maps, tone curve, translucency, samples."""

from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from renderers.camera import Camera
from renderers.drawlist import AlphaMode, DrawList, Image, Instance, Material, Sampler, Texture, Wrap
from renderers.interface import Look, Output, SampleCount
from renderers.light_rig import Rig
from renderers.msaa import sample_cameras
from renderers.raster import CpuRenderer
from tests.renderers.shading.reference import ball, rays
from tests.renderers.shading.studio import reference as ref
from tests.renderers.shading.studio.scenes import DARK, KINDS, noise, rendered, sheet, translation, two_balls, view


def lit(scene: DrawList, camera: Camera, rig: Rig, visible: ref.VisibleSurfaces) -> ref.Array:
    """Return the radiance of opaque untextured instances under the rig's lights, 0 for the background, (n, 3)."""
    color = np.zeros((len(visible.point), 3))
    v = ref.normalized(-visible.point)
    for k, instance in enumerate(scene.instances):
        X = camera.X_camera_world @ instance.X_world_mesh
        n = ref.normalized(ref.attribute(scene, visible, k, "normals") @ np.linalg.inv(X[:3, :3]))
        material = instance.material
        base = np.broadcast_to(np.array(material.base_color[:3]), color.shape)
        total = np.array(material.emissive) * material.emissive_strength * np.ones_like(color)
        for light in rig.lights:
            l, irradiance = ref.incident_light(light, camera, visible.point)
            one = np.ones((len(color), 1))
            brdf = ref.brdf(n, v, l, base, material, material.roughness * one, material.metallic * one)
            total = total + irradiance * brdf
        color = np.where((visible.instance == k)[:, None], total, color)
    return color


def inner(visible: ref.VisibleSurfaces, camera: Camera) -> np.ndarray[Any, Any]:
    """Return the pixels whose neighbours see the same instance, (H, W): coverage is not tested here."""
    shape = (camera.height, camera.width)
    instance = visible.instance.reshape(shape)
    same = np.zeros(shape, np.bool_)
    same[1:-1, 1:-1] = True
    for dy in (-1, 0, 1):
        for dx in (-1, 0, 1):
            same &= np.roll(instance, (dy, dx), (0, 1)) == instance
    return same & (instance >= 0)


def assert_near(color: np.ndarray[Any, Any], expected: ref.Array, where: np.ndarray[Any, Any], limit: float) -> None:
    wrong = np.abs(color.astype(float) - expected.reshape(color.shape))[where]
    assert where.sum() > 100
    assert wrong.max() <= limit, (wrong.max(), float(wrong.mean()))


@pytest.mark.parametrize("kind", KINDS)
def test_lights(renderer: CpuRenderer, kind: str) -> None:
    scene, camera = two_balls(), view()
    rig = replace(DARK, lights=(KINDS[kind],))
    visible = ref.cast_rays(scene, camera)
    expected = ref.srgb(ref.neutral(lit(scene, camera, rig, visible)))
    where = inner(visible, camera)
    color = rendered(renderer, scene, camera, rig)
    assert color[where].max() > 60
    assert_near(color, expected, where, 0.501)


@pytest.mark.parametrize(
    "material",
    [
        {"ior": 1.1},
        {"ior": 2.4},
        {"ior": 0.0},
        {"specular": 0.3},
        {"specular_color": (0.2, 4.0, 40.0)},
        {"emissive": (0.1, 0.2, 0.05), "emissive_strength": 4.0},
    ],
    ids=lambda m: next(reversed(m)) + str(next(iter(m.values()))),
)
def test_dielectrics(renderer: CpuRenderer, material: dict[str, Any]) -> None:
    scene, camera = two_balls(**material), view()
    rig = replace(DARK, lights=tuple(KINDS.values()), exposure=0.7)
    visible = ref.cast_rays(scene, camera)
    expected = ref.srgb(ref.neutral(0.7 * lit(scene, camera, rig, visible)))
    assert_near(rendered(renderer, scene, camera, rig), expected, inner(visible, camera), 0.501)


def test_lights_of_the_scene_replace_the_rigs(renderer: CpuRenderer) -> None:
    scene, camera = two_balls(), view()
    with_spot = replace(scene, lights=(KINDS["spot"],))
    point_rig, spot_rig = (replace(DARK, lights=(KINDS[kind],)) for kind in ("point", "spot"))
    assert (rendered(renderer, with_spot, camera, point_rig) == rendered(renderer, scene, camera, spot_rig)).all()
    without_scene_lights = rendered(renderer, with_spot, camera, replace(point_rig, scene_lights=False))
    assert (without_scene_lights == rendered(renderer, scene, camera, point_rig)).all()


@pytest.mark.parametrize("tone", ref.TONES)
def test_tone_curve_and_encoding(renderer: CpuRenderer, tone: Any) -> None:
    """Emission alone, of any colour and far beyond white."""
    rng = np.random.default_rng(1)
    camera = view()
    for _ in range(6):
        emissive = tuple(rng.uniform(0, 1, 3) ** 2)
        strength = float(10 ** rng.uniform(-1.5, 2))
        glowing = Material((0, 0, 0, 1), metallic=0.0, specular=0.0, emissive=emissive, emissive_strength=strength)
        wall = sheet([(-9, -9, 4), (9, -9, 4), (9, 9, 4), (-9, 9, 4)])
        color = rendered(renderer, DrawList((Instance(wall, glowing, np.eye(4)),)), camera, replace(DARK, tone=tone))
        expected = ref.srgb(ref.TONES[tone](np.array(emissive) * strength))
        assert np.abs(color - expected).max() <= 0.501


SAMPLERS = {
    "trilinear": Sampler(),
    "bilinear, nearest level": Sampler(mip_linear=False),
    "nearest, nearest level": Sampler(mag_linear=False, min_linear=False, mip_linear=False),
    "nearest between levels": Sampler(min_linear=False),
    "no levels": Sampler(mipmaps=False),
    "magnified only": Sampler(min_linear=False, mipmaps=False),
    "clamped": Sampler(Wrap.CLAMP_TO_EDGE, Wrap.MIRRORED_REPEAT),
    "mirrored": Sampler(Wrap.MIRRORED_REPEAT, Wrap.CLAMP_TO_EDGE),
}


@pytest.mark.parametrize("name", SAMPLERS)
@pytest.mark.parametrize("transform", [None, (0.6, 0.8, 0.1, -0.8, 0.6, 0.2)], ids=["", "transformed"])
def test_texture_filters(renderer: CpuRenderer, name: str, transform: Any) -> None:
    """A floor that is magnified near the camera, and at the horizon eight levels smaller."""
    floor = sheet([(-2, 0.6, 0.6), (2, 0.6, 0.6), (2, 0.9, 30), (-2, 0.9, 30)], 4.0)
    texture = Texture(noise(), SAMPLERS[name], uv_transform=transform)
    material = Material(unlit=True, base_color_texture=texture, double_sided=True)
    scene, camera = DrawList((Instance(floor, material, np.eye(4)),)), view()
    visible = ref.cast_rays(scene, camera)
    uv = ref.attribute(scene, visible, 0, "uv0")

    def uv_at(dx: float, dy: float) -> ref.Array:
        d = rays(camera) + np.array((dx / camera.fx, dy / camera.fy, 0.0))
        # On the plane of the floor, also beyond its edges.
        p = floor.positions.astype(float)
        inverse = np.linalg.inv(p[[0, 1, 3]].T)
        b = d @ inverse.T
        b = b / b.sum(axis=1, keepdims=True)
        result: ref.Array = b @ floor.uv0[[0, 1, 3]].astype(float)
        return result

    h = 0.001
    right = np.stack((uv_at(h, 0), uv_at(-h, 0)), 1) / (2 * h)
    below = np.stack((uv_at(0, h), uv_at(0, -h)), 1) / (2 * h)
    expected = ref.srgb(ref.textured(texture, uv, right, below, True)[:, :3])
    color = rendered(renderer, scene, camera, DARK).astype(float)
    where = inner(visible, camera)
    wrong = np.abs(color - expected.reshape(color.shape)).max(axis=-1)[where]
    assert where.sum() > 400
    # Levels are bytes, each rounded from the one before. At borders of texels, rounding decides the nearest one.
    smooth = texture.sampler.min_linear and texture.sampler.mag_linear and texture.sampler.mip_linear
    assert (wrong > (2.0 if smooth else 2.5)).mean() <= (0.0 if smooth else 0.02), np.sort(wrong)[-5:]


def test_normal_map(renderer: CpuRenderer) -> None:
    """A map that leans to +u and up in the image, on a sheet without tangents, mirrored and not."""
    pixels = np.zeros((1, 1, 4), np.uint8)
    pixels[...] = (178, 152, 235, 255)
    image = Image(b"lean", lambda: pixels)
    rig = replace(DARK, lights=(KINDS["directional"],))
    for mirror in (1.0, -1.0):
        sheet_mesh = sheet([(-1, -1, 3), (1, -1, 3), (1, 1, 3), (-1, 1, 3)])
        mesh = replace(sheet_mesh, uv0=(sheet_mesh.uv0 * np.array((mirror, 1))).astype(np.float32))
        material = Material((0.6, 0.6, 0.6, 1), metallic=0.0, normal_texture=Texture(image), normal_scale=0.8)
        color = rendered(renderer, DrawList((Instance(mesh, material, np.eye(4)),)), view(), rig)
        m = pixels[0, 0, :3] / 255.0 * 2 - 1
        # u grows along +X (or against it), v along +Y of the camera, which is down; the normal is -Z.
        n = ref.normalized(np.array((mirror * m[0] * 0.8, -m[1] * 0.8, -m[2])))
        camera = view()
        p = rays(camera) * 3.0
        l, irradiance = ref.incident_light(rig.lights[0], camera, p)
        one = np.ones((len(p), 1))
        radiance = irradiance * ref.brdf(
            n + 0 * p, ref.normalized(-p), l, 0.6 * np.ones_like(p), material, one, 0 * one
        )
        visible = ref.cast_rays(DrawList((Instance(mesh, material, np.eye(4)),)), camera)
        assert_near(color, ref.srgb(ref.neutral(radiance)), inner(visible, camera), 0.501)


def test_blended_surfaces_are_sorted_by_pixel(renderer: CpuRenderer) -> None:
    """Two sheets that intersect each other, before a wall: nearest over farther over wall over background."""
    meshes = (
        sheet([(-0.6, -9, 6), (9, -9, 6), (9, 9, 6), (-0.6, 9, 6)]),
        sheet([(-1, -1, 2.5), (1, -1, 4.5), (1, 1, 4.5), (-1, 1, 2.5)]),
        sheet([(-1, -1, 4.5), (1, -1, 2.5), (1, 1, 2.5), (-1, 1, 4.5)]),
    )
    colors = np.array(((0.2, 0.6, 0.2, 1.0), (0.9, 0.2, 0.1, 0.6), (0.1, 0.3, 0.9, 0.4)))
    instances = tuple(
        Instance(
            mesh,
            Material(
                tuple(color),
                unlit=True,
                alpha_mode=AlphaMode.BLEND if color[3] < 1.0 else AlphaMode.OPAQUE,
                double_sided=True,
            ),
            np.eye(4),
        )
        for mesh, color in zip(meshes, colors, strict=True)
    )
    camera, background = view(), (30, 60, 90)
    shape = (camera.height, camera.width)
    each_visible = [ref.cast_rays(DrawList((instance,)), camera) for instance in instances]
    depth = np.array([np.where(visible.instance >= 0, visible.point[:, 2], np.inf) for visible in each_visible])
    color = np.broadcast_to(ref.srgb_to_linear(np.array(background) / 255.0), (depth.shape[1], 3))
    for k in np.argsort(-depth, axis=0, kind="stable"):  # far to near
        is_hit = np.isfinite(np.take_along_axis(depth, k[None], axis=0)[0])
        alpha = np.where(is_hit, colors[k, 3], 0.0)[:, None]
        color = alpha * colors[k, :3] + (1 - alpha) * color
    is_inside = np.ones(shape, np.bool_)  # not at a border
    for is_hit in np.isfinite(depth).reshape(3, *shape):
        for axis in (0, 1):
            is_inside &= (np.roll(is_hit, 1, axis) == is_hit) & (np.roll(is_hit, -1, axis) == is_hit)
    with np.errstate(invalid="ignore"):
        is_inside &= ~(np.abs(depth[1] - depth[2]) <= 1e-3).reshape(shape)
    actual = rendered(renderer, DrawList(instances), camera, DARK, background=background)
    assert_near(actual, ref.srgb(color).reshape(*shape, 3), is_inside, 0.51)


@pytest.mark.parametrize("samples", [4, 8])
@pytest.mark.parametrize("look", ["studio", "phong", "pbr"])
def test_samples(renderer: CpuRenderer, samples: SampleCount, look: Any) -> None:
    """Unlit balls over each other: every pixel is the mean of what the rays of its samples see."""
    colors = [(1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0)]
    scene = DrawList(
        tuple(
            Instance(
                ball(8, 0.6), Material((*c, 1.0), unlit=True), translation(0.5 * k - 0.5, 0.3 * k - 0.3, 3 + 0.4 * k)
            )
            for k, c in enumerate(colors)
        )
    )
    camera = view()
    palette = np.array((*colors, (1.0, 1.0, 1.0)))
    sample_colors = [palette[ref.cast_rays(scene, c).instance] for c in sample_cameras(camera, samples)]
    mean = np.mean(sample_colors, axis=0)
    expected = (ref.srgb(mean) if look == "studio" else 255.0 * mean).reshape(36, 48, 3)
    frame = renderer.render(scene, camera, Output.COLOR, Look(look, (255, 255, 255), samples, DARK))
    wrong = np.abs(frame.color - expected).max(axis=-1)
    assert np.abs(mean - sample_colors[0]).max() > 0.2
    assert (wrong > 1.0).sum() <= 3  # samples on an edge that is rounded to 1/256 pixel


@pytest.mark.parametrize("samples", [4, 8])
def test_pixels_beside_a_translucent_surface_are_those_of_the_opaque_scene(
    renderer: CpuRenderer, samples: SampleCount
) -> None:
    rig, opaque = Rig(shadow_size=0), two_balls()
    glass = Material((0.1, 0.9, 0.1, 0.5), alpha_mode=AlphaMode.BLEND, double_sided=True)
    corners = [(-0.2, -0.3, 2.5), (0.4, -0.2, 2.5), (0.4, 0.3, 2.5), (-0.2, 0.2, 2.5)]
    pane = Instance(sheet(corners), glass, np.eye(4))
    covered = (rendered(renderer, DrawList((pane,)), view(), rig, samples) != 0).any(axis=2)
    plain = rendered(renderer, opaque, view(), rig, samples)
    seen = rendered(renderer, replace(opaque, instances=(*opaque.instances, pane)), view(), rig, samples)
    np.testing.assert_array_equal(seen[~covered], plain[~covered])
    assert 50 < ((seen != plain).any(axis=2) & covered).sum() == covered.sum()
