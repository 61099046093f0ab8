"""The pictures of docs/gallery.md, drawn by this repository's own renderer from scenes that are made here.

    python -m tools.pictures.gallery [FOLDER [NAME ...]]

FOLDER (default: docs/images/gallery) gets one JPEG each, or those that are named. The same sources give the same pixels
every time.
"""

import math
import sys
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.adapters.stereo.device.profile import read_profile
from gateway.demo import Demo
from gateway.scene.draw.cameras import parse_camera
from gateway.scene.draw.flatten import flatten
from gateway.scene.draw.viewpoints import resolve_camera
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import LiveTree
from gateway.scene.tree.nodes import Node
from renderers.camera import Camera
from renderers.drawlist import AlphaMode, DrawList, Image, Instance, Light, LightKind, Material, Mesh, Sampler, Texture
from renderers.encode import jpeg_rgb
from renderers.fxaa import fxaa
from renderers.interface import Look, Output, SampleCount
from renderers.light_rig import STUDIO, Hemisphere, Rig, Surroundings
from renderers.raster import CpuRenderer, warmup
from renderers.stereo.depth.depth_images import DepthRange, true_disparity
from renderers.stereo.depth.matching import fine_means, match_pair
from renderers.stereo.light.projector import projected_dots
from renderers.stereo.model import DISPARITY_SCALE
from renderers.stereo.sensor.camera_image import NoiseStream, SceneLight, frame_key, image_from_light, light_on_sensor
from renderers.stereo.sensor.exposure import Exposure

Picture = NDArray[np.uint8]
PAPER: Final = (236, 239, 243)
NIGHT: Final = (16, 18, 24)
WIDTH, HEIGHT = 1120, 630


def sphere(rings: int = 64, radius: float = 0.5) -> Mesh:
    """Around the origin."""
    u, v = np.meshgrid(np.linspace(0, 2 * np.pi, 2 * rings + 1), np.linspace(0, np.pi, rings + 1))
    n = np.stack((np.cos(u) * np.sin(v), np.sin(u) * np.sin(v), np.cos(v)), -1).reshape(-1, 3)
    a = (np.arange(rings)[:, None] * (2 * rings + 1) + np.arange(2 * rings)).ravel()
    below = a + 2 * rings + 1
    elements = np.concatenate((np.stack((a, below, a + 1), 1), np.stack((a + 1, below, below + 1), 1)))
    uv = np.stack((u / np.pi, v / np.pi), -1).reshape(-1, 2)
    points, normals = (np.ascontiguousarray(x, np.float32) for x in (radius * n, n))
    return Mesh(points, elements.astype(np.uint32), normals, uv.astype(np.float32))


def ground(half: float, repeats: float) -> Mesh:
    """A square at z = 0."""
    p = np.array(((-1, -1, 0), (1, -1, 0), (1, 1, 0), (-1, 1, 0)), np.float32) * np.float32(half)
    normals = np.tile(np.array((0, 0, 1), np.float32), (4, 1))
    return Mesh(
        p, np.array(((0, 1, 2), (0, 2, 3)), np.uint32), normals, (p[:, :2] / half * repeats / 2).astype(np.float32)
    )


def image(pixels: NDArray[Any]) -> Image:
    """An image of (H, W, 3 or 4) values 0 .. 255."""
    rgba = np.full((*pixels.shape[:2], 4), 255, np.uint8)
    rgba[..., : pixels.shape[2]] = np.clip(pixels, 0, 255)
    return Image(rgba.tobytes(), lambda: rgba)


def checks(light: Any = (214, 216, 219), dark: Any = (150, 155, 162), cells: int = 2, side: int = 256) -> Image:
    """Squares."""
    i, j = np.mgrid[:side, :side] * cells // side
    return image(np.where(((i + j) % 2 == 0)[..., None], light, dark))


def dents(side: int = 512) -> Image:
    """A normal map of hammered metal."""
    rng = np.random.default_rng(4)
    height = np.zeros((side, side), np.float32)
    y, x = np.mgrid[:side, :side]
    for cx, cy, r in zip(*rng.uniform(0, side, (2, 260)), rng.uniform(18, 40, 260), strict=True):
        dx, dy = (x - cx + side / 2) % side - side / 2, (y - cy + side / 2) % side - side / 2
        height = np.minimum(height, (dx * dx + dy * dy) / (r * r) * 6 - 6)
    height = np.asarray(cv2.GaussianBlur(np.pad(height, 16, "wrap"), (0, 0), 3)[16:-16, 16:-16], np.float32)
    slope_y, slope_x = np.gradient(height)
    n = np.stack((-slope_x, slope_y, np.full_like(height, 2.2)), -1)
    return image((n / np.linalg.norm(n, axis=-1, keepdims=True) + 1) * 127.5)


def at(x: float, y: float, z: float, scale: float = 1.0) -> NDArray[np.float64]:
    X = np.diag((scale, scale, scale, 1.0))
    X[:3, 3] = x, y, z
    return X


def camera(text: str, width: int = WIDTH, height: int = HEIGHT, drawn: DrawList | None = None) -> Camera:
    """By the grammar of ``scenegate render --camera``."""
    return resolve_camera(parse_camera(text), Node(), width, height, draw_list=drawn)


class Gallery:
    """Draws them; each method is one picture."""

    def __init__(self) -> None:
        self._renderer = CpuRenderer()
        tree = LiveTree()
        demo = Demo(tree)
        demo.populate()
        demo.move_to(3.0)
        labels = LabelTable()
        self._demo = flatten(tree.snapshot.root, label_of=lambda path, _: labels.label_of(path))

    def color(self, scene: DrawList, view: Camera, look: Look) -> Picture:
        frame = self._renderer.render(scene, view, Output.COLOR, look)
        assert frame.color is not None
        return frame.color

    def demo(self) -> Picture:
        view = camera("eye=2.75,-2.75,2.1;target=0.05,-0.05,0.56;fovy=37", drawn=self._demo)
        return self.color(self._demo, view, Look("studio", PAPER, 8))

    def looks(self) -> Picture:
        """The four looks side by side."""
        view = camera("eye=1.25,-1.2,1.55;target=0.05,0,0.95;fovy=32", WIDTH // 2, HEIGHT // 2, self._demo)
        tiles = []
        for name in ("phong", "pbr", "plain", "studio"):
            picture = self.color(self._demo, view, Look(name, samples=4))
            cv2.putText(picture, name, (14, 28), cv2.FONT_HERSHEY_SIMPLEX, 0.7, (40, 50, 60), 1, cv2.LINE_AA)
            tiles.append(picture)
        return np.vstack((np.hstack(tiles[:2]), np.hstack(tiles[2:])))

    def materials(self) -> Picture:
        """Metals and dielectrics by roughness, indices of refraction, a normal map."""
        ball, floor = sphere(), ground(30, 60)
        paper = Material((0.95, 0.95, 0.95, 1), metallic=0.0, roughness=0.7, base_color_texture=Texture(checks()))
        instances = [Instance(floor, paper, np.eye(4))]
        rows: tuple[Callable[[float], Material], ...] = (
            lambda t: Material((1.0, 0.78, 0.36, 1), metallic=1.0, roughness=0.05 + 0.85 * t),
            lambda t: Material((0.02, 0.12, 0.42, 1), metallic=0.0, roughness=0.05 + 0.85 * t),
            lambda t: Material((0.6, 0.03, 0.03, 1), metallic=0.0, roughness=0.15, ior=1.0 + 1.6 * t),
            lambda t: Material(
                (0.95, 0.93, 0.9, 1) if t < 0.5 else (0.95, 0.55, 0.4, 1),
                metallic=1.0,
                roughness=0.12 + 0.3 * t,
                normal_texture=Texture(dents()),
                normal_scale=0.3 + 0.7 * t,
            ),
        )
        for k, row in enumerate(rows):
            for i in range(7):
                place = at(1.15 * (i - 3), 1.25 * (1.5 - k), 0.5)
                instances.append(Instance(ball, row(i / 6), place))
        view = camera("eye=1.6,-9.0,5.2;target=-0.1,-0.25,0.1;fovy=32")
        return self.color(DrawList(tuple(instances)), view, Look("studio", PAPER, 8))

    def lamps(self) -> Picture:
        """Spots with shadows, a point light, emission."""
        ball, floor = sphere(), ground(12, 10)
        stone = Material((0.6, 0.6, 0.62, 1), metallic=0.0, roughness=0.55)
        instances = [Instance(floor, stone, np.eye(4))]
        for k in range(9):
            angle = 2 * math.pi * k / 9
            metal = Material((0.9, 0.9, 0.92, 1), metallic=float(k % 2), roughness=0.25)
            instances.append(Instance(ball, metal, at(1.7 * math.cos(angle), 1.7 * math.sin(angle), 0.4, 0.8)))
        glow = Material((0, 0, 0, 1), metallic=0.0, emissive=(1.0, 0.55, 0.2), emissive_strength=4.0)
        instances.append(Instance(ball, glow, at(0, 0, 0.75, 0.5)))
        colors = ((1.0, 0.25, 0.2), (0.25, 1.0, 0.35), (0.25, 0.4, 1.0))
        lights = [Light(LightKind.POINT, (1.0, 0.6, 0.3), 4.0, (0.0, 0.0, 0.75), casts_shadow=False)]
        for k, color in enumerate(colors):
            angle = 2 * math.pi * k / 3 + 0.5
            place = np.array((3.4 * math.cos(angle), 3.4 * math.sin(angle), 4.2))
            aim = -place / np.linalg.norm(place)
            lights.append(Light(LightKind.SPOT, color, 42.0, (*place,), (*aim,), inner_cone=0.3, outer_cone=0.62))
        dim = Surroundings(Hemisphere((0.02, 0.025, 0.04), (0.01, 0.01, 0.01)))
        rig = Rig(surroundings=dim, shadow_radius=4)
        scene = DrawList(tuple(instances), lights=tuple(lights))
        view = camera("eye=3.6,-5.6,4.0;target=0,-0.1,0.15;fovy=33")
        return self.color(scene, view, Look("studio", NIGHT, 8, rig))

    def glass(self) -> Picture:
        """Translucent surfaces that overlap and cut through each other, sorted in every pixel."""
        ball, floor = sphere(), ground(30, 60)
        paper = Material((0.95, 0.95, 0.95, 1), metallic=0.0, roughness=0.7, base_color_texture=Texture(checks()))
        instances = [Instance(floor, paper, np.eye(4))]
        for k, color in enumerate(((0.9, 0.1, 0.15), (0.95, 0.7, 0.1), (0.1, 0.6, 0.3), (0.1, 0.35, 0.9))):
            angle = 2 * math.pi * k / 4 + 0.4
            pane = Material((*color, 0.36), metallic=0.0, roughness=0.05, alpha_mode=AlphaMode.BLEND)
            instances.append(Instance(ball, pane, at(0.52 * math.cos(angle), 0.52 * math.sin(angle), 0.75, 1.5)))
        core = Material((0.8, 0.8, 0.83, 1), metallic=1.0, roughness=0.08)
        instances.append(Instance(ball, core, at(0, 0, 0.75, 0.7)))
        view = camera("eye=1.6,-4.6,2.4;target=0,0,0.62;fovy=26")
        return self.color(DrawList(tuple(instances)), view, Look("studio", PAPER, 4))

    def filtering(self) -> Picture:
        """The same floor without mip levels and with them, one sample and eight."""
        floor = ground(60, 240)
        view = camera("eye=0,-6,1.1;target=0,0,0.2;fovy=34", WIDTH // 2, HEIGHT // 2)
        tiles = []
        tries: list[tuple[bool, SampleCount, str]] = [
            (False, 1, "no mip levels, 1 sample"),
            (True, 1, "mip levels, 1 sample"),
            (False, 8, "no mip levels, 8 samples"),
            (True, 8, "mip levels, 8 samples"),
        ]
        for mipmaps, samples, text in tries:
            texture = Texture(checks((235, 235, 235), (60, 66, 74)), Sampler(mipmaps=mipmaps))
            wood = Material((0.9, 0.9, 0.9, 1), metallic=0.0, roughness=0.8, base_color_texture=texture)
            ball = Material((0.9, 0.35, 0.1, 1), metallic=0.0, roughness=0.3)
            scene = DrawList((Instance(floor, wood, np.eye(4)), Instance(sphere(), ball, at(0.7, -1.5, 0.5))))
            picture = self.color(scene, view, Look("studio", (204, 229, 255), samples))
            cv2.putText(picture, text, (14, 26), cv2.FONT_HERSHEY_SIMPLEX, 0.55, (40, 50, 60), 1, cv2.LINE_AA)
            tiles.append(picture)
        return np.vstack((np.hstack(tiles[:2]), np.hstack(tiles[2:])))

    def edges(self) -> Picture:
        """One robot's elbow, eight times as large: 1 sample, FXAA, 4 and 8 samples."""
        view = camera("eye=1.4,-1.1,1.7;target=0,0,0.85", 640, 480, self._demo)
        tiles = []
        tries: list[tuple[SampleCount, str]] = [(1, "1 sample"), (1, "FXAA"), (4, "4 samples"), (8, "8 samples")]
        for samples, text in tries:
            picture = self.color(self._demo, view, Look("pbr", samples=samples))
            if text == "FXAA":
                fxaa(picture)
            part = picture[148:218, 260:295]
            part = np.asarray(cv2.resize(part, None, fx=8, fy=8, interpolation=cv2.INTER_NEAREST), np.uint8)
            cv2.rectangle(part, (0, 0), (130, 36), PAPER, cv2.FILLED)
            cv2.putText(part, text, (14, 24), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (40, 50, 60), 1, cv2.LINE_AA)
            tiles.append(part)
        return np.hstack(tiles)

    def outputs(self) -> Picture:
        """Colour, depth, labels and normals of one call."""
        view = camera("eye=2.75,-2.75,2.1;target=0.05,-0.05,0.56;fovy=37", WIDTH // 2, HEIGHT // 2, self._demo)
        wanted = Output.ROOTS | Output.DEPTH | Output.LABEL | Output.NORMAL
        frame = self._renderer.render(self._demo, view, wanted, Look("studio", PAPER, 8))
        assert frame.color is not None
        assert frame.depth is not None
        assert frame.label is not None
        assert frame.normal is not None
        near = 1.0 / np.where(np.isfinite(frame.depth), frame.depth, np.inf)
        near = (np.clip((near - 0.12) / 0.26, 0, 1) * 255).astype(np.uint8)
        depth = cv2.applyColorMap(near, cv2.COLORMAP_VIRIDIS)[..., ::-1]
        palette = np.random.default_rng(1).integers(60, 256, (4096, 3))
        label = np.where((frame.label == 0xFFFFFF)[..., None], 255, palette[np.minimum(frame.label, 4095)]).astype(
            np.uint8
        )
        normal = np.where(
            frame.normal.any(axis=-1, keepdims=True), (frame.normal * (1, -1, -1) + 1) * 127.5, 255
        ).astype(np.uint8)
        return np.vstack((np.hstack((frame.color, depth)), np.hstack((label, normal))))

    def tones(self) -> Picture:
        """Ever brighter light under the three tone curves, one above the other."""
        ball = sphere()
        instances = []
        hues = ((0.85, 0.06, 0.05), (0.9, 0.45, 0.03), (0.75, 0.7, 0.06), (0.08, 0.5, 0.1), (0.05, 0.2, 0.75))
        for k, color in enumerate((*hues, (0.35, 0.08, 0.6), (0.8, 0.8, 0.8))):
            satin = Material((*color, 1), metallic=0.0, roughness=0.35)
            instances.append(Instance(ball, satin, at(1.1 * (k - 3), 0, 0.5)))
        view = camera("eye=0,-9,1.1;target=0,0,0.5;fovy=9.8", WIDTH, HEIGHT // 3)
        strips = []
        for tone in ("neutral", "aces", "none"):
            rig = replace(STUDIO, tone=tone, exposure=2.2)
            strip = self.color(DrawList(tuple(instances)), view, Look("studio", PAPER, 8, rig))
            cv2.putText(strip, tone, (14, 26), cv2.FONT_HERSHEY_SIMPLEX, 0.6, (40, 50, 60), 1, cv2.LINE_AA)
            strips.append(strip)
        return np.vstack(strips)

    def stereo(self) -> Picture:
        """Draw the stereo camera's stream: images with projector dots and noise, matched disparity, exact disparity."""
        pose = camera("eye=1.55,-1.5,1.3;target=0,0.1,0.62", drawn=self._demo).X_world_camera
        tiles = stereo_tiles(self._renderer, self._demo, pose)
        height, width = tiles[0].shape[:2]
        top, side = (height - HEIGHT // 2) // 2, (width - WIDTH // 2) // 2
        tiles = [tile[top : top + HEIGHT // 2, side : side + WIDTH // 2] for tile in tiles]
        return np.vstack((np.hstack(tiles[:2]), np.hstack(tiles[2:])))


def stereo_tiles(
    renderer: CpuRenderer,
    drawn: DrawList,
    pose: NDArray[np.float64],
    frame: int = 1,
    max_disparity: float | None = None,
) -> list[Picture]:
    """Return four RGB images, 640 x 480: left and right with projector dots and noise, matched and exact disparity.

    Args:
        pose: pose of the left camera's optical frame in the world.
        frame: number of the frame, which chooses the noise.
        max_disparity: disparity of the last colour of the colour map, pixels; None: the 99.5th percentile.
    """
    model, divisor = read_profile("rc_visard_160c").model, 2
    k = model.intrinsics(divisor)
    exposure, depths, images = Exposure(), [], []
    wanted = Output.ROOTS | Output.DEPTH
    middle = model.camera(pose, offset=model.baseline / 2, divisor=divisor, near=0.05, far=100.0)
    seen = renderer.render(drawn, middle, Output.DEPTH)
    assert seen.depth is not None
    for stream, offset in ((NoiseStream.LEFT, 0.0), (NoiseStream.RIGHT, model.baseline)):
        view = model.camera(pose, offset=offset, divisor=divisor, near=0.05, far=100.0)
        rendered = renderer.render(drawn, view, wanted, Look("pbr"))
        assert rendered.roots is not None
        assert rendered.depth is not None
        dots = projected_dots(rendered.depth, k.focal_length, k.cx, k.cy, offset - model.baseline / 2, seen.depth)
        key = frame_key(1, frame, stream)
        light = light_on_sensor(rendered.roots, k, exposure, SceneLight(dots, 1.5), color=False)
        images.append(image_from_light(light, exposure, key).image)
        depths.append(rendered.depth)
    count, noise_sigma = model.disparity_count(divisor, 0.5), exposure.noise_by_level
    fine_left, fine_right = (fine_means(image, 1, *image.shape) for image in images)
    matched = match_pair(fine_left, fine_right, count, noise_sigma, divisor)
    ft = k.focal_length * model.baseline
    exact = true_disparity(depths[0], depths[1], ft, DepthRange(0.5, 100.0))
    if max_disparity is None:
        max_disparity = float(np.percentile(exact[exact > 0], 99.5))

    def painted(disparity: NDArray[Any]) -> Picture:
        level = np.clip(disparity / max_disparity * 255.0, 0, 255).astype(np.uint8)
        colors = np.asarray(cv2.applyColorMap(level, cv2.COLORMAP_TURBO)[..., ::-1], np.uint8)
        return np.where((disparity > 0)[..., None], colors, np.uint8(255))

    def grey(image: Picture) -> Picture:
        return np.repeat(image[..., None], 3, axis=2)

    pixels = matched.disparity * np.float32(DISPARITY_SCALE)
    return [grey(images[0]), grey(images[1]), painted(pixels), painted(exact)]


def main() -> None:
    folder = Path(sys.argv[1] if len(sys.argv) > 1 else "docs/images/gallery")
    folder.mkdir(parents=True, exist_ok=True)
    warmup()
    gallery = Gallery()
    pictures: dict[str, Callable[[], Picture]] = {
        "demo": gallery.demo,
        "looks": gallery.looks,
        "materials": gallery.materials,
        "lamps": gallery.lamps,
        "glass": gallery.glass,
        "filtering": gallery.filtering,
        "edges": gallery.edges,
        "outputs": gallery.outputs,
        "tones": gallery.tones,
        "stereo": gallery.stereo,
    }
    wanted = sys.argv[2:] or list(pictures)
    if unknown := set(wanted) - set(pictures):
        sys.exit(f"no such picture: {', '.join(sorted(unknown))}; there are {', '.join(pictures)}")
    for name, draw in ((name, pictures[name]) for name in wanted):
        data = jpeg_rgb(np.ascontiguousarray(draw()), quality=86)
        (folder / f"{name}.jpg").write_bytes(data)
        print(f"{name:10} {len(data) / 1e3:6.0f} kB", flush=True)


if __name__ == "__main__":
    main()
