"""Kernel of ``light_on_sensor``: light on the sensor from a rendered image."""

import numpy as np

from renderers.compiler.device_function import inlined
from renderers.compiler.jit import kernel
from renderers.compiler.kernel_types import F32, F64, I64, Array1, Array2, Array3, f32, i32, u16
from renderers.stereo.sensor.exposure import LIGHT_WHITE


@inlined
def _mix_channels(roots: Array1[np.uint32], weights: Array1[np.float32], scene: Array1[np.float32]) -> None:
    """Write one channel of a row's light, from ``Frame.roots``, between the ends of ``scene``.

    ``weights`` are those of the squares of red's, green's and blue's roots.
    """
    for column in range(len(scene) - 2):
        three = i32(roots[column])
        red, green, blue = f32(three & 2047), f32(three >> 11 & 2047), f32(three >> 22 & 1023)
        scene[column + 1] = weights[0] * red * red + weights[1] * green * green + weights[2] * blue * blue


@inlined
def _light_scene(
    scene: Array1[np.float32],
    factors: Array1[np.float32],
    dots: Array1[np.uint16],
    dot_unit: F32,
    has_dots: bool,
    has_factors: bool,
) -> None:
    """Multiply a row's light, between the ends of ``scene``, by the factors, and by what the projector adds."""
    width = len(scene) - 2
    if has_dots:
        for column in range(width):
            scene[column + 1] *= factors[column] + dot_unit * f32(dots[column])
    elif has_factors:
        for column in range(width):
            scene[column + 1] *= factors[column]


@inlined
def _blur_along_row(scene: Array1[np.float32], center: F32, outer: F32, blurred: Array1[np.float32]) -> None:
    """Write a row's light blurred along the row; the ends of ``scene`` become copies of their neighbours."""
    width = len(blurred)
    scene[0], scene[width + 1] = scene[1], scene[width]
    for column in range(width):
        blurred[column] = scene[column + 1] * center + (scene[column] + scene[column + 2]) * outer


@inlined
def _write_row(
    above: Array1[np.float32],
    here: Array1[np.float32],
    below: Array1[np.float32],
    center: F32,
    outer: F32,
    falloff: Array1[np.float32],
    has_falloff: bool,
    light: Array2[np.uint16],
    channel: I64,
) -> None:
    """Write a row of the light image from three rows blurred along x, times the vignetting if there is any."""
    white, half, maximum = f32(LIGHT_WHITE), f32(0.5), f32(65535.0)
    if has_falloff:
        for column in range(len(here)):
            value = here[column] * center + (above[column] + below[column]) * outer
            root = np.sqrt(value * falloff[column]) * white + half
            light[column, channel] = u16(i32(min(root, maximum)))
    else:
        for column in range(len(here)):
            value = here[column] * center + (above[column] + below[column]) * outer
            light[column, channel] = u16(i32(min(np.sqrt(value) * white + half, maximum)))


@inlined
def _vignette(y: F64, x_squared: Array1[np.float32], falloff: Array1[np.float32]) -> None:
    """Write the falloff cos^3 of a row; ``y`` and the root of ``x_squared``: position over the focal length."""
    inv_cosine_base = f32(1.0 + y * y)
    for column in range(len(falloff)):
        inv_cosine_squared = inv_cosine_base + x_squared[column]
        falloff[column] = f32(1.0) / (inv_cosine_squared * np.sqrt(inv_cosine_squared))


@kernel
def light_rows(
    roots: Array2[np.uint32],
    dots: Array2[np.uint16],
    dot_unit: F64,
    factors: Array2[np.float32],
    weights: Array2[np.float32],
    neighbour_weight: F64,
    cx: F64,
    cy: F64,
    inv_focal: F64,
    light: Array3[np.uint16],
) -> None:
    """Write a light image, (H, W, C).

    Args:
        roots: (H, W or more), see ``Frame.roots``.
        dots: (H, W), the projector's light; (1, 1): the projector is off.
        dot_unit: light that 1 in ``dots`` adds, relative to the rendered light.
        factors: (H, W or more), factors of the rendered light; one row: 1.
        weights: (C, 3), of the squares of red's, green's and blue's roots in each channel.
        neighbour_weight: weight of each of both neighbours in the filter of three taps along rows and along columns.
        inv_focal: 1 / focal length, 1/pixels; 0: no vignetting.
    """
    height, width, channels = light.shape
    outer = f32(neighbour_weight)
    center = f32(1.0) - outer - outer
    has_dots, has_factors = dots.shape[0] == height and height > 1, factors.shape[0] > 1
    # Light of one row with its ends repeated, and the last three rows, blurred along x.
    scene, no_factors = np.empty(width + 2, np.float32), np.ones(width, np.float32)
    blurred = np.empty((3, width), np.float32)
    falloff, x_squared = np.empty(width, np.float32), np.empty(width, np.float32)
    for column in range(width):
        x = (column + 0.5 - cx) * inv_focal
        x_squared[column] = f32(x * x)
    for channel in range(channels):
        for source_row in range(height + 1):
            if source_row < height:
                _mix_channels(roots[source_row], weights[channel], scene)
                row_dots = dots[source_row if has_dots else 0]
                row_factors = factors[source_row] if has_factors else no_factors
                _light_scene(scene, row_factors, row_dots, f32(dot_unit), has_dots, has_factors)
                _blur_along_row(scene, center, outer, blurred[source_row % 3])
            row = source_row - 1
            if row < 0:
                continue
            if inv_focal != 0.0:
                _vignette((row + 0.5 - cy) * inv_focal, x_squared, falloff)
            above, here, below = blurred[max(row - 1, 0) % 3], blurred[row % 3], blurred[min(row + 1, height - 1) % 3]
            _write_row(above, here, below, center, outer, falloff, inv_focal != 0.0, light[row], channel)
