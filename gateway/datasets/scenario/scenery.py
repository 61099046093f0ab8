"""Lights, background and camera sensor of colour images."""

import math
import zlib
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np
from numpy.typing import NDArray

from gateway.datasets.scenario.choices import BackgroundChoice, LightChoice, SceneChoices, SensorChoice
from gateway.datasets.scenario.drawn_materials import read_image
from gateway.files.assets.light_rig_file import cached_rig
from renderers.camera import Camera
from renderers.color import linear_from_srgb
from renderers.drawlist import DrawList, Image, Light, LightKind
from renderers.interface import Look, Output, Renderer
from renderers.light_rig import STUDIO, Rig, Surroundings
from renderers.stereo.model import Intrinsics
from renderers.stereo.sensor.camera_image import (
    Lens,
    NoiseStream,
    SceneLight,
    frame_key,
    image_from_light,
    light_on_sensor,
    roots_of,
)
from renderers.stereo.sensor.exposure import DISPLAY_GAMMA, REFERENCE_EXPOSURE, Exposure


@dataclass(frozen=True, slots=True, eq=False)
class Scenery:
    """Lights, background and sensor of one view."""

    rig: Rig
    background: BackgroundChoice
    image: Image | None
    """Image of the background; None: a colour."""
    sensor: SensorChoice | None
    seed: int
    """Seed of the sensor's noise."""
    frame: int
    """Frame of the scene, which has noise of its own."""

    def look(self, look: Look) -> Look:
        """Return a look with the lights and the colour of the background."""
        color = (0, 0, 0) if self.image is not None else self.background.color or look.background
        return replace(look, rig=self.rig, background=color)

    def finish(
        self, color: NDArray[np.uint8], scene: DrawList, camera: Camera, renderer: Renderer, look: Look
    ) -> NDArray[np.uint8]:
        """Return a colour image, (H, W, 3) of ``self.look(…)``, with the background's image and the sensor's effects.

        The scene is rendered once more before white: how much brighter a pixel is than before black is its share of
        background (Smith and Blinn 1996), at edges and through glass.
        """
        if self.image is not None:
            white = renderer.render(scene, camera, Output.COLOR, replace(look, background=(255, 255, 255))).color
            assert white is not None
            share = (white.astype(np.float32) - color).mean(axis=2, keepdims=True) / 255.0
            behind = _middle_in_size(self.image.decode()[..., :3], camera.width, camera.height)
            color = np.clip(color + share * behind + 0.5, 0.0, 255.0).astype(np.uint8)
        return color if self.sensor is None else self._sensed(color, camera, self.sensor)

    def _sensed(self, color: NDArray[np.uint8], camera: Camera, sensor: SensorChoice) -> NDArray[np.uint8]:
        """Return the image as a sensor sees it, with the gamma of a display."""
        intrinsics = Intrinsics(camera.width, camera.height, camera.fx, camera.cx, camera.cy)
        gain = 10.0 ** (sensor.gain / 20.0)
        exposure = Exposure(REFERENCE_EXPOSURE * sensor.exposure / gain, sensor.gain, 1.0 / DISPLAY_GAMMA)
        lens = Lens(sensor.blur, sensor.vignetting)
        light = light_on_sensor(roots_of(color), intrinsics, exposure, SceneLight(), lens, color=True)
        view = self.frame << 32 | zlib.crc32(camera.X_world_camera.tobytes())
        noise_key = frame_key(self.seed, view, NoiseStream.COLOR_CAMERA)
        return image_from_light(light, exposure, noise_key).image


def _middle_in_size(image: NDArray[np.uint8], width: int, height: int) -> NDArray[np.float32]:
    """Return the middle of an image that has the aspect of ``width`` x ``height``, in that size."""
    pixels_per_pixel = min(image.shape[1] / width, image.shape[0] / height)
    columns, rows = max(1, int(pixels_per_pixel * width)), max(1, int(pixels_per_pixel * height))
    left, top = (image.shape[1] - columns) // 2, (image.shape[0] - rows) // 2
    middle = np.ascontiguousarray(image[top : top + rows, left : left + columns])
    interpolation = cv2.INTER_AREA if pixels_per_pixel > 1.0 else cv2.INTER_LINEAR
    return np.asarray(cv2.resize(middle, (width, height), interpolation=interpolation), np.float32)


def scenery_of(choices: SceneChoices, folder: Path, frame: int) -> Scenery:
    """Return a frame's scenery, of files relative to a folder. Raises OSError, RigFileError or ImageError."""
    background = choices.background
    image = read_image(folder / background.image) if background.image else None
    seed = (choices.seed << 20 ^ choices.number) & (2**63 - 1)
    return Scenery(_rig_of(choices.light, folder), background, image, choices.sensor, seed, frame)


def _rig_of(light: LightChoice, folder: Path) -> Rig:
    rig = cached_rig(folder / light.rig) if light.rig else STUDIO
    surroundings = rig.surroundings
    if light.environment:
        environment = cached_rig(folder / light.environment).surroundings  # a .hdr file is a rig of its surroundings
        surroundings = Surroundings(image=None if environment is None else environment.image)
    if surroundings is not None:
        surroundings = replace(surroundings, turn=surroundings.turn + light.turn)
    lamps = tuple(
        Light(
            LightKind.DIRECTIONAL,
            tuple(map(linear_from_srgb, lamp.color)),  # type: ignore[arg-type]  # three numbers
            lamp.intensity,
            direction=lamp.direction,
        )
        for lamp in light.lamps
    )
    return replace(
        rig,
        lights=lamps or rig.lights,
        scene_lights=False,  # of models
        surroundings=surroundings,
        exposure=rig.exposure * light.intensity,
    )


def lamp_direction(azimuth: float, elevation: float) -> tuple[float, float, float]:
    """Return the direction in which a light shines that comes from an azimuth and elevation in degrees."""
    a, e = math.radians(azimuth), math.radians(elevation)
    return -math.cos(e) * math.cos(a), -math.cos(e) * math.sin(a), -math.sin(e)
