"""Interpolation along lines, against float64: the depth and colour of the points that pixels see."""

from __future__ import annotations

import numpy as np
import pytest
from numba import njit

from renderers.camera import Camera
from renderers.compiler.pointers import address_of, f32_at, i32_at
from renderers.drawlist import DrawList, Instance, Material, Mesh
from renderers.raster import CpuRenderer
from renderers.shading import prepare
from renderers.shading.interpolation import interpolate
from renderers.shading.layout import INSTANCE_MATRICES, SHADING_JOB, STRIDE, shading_job_at
from renderers.shading.scene import fill_shading_job
from renderers.shading.span_setup import set_up_spans
from renderers.shading.spans import begin_rows, find_spans, next_part, row_memory, segment_end, select_instance

CAMERA = Camera(61, 47, 40.0, 44.0, 30.2, 23.6, 0.05, 100.0, np.eye(4))


@njit(error_model="numpy")
def interpolated(job_address, ids_address, width, height, points_address, colors_address):  # type: ignore[no-untyped-def]
    """Fill the point and the vertex colour at each pixel of an image that shows one instance.

    Args:
        points_address: address of (height, width, 3) float32.
        colors_address: address of (height, width, 4) float32.
    """
    memory = np.empty(row_memory(width), np.int64)
    segment, row_ids = begin_rows(shading_job_at(job_address), np.int64(memory.ctypes.data), width)
    points, colors, starts = f32_at(points_address), f32_at(colors_address), segment.starts
    for y in range(height):
        ids = i32_at(ids_address + 4 * y * width)
        span_count = find_spans(segment, y, np.int64(0), ids, width, row_ids)
        span = np.int64(0)
        while span < span_count:
            if segment.ids[span] < 0:
                span = segment_end(segment, span, span_count, np.int64(-1), np.int64(0))
                continue
            end_span = segment_end(segment, span, span_count, np.int64(0), np.int64(2**31 - 1))
            select_instance(segment, np.int64(0))
            begin, end = np.int64(starts[span]), np.int64(starts[end_span])
            part_end, part_end_span = next_part(segment, span, begin, end)  # the image is narrower than a part
            set_up_spans(segment, span, part_end_span, end_span)
            interpolate(segment, begin, part_end)
            for x in range(begin, part_end):
                for k in range(3):
                    points[3 * (y * width + x) + k] = segment.pixels.point[k * STRIDE + x - begin]
                for k in range(4):
                    colors[4 * (y * width + x) + k] = segment.pixels.color[k * STRIDE + x - begin]
            span = end_span
    memory[0] = 0  # the pointers above do not keep the array alive


def nearest_on_line(p: np.ndarray, q: np.ndarray, ray: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Return where along p -> q (0 .. 1) rays pass, measured along the line's image, and the depth there.

    Args:
        ray: (n, 3), directions of the pixels with z = 1.
    """
    image_p, image_q = p[:2] / p[2], q[:2] / q[2]
    along = image_q - image_p
    share = np.clip((ray[:, :2] - image_p) @ along / (along @ along), 0.0, 1.0)
    # 1/z is linear along the image of the line.
    inv_z = (1.0 - share) / p[2] + share / q[2]
    return share / q[2] / inv_z, 1.0 / inv_z


@pytest.mark.parametrize("seed", range(4))
def test_depth_and_color_along_lines_in_the_studio_look(seed: int) -> None:
    rng = np.random.default_rng(seed)
    ends = rng.uniform((-1.5, -1.2, 1.0), (1.5, 1.2, 6.0), (8, 2, 3)).astype(np.float32)
    colors = np.tile(np.array(((1, 0, 0, 1), (0, 1, 0, 1)), np.float32), (8, 1))
    mesh = Mesh(ends.reshape(-1, 3), np.arange(16, dtype=np.uint32).reshape(-1, 2), colors=colors)
    instance = Instance(mesh, Material(line_width=1.0), np.eye(4))
    scene = DrawList((instance,))
    height, width = CAMERA.height, CAMERA.width
    shading = prepare(scene.instances, "studio")
    with CpuRenderer(threads=1).visibility(scene, CAMERA) as visible:
        matrices = np.empty(1, INSTANCE_MATRICES.dtype)
        job = np.zeros(1, SHADING_JOB.dtype)
        fill_shading_job(
            job,
            shading,
            CAMERA,
            address_of(visible.first_ids, np.int64),
            address_of(visible.X_camera_mesh, np.float64),
            address_of(matrices, INSTANCE_MATRICES.dtype),
        )
        points = np.full((height, width, 3), np.nan, np.float32)
        shown = np.full((height, width, 4), np.nan, np.float32)
        ids = visible.ids.copy()
        interpolated(
            address_of(job, SHADING_JOB.dtype),
            address_of(ids, np.int32),
            width,
            height,
            address_of(points, np.float32),
            address_of(shown, np.float32),
        )
    assert len(np.unique(ids[ids >= 0])) >= 5
    for k in np.unique(ids[ids >= 0]):
        rows, columns = np.nonzero(ids == k)
        ray = np.stack(((columns + 0.5 - CAMERA.cx) / CAMERA.fx, (rows + 0.5 - CAMERA.cy) / CAMERA.fy), -1)
        t, z = nearest_on_line(ends[k, 0].astype(np.float64), ends[k, 1].astype(np.float64), ray)
        np.testing.assert_allclose(shown[rows, columns, :2], np.stack((1.0 - t, t), -1), atol=1e-5)
        inside = (t > 0.0) & (t < 1.0)
        np.testing.assert_allclose(points[rows, columns, 2][inside], z[inside], rtol=1e-5)
