"""The picture of docs/rasterizer.md: one small frame at each stage, its pixels enlarged.

python -m tools.pictures.rasterizer_figure OUT.webp
"""

import sys
from typing import Any, Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.scene.tree.transforms import look_at
from renderers.camera import Camera
from renderers.drawlist import DrawList, Instance, Material
from renderers.interface import Look, Output
from renderers.primitives import box, cylinder, sphere
from renderers.raster import CpuRenderer
from renderers.visibility_buffer import BAND_ROWS

WIDTH, HEIGHT, SCALE = 64, 48, 7
CAPTION_ROWS: Final = 26
GREY: Final = (236, 236, 236)


def scene() -> DrawList:
    """Return a coarse sphere, a cylinder and a box on a floor."""

    def instance(mesh: Any, color: tuple[float, float, float], scale: list[float], place: list[float]) -> Instance:
        pose = np.diag([*scale, 1.0])
        pose[:3, 3] = place
        return Instance(mesh, Material(base_color=(*color, 1.0)), pose)

    return DrawList(
        (
            instance(box(), (0.75, 0.75, 0.72), [4.0, 4.0, 0.1], [0.0, 0.0, -0.05]),
            instance(sphere(12, 7), (0.85, 0.3, 0.2), [0.5, 0.5, 0.5], [-0.45, 0.0, 0.5]),
            instance(cylinder(10), (0.2, 0.5, 0.8), [0.3, 0.3, 0.9], [0.55, 0.35, 0.45]),
            instance(box(), (0.3, 0.65, 0.35), [0.5, 0.4, 0.35], [0.35, -0.6, 0.175]),
        )
    )


def camera() -> Camera:
    """Return a camera above the scene."""
    pose = look_at((0.3, -2.9, 1.7), (0.05, 0.0, 0.42), (0.0, 0.0, 1.0))
    return Camera(WIDTH, HEIGHT, 76.0, 76.0, WIDTH / 2, HEIGHT / 2, 0.1, np.inf, pose)


def enlarged(image: NDArray[np.uint8]) -> NDArray[np.uint8]:
    """Return an image with each pixel as a square of SCALE x SCALE."""
    return np.repeat(np.repeat(image, SCALE, 0), SCALE, 1)


def triangles(draw_list: DrawList, view: Camera) -> NDArray[np.uint8]:
    """Return the edges of all triangles over the pixel grid, and the lower end of the first band."""
    canvas = np.full((HEIGHT * SCALE, WIDTH * SCALE, 3), 255, np.uint8)
    canvas[::SCALE], canvas[:, ::SCALE] = GREY, GREY
    for instance in draw_list.instances:
        X_camera_mesh = view.X_camera_world @ instance.X_world_mesh
        points = instance.mesh.positions @ X_camera_mesh[:3, :3].T + X_camera_mesh[:3, 3]
        pixels = points[:, :2] / points[:, 2:] * (view.fx, view.fy) + (view.cx, view.cy)
        color = tuple(int(200 * value) for value in instance.material.base_color[:3])
        corners = np.rint(pixels[instance.mesh.elements] * (SCALE * 16)).astype(np.int32)
        cv2.polylines(canvas, list(corners), True, color, 1, cv2.LINE_AA, 4)
    canvas[BAND_ROWS * SCALE - 1 : BAND_ROWS * SCALE + 1] = (200, 60, 60)
    return canvas


def colors_of(ids: NDArray[np.integer]) -> NDArray[np.uint8]:
    """Return a colour for each id; background is light grey."""
    palette = np.random.default_rng(3).integers(60, 230, (int(ids.max()) + 1, 3)).astype(np.uint8)
    return np.where((ids >= 0)[..., None], palette[np.maximum(ids, 0)], np.uint8(236))


def spans(ids: NDArray[np.int32]) -> NDArray[np.uint8]:
    """Return the visible primitives with a dark first pixel of each span."""
    image = colors_of(ids)
    starts = np.ones(ids.shape, np.bool_)
    starts[:, 1:] = ids[:, 1:] != ids[:, :-1]
    image[starts & (ids >= 0)] //= 3
    return image


def main() -> None:
    draw_list, view, renderer = scene(), camera(), CpuRenderer(1)
    ids = renderer.visibility(draw_list, view).ids
    frame = renderer.render(
        draw_list, view, Output.COLOR | Output.DEPTH | Output.NORMAL, Look("studio", (236, 236, 236), 4)
    )
    assert frame.color is not None
    assert frame.depth is not None
    assert frame.normal is not None
    near, far = 2.0, 4.6
    depth = np.uint8(236) - np.clip(200 * (far - frame.depth) / (far - near), 0, 200).astype(np.uint8)
    panels = {
        "1, 2  vertices in pixels; bands of 32 rows": triangles(draw_list, view),
        "3, 4  visibility buffer: one primitive per pixel": enlarged(colors_of(ids)),
        "5  spans: dark is the first pixel of each": enlarged(spans(ids)),
        "depth": enlarged(np.repeat(depth[..., None], 3, 2)),
        "normals": enlarged((127.5 * (frame.normal * (1, -1, -1) + 1.0)).astype(np.uint8)),
        "6  colour, look studio, 4 samples": enlarged(frame.color),
    }
    tiles = []
    for caption, image in panels.items():
        tile = np.full((image.shape[0] + CAPTION_ROWS, image.shape[1] + 8, 3), 255, np.uint8)
        tile[CAPTION_ROWS:, 4:-4] = image
        cv2.putText(tile, caption, (5, 18), cv2.FONT_HERSHEY_SIMPLEX, 0.5, (40, 40, 40), 1, cv2.LINE_AA)
        tiles.append(tile)
    whole = np.vstack([np.hstack(tiles[:3]), np.hstack(tiles[3:])])
    cv2.imwrite(sys.argv[1], whole[..., ::-1], [cv2.IMWRITE_WEBP_QUALITY, 80])


if __name__ == "__main__":
    main()
