"""Writers against OpenCV's and the glTF reader against trimesh, in one run, interleaved.

    python -m bench.codecs

Pictures are our own renderings: recorded scenes where SCENEGATE_CORPUS names them, else spheres. Medians of CPU ms of
one thread. Every file is read back bit for bit by Pillow and, depth, by tifffile; ``bytes`` are ours over OpenCV's
default. The reader's table says what its columns are.
"""

import io
from collections.abc import Callable, Iterator
from functools import partial

import cv2
import numpy as np
import tifffile
from PIL import Image

from bench import gltf, render_requests
from bench.table import Row, at_least, geometric_mean, heading, show
from bench.turns import in_turns, median, timed
from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.form import FormReader
from gateway.adapters.render.pipeline import camera_of, posted_document
from gateway.adapters.render.scenes import SceneStore
from gateway.runtime.kernels import parts
from gateway.runtime.kernels.parts import ensure_compiled
from gateway.runtime.workers.process_tuning import freeze_gc, tune
from renderers.depth_range import depth_in_millimetres
from renderers.encode import png_gray16, png_rgb, tiff_float32
from renderers.interface import Look, Output
from renderers.raster import CpuRenderer

RUNS = 21
SIZES = ((640, 480), (1920, 1080))
GOALS = {"PNG, RGB": 5.0, "PNG, 16 bit": 5.0, "TIFF, 32-bit float": 2.0}
LARGEST = 1.2


def pictures() -> Iterator[tuple[str, render_requests.Array, render_requests.Array]]:
    """Name, colour (H, W, 3) uint8 and depth (H, W) float32."""
    folder = render_requests.corpus()
    scenes = [render_requests.recorded(folder, number, "color") for number in ("001", "003", "010")] if folder else []
    scenes.append(render_requests.textured("color", copies=6, side=512))
    renderer, config = CpuRenderer(), RenderConfig()
    store = SceneStore(config)
    for scene in scenes:
        for width, height in SIZES:
            form = FormReader(render_requests.CONTENT_TYPE, config)
            form.feed(scene.next_body(width, height))
            request = form.request()
            prepared = store.get(posted_document(request, store))
            camera = camera_of(request, prepared)
            frame = renderer.render(prepared.draw_list, camera, Output.COLOR | Output.DEPTH, Look("phong"))
            assert frame.color is not None
            assert frame.depth is not None
            yield f"{scene.name} {width}×{height}", frame.color, frame.depth


def encoded(suffix: str, image: render_requests.Array) -> bytes:
    """By OpenCV with its own defaults; TIFF without compression, which is its fastest."""
    options = (cv2.IMWRITE_TIFF_COMPRESSION, 1) if suffix == ".tiff" else ()
    return bytes(cv2.imencode(suffix, image, options)[1])


def check(kind: str, data: bytes, image: render_requests.Array) -> None:
    """Raises unless independent readers give the very same samples."""
    with Image.open(io.BytesIO(data)) as opened:
        np.testing.assert_array_equal(np.asarray(opened), image)
    if kind.startswith("TIFF"):
        np.testing.assert_array_equal(tifffile.imread(io.BytesIO(data)).reshape(image.shape), image)


def writers() -> list[Row]:
    """PNG and TIFF."""
    ratios: dict[str, list[float]] = {}
    times_of: dict[str, list[tuple[float, float]]] = {}
    sizes: dict[str, list[float]] = {}
    print(heading("image", "file", "ours, ms", "OpenCV, ms", "ratio", "bytes", "of OpenCV's"))
    for name, color, depth in pictures():
        bgr, grey = np.ascontiguousarray(color[..., ::-1]), depth_in_millimetres(depth)
        jobs: dict[str, tuple[render_requests.Array, Callable[[], bytes], Callable[[], bytes]]] = {
            "PNG, RGB": (color, partial(png_rgb, color), partial(encoded, ".png", bgr)),
            "PNG, 16 bit": (grey, partial(png_gray16, grey), partial(encoded, ".png", grey)),
            "TIFF, 32-bit float": (depth, partial(tiff_float32, depth), partial(encoded, ".tiff", depth)),
        }
        for kind, (image, ours, theirs) in jobs.items():
            check(kind, ours(), image)
            jobs_in_turns = {"ours": lambda _, ours=ours: timed(ours), "OpenCV": lambda _, theirs=theirs: timed(theirs)}
            times = in_turns(jobs_in_turns, RUNS, turn=1)
            mine, other = median(times["ours"]).cpu, median(times["OpenCV"]).cpu
            size, reference = len(ours()), len(theirs())
            ratios.setdefault(kind, []).append(other / mine)
            times_of.setdefault(kind, []).append((mine, other))
            sizes.setdefault(kind, []).append(size / reference)
            figures = f"{mine:.2f} | {other:.2f} | {other / mine:.1f} | {size} | {size / reference:.2f}"
            print(f"| {name} | {kind} | {figures} |", flush=True)
    rows = []
    for kind, goal in GOALS.items():
        mine, other = (geometric_mean(column) for column in zip(*times_of[kind], strict=True))
        cell = f"{mine:.2f} ms (least {min(ratios[kind]):.1f}×)"
        what = f"{kind} writer (geometric mean)"
        rows.append(at_least(what, cell, f"OpenCV {other:.2f} ms", geometric_mean(ratios[kind]), goal))
        largest = max(sizes[kind])
        mean = geometric_mean(sizes[kind])
        what = f"{kind}: bytes of the file (geometric mean)"
        rows.append(Row(what, f"largest {largest:.2f}×", "OpenCV", f"{mean:.2f}×", f"≤ {LARGEST}×", mean <= LARGEST))
    return rows


def main() -> None:
    tune()  # as the server does
    ensure_compiled()
    parts.load_needed()
    freeze_gc()
    cv2.setNumThreads(1)
    rows = writers()
    show([*rows, *gltf.rows()])


if __name__ == "__main__":
    main()
