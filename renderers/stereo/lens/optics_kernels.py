"""Kernel of ``optics``: light on the sensor from a rendered image."""

from __future__ import annotations

import numpy as np

from renderers.compiler.jit import kernel
from renderers.stereo.sensor.exposure import LIGHT_WHITE


@kernel(
    "void(uint8[:,:,::1], uint16[:,::1], float64, uint8[:,::1], uint8[::1], float32[:,:,::1], float64, "
    "float64, float64, float64, uint16[:,:,::1])"
)
def light_rows(
    rendered, dots, dot_unit, factors, background, light_of_level, neighbour_weight, cx, cy, inv_focal, light
):  # fmt: skip
    """Write a light image.

    Args:
        rendered: (H, W, 3) uint8 RGB.
        dots: (H, W) uint16, the projector's light; (1, 1): the projector is off.
        dot_unit: light that 1 in ``dots`` adds, relative to the rendered light.
        factors: (ceil(H / 2), ceil(W / 2)) uint8, factors of the rendered light, units of 1/64; (1, 1): 1.
        background: (3,) uint8 RGB of pixels to which no factor applies.
        light_of_level: (C, 3, 256) float32, light that each level of red, green and blue adds to each channel.
        neighbour_weight: weight of each of both neighbours in the filter of three taps along rows and along columns.
        cx: principal point, pixels from the left edge.
        cy: principal point, pixels from the top edge.
        inv_focal: 1 / focal length, 1/pixels; 0: no vignetting.
        light: (H, W, C) uint16, output.
    """
    height, width, channels = light.shape
    one, half, outer = np.float32(1.0), np.float32(0.5), np.float32(neighbour_weight)
    center = one - outer - outer
    white, maximum = np.float32(LIGHT_WHITE), np.float32(65535.0)
    has_dots, has_factors = dots.shape[0] == height and height > 1, factors.shape[0] > 1
    # Light of one row and its factors, each with its ends repeated; and the last three rows, blurred along x.
    scene = np.empty(width + 2, np.float32)
    scene_factor = np.ones(width, np.float32)
    unit = np.float32(dot_unit)
    half_width = factors.shape[1]
    factor_row = np.empty(half_width + 2, np.float32)
    blurred = np.empty((3, width), np.float32)
    falloff = np.empty(width, np.float32)
    x_squared = np.empty(width, np.float32)
    for column in range(width):
        x = (column + 0.5 - cx) * inv_focal
        x_squared[column] = np.float32(x * x)
    for channel in range(channels):
        red, green, blue = light_of_level[channel, 0], light_of_level[channel, 1], light_of_level[channel, 2]
        for source_row in range(height + 1):
            if source_row < height:
                for column in range(width):
                    scene[column + 1] = (
                        red[rendered[source_row, column, 0]]
                        + green[rendered[source_row, column, 1]]
                        + blue[rendered[source_row, column, 2]]
                    )
                if has_factors:
                    # Quadratic B-splines; linear interpolation would show the coarse pixels at edges. A row's centre
                    # lies a quarter of a coarse row beside that of its coarse row: weights of 22, 9 and 1, in 1/32.
                    near_row = min(source_row >> 1, factors.shape[0] - 1)
                    step = (source_row & 1) * 2 - 1
                    far_row = min(max(near_row + step, 0), factors.shape[0] - 1)
                    opposite_row = min(max(near_row - step, 0), factors.shape[0] - 1)
                    scale = np.float32(1.0 / 65536.0)  # 32 for the rows, 32 for the columns, 64 for the factor 1
                    for x_half in range(half_width):
                        value = (
                            np.int32(22) * factors[near_row, x_half]
                            + np.int32(9) * factors[far_row, x_half]
                            + np.int32(factors[opposite_row, x_half])
                        )
                        factor_row[x_half + 1] = np.float32(value) * scale
                    factor_row[0], factor_row[half_width + 1] = factor_row[1], factor_row[half_width]
                    for column in range(width):
                        near = (column >> 1) + 1
                        step = (column & 1) * 2 - 1
                        factor = (
                            np.float32(22.0) * factor_row[near]
                            + np.float32(9.0) * factor_row[near + step]
                            + factor_row[near - step]
                        )
                        is_background = (
                            (rendered[source_row, column, 0] == background[0])
                            & (rendered[source_row, column, 1] == background[1])
                            & (rendered[source_row, column, 2] == background[2])
                        )
                        scene_factor[column] = one if is_background else factor
                if has_dots:
                    for column in range(width):
                        scene[column + 1] *= scene_factor[column] + unit * np.float32(dots[source_row, column])
                elif has_factors:
                    for column in range(width):
                        scene[column + 1] *= scene_factor[column]
                scene[0], scene[width + 1] = scene[1], scene[width]
                target = source_row % 3
                for column in range(width):
                    blurred[target, column] = scene[column + 1] * center + (scene[column] + scene[column + 2]) * outer
            row = source_row - 1
            if row < 0:
                continue
            above, here, below = max(row - 1, 0) % 3, row % 3, min(row + 1, height - 1) % 3
            if inv_focal != 0.0:
                y = (row + 0.5 - cy) * inv_focal
                inv_cosine_base = np.float32(1.0 + y * y)
                for column in range(width):
                    inv_cosine_squared = inv_cosine_base + x_squared[column]
                    falloff[column] = one / (inv_cosine_squared * np.sqrt(inv_cosine_squared))
                for column in range(width):
                    value = blurred[here, column] * center + (blurred[above, column] + blurred[below, column]) * outer
                    root = np.sqrt(value * falloff[column]) * white + half
                    light[row, column, channel] = np.uint16(np.int32(min(root, maximum)))
            else:
                for column in range(width):
                    value = blurred[here, column] * center + (blurred[above, column] + blurred[below, column]) * outer
                    light[row, column, channel] = np.uint16(np.int32(min(np.sqrt(value) * white + half, maximum)))
