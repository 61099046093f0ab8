"""The light of the page: the rig of the gateway's images, as the page's renderer reads it."""

import math
from functools import lru_cache
from typing import Final

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.adapters.viewer import messages
from gateway.adapters.viewer.frames import FrameBuilder
from renderers.light_rig import Rig, Surroundings
from renderers.shading.studio.environment_image import SurroundingsError, radiance_of
from renderers.shading.studio.octahedral import equirect_directions

ENVIRONMENT_SIZE: Final = (64, 128)
"""Height and width of the environment that the page reflects, pixels."""


@lru_cache(8)
def encode_light(rig: Rig) -> bytes:
    """Return the frame with a rig's lights and environment. An environment that cannot be decoded is black."""
    radiance = np.zeros((*ENVIRONMENT_SIZE, 3), np.float32)
    if rig.surroundings is not None:
        radiance = _small_radiance(rig.surroundings)
    lights = []
    for light in rig.lights:
        red, green, blue = light.color
        lights.append(
            messages.PageLight(
                type=light.kind.value,
                color=(light.intensity * red, light.intensity * green, light.intensity * blue),
                position=light.position,
                direction=light.direction,
                range=light.range or 0.0,
                inner_cone=light.inner_cone,
                outer_cone=light.outer_cone,
                casts_shadow=light.casts_shadow and rig.shadow_size > 0,
            )
        )
    builder = FrameBuilder()
    environment = builder.add_array(radiance)
    return builder.finish(
        messages.PageLighting(
            lights=lights,
            ambient=_harmonics(radiance),
            environment=environment,
            size=ENVIRONMENT_SIZE,
            exposure=rig.exposure,
            tone=rig.tone,
        )
    )


def _small_radiance(surroundings: Surroundings) -> NDArray[np.float32]:
    """Return the environment, rotated by its ``turn``, as an image of ``ENVIRONMENT_SIZE``, (H, W, 3) float32."""
    try:
        radiance = radiance_of(surroundings)
    except SurroundingsError:
        return np.zeros((*ENVIRONMENT_SIZE, 3), np.float32)
    height, width = ENVIRONMENT_SIZE
    small = cv2.resize(radiance, (width, height), interpolation=cv2.INTER_AREA)
    turned: NDArray[np.float32] = np.roll(small, -round(surroundings.turn / (2.0 * math.pi) * width), axis=1)
    return turned.astype(np.float32)


def _harmonics(radiance: NDArray[np.float32]) -> list[float]:
    """Return the nine spherical harmonics of an equirectangular image, 27 values, in the order of three.js.

    Their irradiance differs from the renderer's table by 2.5 % (root mean square; 9 % at most) for the default rig.
    """
    height, width = radiance.shape[:2]
    row_edges = np.cos(math.pi * np.arange(height + 1) / height)
    solid_angles = np.repeat((row_edges[:-1] - row_edges[1:]) * (2.0 * math.pi / width), width)
    x, y, z = equirect_directions(height, width).reshape(-1, 3).T
    basis = np.stack(
        (
            np.full_like(x, 0.282095),
            *(0.488603 * axis for axis in (y, z, x)),
            *(1.092548 * product for product in (x * y, y * z)),
            0.315392 * (3.0 * z * z - 1.0),
            1.092548 * x * z,
            0.546274 * (x * x - y * y),
        )
    )
    coefficients: list[float] = ((basis * solid_angles) @ radiance.reshape(-1, 3)).ravel().tolist()
    return coefficients
