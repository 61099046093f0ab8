"""Triangles whose light is a polynomial over the picture, against light at every pixel."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from renderers.camera import Camera
from renderers.drawlist import DrawList, Material, Mesh
from renderers.port import Look
from tests.renderers.shading_reference import ball, placed, quad
from tests.renderers.test_shading_scalar import both, both_sided

CAMERA = Camera(250, 190, 220.0, 210.0, 120.3, 97.8, 0.05, 100.0, np.eye(4))


def off(mesh: Mesh, material: Material, camera: Camera = CAMERA, *, z: float = 0.0) -> tuple[int, float]:
    """The largest difference, and the share of values that differ."""
    ours, scalar = both(both_sided(DrawList((placed(mesh, material, z=z),))), camera, Look("pbr"))
    differences = np.abs(ours - scalar)
    return int(differences.max()), float((differences != 0).mean())


@pytest.mark.parametrize("rings", [4, 12, 30])
@pytest.mark.parametrize("roughness", [0.0, 0.1, 0.3, 0.6, 1.0])
@pytest.mark.parametrize("metallic", [0.0, 0.5, 1.0])
def test_balls_to_a_level(rings: int, metallic: float, roughness: float) -> None:
    material = Material((0.9, 0.3, 0.0, 1.0), metallic=metallic, roughness=roughness)
    worst, share = off(ball(rings), material, z=3.0)
    assert worst <= 1
    assert share < 0.02


def test_what_is_smooth_is_a_polynomial() -> None:
    """It rounds otherwise where it is close to half a level, and is not the same to the last bit."""
    _, share = off(ball(12), Material((0.8, 0.5, 0.3, 1.0), metallic=0.0, roughness=0.6), z=3.0)
    assert share > 0.001


def test_emission_up_to_white() -> None:
    for emissive in ((1.0, 1.0, 1.0), (0.9, 0.97, 5.0), (0.0, 0.8, 0.85)):
        material = Material((0.9, 0.9, 0.9, 1.0), metallic=0.0, roughness=0.7, emissive=emissive)
        assert off(ball(12), material, z=3.0)[0] <= 1


def test_a_reflection_within_a_triangle() -> None:
    """Normals that turn by much more than a reflection is wide, which lies between the corners, at any place."""
    rng = np.random.default_rng(0)
    for roughness in (0.0, 0.2, 0.4):
        for _ in range(20):
            normals = np.array((0.0, 0.0, -1.0)) + rng.normal(scale=0.3, size=(4, 3)) * (1, 1, 0.2)
            mesh = quad(1.0, 2.5, normals=normals.astype(np.float32))
            assert off(mesh, Material((0.9, 0.8, 0.3, 1.0), roughness=roughness))[0] <= 1


def test_normals_of_any_length_and_turn() -> None:
    rng = np.random.default_rng(1)
    for turn in (0.02, 0.1, 0.3, 1.0):
        for _ in range(10):
            normals = (rng.normal(size=3) * (0.7, 0.7, 0) - (0, 0, 1)) + turn * rng.normal(size=(4, 3))
            mesh = quad(1.0, 2.5, normals=(normals * rng.uniform(0.1, 10.0, (4, 1))).astype(np.float32))
            assert off(mesh, Material((0.2, 0.8, 0.3, 1.0), metallic=0.3, roughness=float(rng.random())))[0] <= 1


def test_through_the_near_plane_and_out_of_sight() -> None:
    """Corners behind the camera, and beside the picture at any angle."""
    floor = np.array(((-3, 1, -2), (-3, 1, 40), (3, 1, 40), (3, 1, -2)), np.float32)
    bent = np.array(((0.2, -1, 0), (0, -1, 0.1), (-0.2, -1, 0), (0, -1, -0.1)), np.float32)
    for camera in (CAMERA, replace(CAMERA, fx=60.0, fy=60.0)):
        for positions in (floor, floor + np.array((0, 0, 2.3), np.float32)):
            mesh = replace(quad(), positions=positions, normals=bent)
            assert off(mesh, Material((0.9, 0.8, 0.7, 1.0), metallic=0.0, roughness=0.8), camera)[0] <= 1


def test_slivers() -> None:
    """Hardly higher than a pixel, at any angle."""
    for turn in np.linspace(0.0, np.pi, 30):
        along, across = np.array((np.cos(turn), np.sin(turn), 0.0)), np.array((-np.sin(turn), np.cos(turn), 0.0))
        for height in (0.5, 1.6, 4.0):
            thin = across * height * 2.5 / 220.0
            around = np.array((-along, along * 0.9 + thin * 0.1, along + thin, -along + thin))
            corners = around + np.array((0, 0, 2.5))
            normals = np.array((0, 0, -1)) + 0.3 * np.array((along, across, -along, -across))
            mesh = replace(quad(), positions=corners.astype(np.float32), normals=normals.astype(np.float32))
            assert off(mesh, Material((0.5, 0.8, 0.7, 1.0), metallic=0.0, roughness=0.8))[0] <= 1
