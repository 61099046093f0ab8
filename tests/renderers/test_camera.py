"""Validation of cameras, and the transfer functions of colours."""

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from renderers.camera import OPENGL_FROM_OPTICAL, Camera
from renderers.color import (
    LINEAR_FROM_BYTE,
    linear_colors_from_srgb,
    linear_from_srgb,
    linear_values_from_srgb,
    srgb_from_linear,
    srgb_values_from_linear,
)

CAMERA = Camera(4, 3, 2.0, 2.5, 1.9, 1.4, 0.1, 10.0, np.eye(4))


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"width": 0}, "camera size 0x3 must be at least 1x1"),
        ({"height": 0}, "camera size 4x0 must be at least 1x1"),
        ({"fx": 0.0}, r"focal lengths \(0.0, 2.5\) must be positive and finite"),
        ({"fy": -1.0}, r"focal lengths \(2.0, -1.0\)"),
        ({"fx": math.inf}, "focal lengths"),
        ({"fy": math.nan}, "focal lengths"),
        ({"cx": math.nan}, r"principal point \(nan, 1.4\) must be finite"),
        ({"cy": math.inf}, "principal point"),
        ({"near": 0.0}, "clipping planes must satisfy 0 < near < far, got near=0.0, far=10.0"),
        ({"near": 10.0}, "clipping planes"),
        ({"far": math.nan}, "clipping planes"),
        ({"X_world_camera": np.eye(3)}, r"must be a finite \(4, 4\) matrix"),
        ({"X_world_camera": np.full((4, 4), math.nan)}, r"must be a finite \(4, 4\) matrix"),
    ],
)
def test_invalid_cameras(changes: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(CAMERA, **changes)


def test_limits_of_valid_cameras() -> None:
    assert replace(CAMERA, width=1, height=1, far=math.inf, cx=-5.0).far == math.inf


def test_inverse_pose() -> None:
    X = np.eye(4)
    X[:3, :3] = ((0, -1, 0), (1, 0, 0), (0, 0, 1))
    X[:3, 3] = (1, 2, 3)
    inverse = replace(CAMERA, X_world_camera=X).X_camera_world
    np.testing.assert_allclose(inverse @ X, np.eye(4), atol=1e-15)
    assert inverse.dtype == np.float64


def test_opengl_cameras_look_backwards_with_y_up() -> None:
    np.testing.assert_array_equal(OPENGL_FROM_OPTICAL @ (1, 2, 3, 1), (1, -2, -3, 1))


def test_srgb_of_both_branches() -> None:
    assert srgb_from_linear(0.5) == pytest.approx(0.735356983)
    assert linear_from_srgb(0.5) == pytest.approx(0.214041140)
    assert srgb_from_linear(0.0031308) == pytest.approx(0.04045, abs=1e-6)
    assert srgb_from_linear(0.002) == pytest.approx(0.02584)
    assert linear_from_srgb(0.04) == pytest.approx(0.04 / 12.92)
    assert srgb_from_linear(-0.1) == pytest.approx(-1.292)


def test_arrays_follow_the_scalar_functions() -> None:
    values = np.linspace(0.0, 1.2, 200)
    np.testing.assert_allclose(linear_values_from_srgb(values), [linear_from_srgb(v) for v in values])
    np.testing.assert_allclose(srgb_values_from_linear(values), [srgb_from_linear(v) for v in values])
    np.testing.assert_allclose(srgb_values_from_linear(linear_values_from_srgb(values)), values, atol=1e-6)
    assert (LINEAR_FROM_BYTE[0], LINEAR_FROM_BYTE[255], LINEAR_FROM_BYTE.shape) == (0.0, 1.0, (256,))
    assert LINEAR_FROM_BYTE[188] == np.float32(linear_from_srgb(188 / 255))


def test_many_colours_are_decoded_as_single_ones() -> None:
    colors = np.random.default_rng(0).random((20_000, 4), np.float32)
    expected = np.column_stack((linear_values_from_srgb(colors[:, :3].copy()), colors[:, 3]))
    np.testing.assert_array_equal(linear_colors_from_srgb(colors), expected)


@pytest.mark.parametrize("columns", [3, 4])
def test_alpha_is_not_encoded(columns: int) -> None:
    colors = np.full((2, columns), 0.5, np.float32)
    linear = linear_colors_from_srgb(colors)
    np.testing.assert_allclose(linear[:, :3], 0.21404114, rtol=1e-6)
    assert linear[:, 3:].tolist() == [[0.5]] * 2 if columns == 4 else linear.shape == (2, 3)
    assert (colors == 0.5).all()
