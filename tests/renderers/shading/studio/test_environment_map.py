"""Environment lighting against integrals over the sphere."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest

from renderers.drawlist import DrawList, Instance, Material
from renderers.light_rig import STUDIO, Hemisphere, Softbox, Surroundings
from renderers.raster import CpuRenderer
from renderers.shading.studio.environment_image import SurroundingsError, radiance_of, read_hdr
from renderers.shading.studio.environment_map import LEVEL_SIZES, Environment, environment_of, irradiance_of, split_sum
from renderers.shading.studio.octahedral import equirect_directions, octahedral_directions
from tests.renderers.shading.studio import reference as ref
from tests.renderers.shading.studio.scenes import DARK, rendered, sheet, two_balls, view

WHITE = Surroundings(Hemisphere((1.0, 1.0, 1.0), (1.0, 1.0, 1.0)))


def sphere(count: int = 20_000) -> ref.Array:
    """Return evenly distributed directions (Fibonacci), each of the solid angle 4 pi / n, (n, 3)."""
    k = np.arange(count) + 0.5
    z = 1 - 2 * k / count
    phi = k * math.pi * (3 - math.sqrt(5))
    r = np.sqrt(1 - z * z)
    return np.stack((r * np.cos(phi), r * np.sin(phi), z), -1)


def test_octahedral_tables() -> None:
    d = octahedral_directions(16)
    np.testing.assert_allclose(np.linalg.norm(d, axis=-1), 1.0)
    for j, i in ((0, 0), (3, 14), (8, 8), (15, 1)):
        u, v = ref.octahedral(d[j, i])
        assert (u * 16 - 0.5, v * 16 - 0.5) == pytest.approx((i, j))


def read_table(table: ref.Array, d: ref.Array) -> ref.Array:
    """Sample an octahedral table with a border of one texel bilinearly."""
    side = table.shape[0] - 2
    u, v = ref.octahedral(d)
    x, y = u * side + 0.5, v * side + 0.5
    i, j = min(int(x), side), min(int(y), side)
    s, t = x - i, y - j
    result: ref.Array = (1 - t) * ((1 - s) * table[j, i] + s * table[j, i + 1]) + t * (
        (1 - s) * table[j + 1, i] + s * table[j + 1, i + 1]
    )
    return result


@pytest.mark.parametrize("window", [False, True], ids=["studio", "one window"])
def test_irradiance(window: bool) -> None:
    """The table and values between its texels, against the cosine-weighted integral."""
    surroundings = STUDIO.surroundings
    assert surroundings is not None
    if window:
        softbox = Softbox((0.7, -0.6, 0.2), (40.0, 30.0, 20.0), 0.15, 0.3, 0.05)
        surroundings = Surroundings(Hemisphere((0.1, 0.1, 0.2), (0.05, 0.05, 0.05)), (softbox,))
    radiance = radiance_of(surroundings)
    table = irradiance_of(radiance)
    d = equirect_directions(*radiance.shape[:2])
    area = np.sin(math.pi * (np.arange(radiance.shape[0]) + 0.5) / radiance.shape[0])[:, None]
    area = np.broadcast_to(area, radiance.shape[:2]) * (2 * math.pi / radiance.shape[1]) * (math.pi / radiance.shape[0])
    for n in sphere(60):
        weight = np.clip(d @ n, 0, None) * area
        exact = np.einsum("hw,hwc->c", weight, radiance) / math.pi
        # Between texels, the table is linear, which is coarse where the window sets.
        np.testing.assert_allclose(read_table(table.astype(float), n), exact, rtol=0.02, atol=0.003 * table.max())


def test_split_sum() -> None:
    """Against the integral of the BRDF itself over the hemisphere, for F0 = 0 and 1."""
    table, l = split_sum(), sphere(400_000)
    l = l[l[:, 2] > 0]
    n = np.array((0.0, 0.0, 1.0))
    for cosine, roughness in ((1.0, 0.5), (0.6, 0.7), (0.3, 1.0), (0.8, 0.4)):
        v = np.array((math.sqrt(1 - cosine**2), 0.0, cosine))
        h = ref.normalized(v + l)
        a2 = roughness**4
        n_l, n_h, v_h = l[:, 2], h[:, 2], h @ v
        D = a2 / (math.pi * (n_h**2 * (a2 - 1) + 1) ** 2)
        V = 0.5 / (n_l * np.sqrt(cosine**2 * (1 - a2) + a2) + cosine * np.sqrt(n_l**2 * (1 - a2) + a2))
        s = (1 - v_h) ** 5
        f = D * V * n_l * (2 * math.pi / len(l))
        i, j = cosine * 31, roughness * 31
        at = table[round(i), round(j)] if abs(i - round(i)) + abs(j - round(j)) < 1e-9 else _bilinear(table, i, j)
        np.testing.assert_allclose(at, ((f * (1 - s)).sum(), (f * s).sum()), atol=0.012)
    assert n @ n == 1.0


def _bilinear(table: np.ndarray, i: float, j: float) -> np.ndarray:
    a, b = int(i), int(j)
    s, t = i - a, j - b
    a1, b1 = min(a + 1, 31), min(b + 1, 31)
    first, second = (1 - s) * table[a, b] + s * table[a1, b], (1 - s) * table[a, b1] + s * table[a1, b1]
    mixed: np.ndarray = (1 - t) * first + t * second
    return mixed


def test_white_furnace(renderer: CpuRenderer) -> None:
    """White metal of any roughness in a white environment reflects all light; a dielectric loses none."""
    for metallic in (0.0, 1.0):
        for roughness in (0.0, 0.3, 0.7, 1.0):
            scene = DrawList(
                tuple(
                    replace(i, material=Material((1, 1, 1, 1), metallic=metallic, roughness=roughness))
                    for i in two_balls().instances
                )
            )
            color = rendered(renderer, scene, view(), replace(DARK, surroundings=replace(WHITE, intensity=0.5)))
            expected = ref.srgb(ref.neutral(np.full(3, 0.5)))
            lit = color[color.any(axis=-1)].astype(float)
            assert len(lit) > 300
            assert np.abs(lit - expected).max() <= 3.0, (metallic, roughness, lit.min(), lit.max(), expected)


@pytest.mark.parametrize("roughness", [0.2, 0.6, 1.0])
def test_reflection_at_normal_incidence(renderer: CpuRenderer, roughness: float) -> None:
    """The centre of a metal sheet against the whole integral of radiance and BRDF."""
    boxes = (Softbox((0.3, 0.2, -1.0), (3.0, 2.0, 1.0), 0.5, 0.5),)
    surroundings = Surroundings(Hemisphere((0.3, 0.3, 0.5), (0.1, 0.2, 0.1)), boxes)
    metal = Material((0.9, 0.6, 0.3, 1.0), metallic=1.0, roughness=roughness)
    mesh = sheet([(-2, -2, 3), (2, -2, 3), (2, 2, 3), (-2, 2, 3)])
    camera = replace(view(21, 21), cx=10.5, cy=10.5)
    color = rendered(
        renderer, DrawList((Instance(mesh, metal, np.eye(4)),)), camera, replace(DARK, surroundings=surroundings)
    )
    l = sphere(200_000)
    n = np.array((0.0, 0.0, -1.0))
    radiance = radiance_of(surroundings)
    rows = np.clip((np.arccos(l[:, 2]) / math.pi * 256).astype(int), 0, 255)
    columns = ((0.5 - np.arctan2(l[:, 1], l[:, 0]) / (2 * math.pi)) * 512).astype(int) % 512
    base = np.broadcast_to(np.array(metal.base_color[:3]), l.shape)
    one = np.ones((len(l), 1))
    f = ref.brdf(n + 0 * l, n + 0 * l, l, base, metal, roughness * one, one)
    exact = (f * radiance[rows, columns]).mean(axis=0) * 4 * math.pi
    # The energy that the single-scattering BRDF loses comes back, as light from everywhere.
    scale, bias = split_sum()[31, round(roughness * 31)].astype(float)
    lost, white = 1 - scale - bias, np.array(metal.base_color[:3])
    single, mean = white * scale + bias, white + (1 - white) / 21
    irradiance = np.einsum("lc,l->c", radiance[rows, columns], np.clip(l @ n, 0, None)) * 4 / len(l)
    exact += lost * single * mean / (1 - mean * lost) * irradiance
    expected = ref.srgb(ref.neutral(exact))
    # The split weights by D n.l instead of D V n.l: at most a dozen levels at the foot of a bright box.
    assert np.abs(color[10, 10] - expected).max() <= 12.0, (color[10, 10], expected)


def tables_of(environment: Environment) -> list[np.ndarray]:
    """Return the octahedral tables of an environment with their borders, (N + 2, N + 2, 3) each."""
    tables = [environment.texels[offset : offset + 4 * (size + 2) ** 2] for offset, size in environment.tables]
    sides = environment.tables[:, 1] + 2
    return [table.reshape(side, side, 4)[..., :3] for table, side in zip(tables, sides, strict=True)]


def test_rotation_of_the_environment() -> None:
    """A quarter turn takes what was at +X to +Y."""
    box = Surroundings(Hemisphere((0, 0, 0), (0, 0, 0)), (Softbox((1, 0, 0), (1, 1, 1), 0.5, 0.5),))
    for turn, direction in ((0.0, (1.0, 0.0, 0.0)), (math.pi / 2, (0.0, 1.0, 0.0))):
        table = tables_of(environment_of(replace(box, turn=turn)))[-1].astype(float)
        sides = np.array(((1.0, 0, 0), (0, 1.0, 0), (-1.0, 0, 0), (0, -1.0, 0)))
        lit = [read_table(table, d)[0] for d in sides]
        assert int(np.argmax(lit)) == (0 if direction[0] else 1)


def test_filtered_levels_keep_the_mean_radiance() -> None:
    """Filtering keeps the mean radiance over the sphere."""
    assert STUDIO.surroundings is not None
    means = []
    for level, size in zip(tables_of(environment_of(STUDIO.surroundings)), LEVEL_SIZES, strict=False):
        assert level.shape == (size + 2, size + 2, 3)
        d = octahedral_directions(size)
        area = np.abs(d).sum(axis=-1) ** 3  # of the octahedral map, up to a factor
        means.append((level[1:-1, 1:-1] * area[..., None]).sum(axis=(0, 1)) / area.sum())
    np.testing.assert_allclose(means, np.broadcast_to(means[0], (len(means), 3)), rtol=0.03)


def test_radiance_images() -> None:
    rng = np.random.default_rng(0)
    pixels = rng.uniform(0, 4, (16, 32, 3)).astype(np.float32)
    data = cv2.imencode(".hdr", pixels[..., ::-1])[1].tobytes()
    np.testing.assert_allclose(read_hdr(data), pixels, rtol=0.02, atol=0.02)
    np.testing.assert_allclose(radiance_of(Surroundings(image=data, intensity=2.0)), 2.0 * read_hdr(data))
    for broken, message in (
        (b"P6 1 1", "begins with"),
        (b"#?RADIANCE\n\n", "no line with its size"),
        (b"#?RADIANCE\n\n-Y 10 +X 10\n", "twice as wide as high"),
        (b"#?RADIANCE\n\n-Y 90000 +X 180000\n", "at most"),
        (data[:80], "broken"),
    ):
        with pytest.raises(SurroundingsError, match=message):
            read_hdr(broken)


@pytest.mark.parametrize("intensity", [1e9, 1e38])
def test_radiance_times_intensity_stays_far_below_the_largest_float32(intensity: float) -> None:
    image = cv2.imencode(".hdr", np.full((4, 8, 3), 1e30, np.float32))[1].tobytes()
    for surroundings in (Surroundings(image=image), Surroundings(hemisphere=Hemisphere((1e9,) * 3, (1e9,) * 3))):
        radiance = radiance_of(replace(surroundings, intensity=intensity))
        assert radiance.dtype == np.float32
        assert radiance.max() == pytest.approx(1e12)
