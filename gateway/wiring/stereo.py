"""Wiring of the stereo cameras: settings → configuration → service → routes, and their images for the browser view."""

from __future__ import annotations

import asyncio
import time
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError

from gateway.assets.scene_file import read_scene_file
from gateway.scene.flatten import Flattener
from gateway.scene.labels import LabelTable
from gateway.scene.live import Snapshot
from gateway.scene.mount import Mount, parse_mount_path, parse_mount_pose
from gateway.server.early_response import EarlyResponse
from gateway.server.error_handlers import HeadAsGet, invalid_parameters
from gateway.server.http_server import PortService
from gateway.settings import Settings
from gateway.stereo.clock import SimulatedClock
from gateway.stereo.config import StereoConfig, Tls
from gateway.stereo.fault_routes import fault_router
from gateway.stereo.frame import Frame
from gateway.stereo.images import Capture
from gateway.stereo.imu import PoseLog
from gateway.stereo.imu_routes import imu_router
from gateway.stereo.node_routes import node_router
from gateway.stereo.pair_files import find_pairs, read_geometry
from gateway.stereo.pairs import PairImaging, pair_imaging
from gateway.stereo.parameter_specs import NODES
from gateway.stereo.request import SetKind
from gateway.stereo.scene_view import SceneView
from gateway.stereo.service import StereoService
from gateway.stereo.settings import StreamSettings
from gateway.stereo.system_routes import system_router
from gateway.stereo.truth import truth_router
from gateway.stereo.upload import upload_router
from gateway.viewer.sources import ImageName, StereoImages, StereoRig
from gateway.wiring.context import NO_TELEMETRY, Context
from gateway.wiring.metrics import watch_stereo
from renderers.stereo.depth_images import DepthImages
from renderers.stereo.model import DISPARITY_SCALE, MODELS, StereoModel, custom_model
from renderers.stereo.noise import NoiseStream
from renderers.stereo.realism import REALISM_PARTS, RealismPart

_VIEW_IMAGES: Final = SetKind(left=True, right=True, disparity=True, confidence=True, color=True)
_CAPTION_PERCENTILES: Final = (1.0, 99.0)
"""Percentiles of the disparity for the range of depths in a caption."""


async def setup(context: Context) -> None:
    """Serve every camera's image stream over gRPC, the device's REST interface, ground truth and fault injection."""
    settings = context.settings
    path = parse_mount_path(settings.stereo_path) if settings.stereo_path is not None else None
    mounts = [Mount(parse_mount_pose(settings.stereo_pose), path), *map(_mount, settings.stereo_cameras)]
    scene = await _scene(settings)
    services = [_start_camera(context, number, mount, scene) for number, mount in enumerate(mounts)]
    watch_stereo(context.metrics, *services)
    apps = [context.app]
    if settings.rest_port is not None:
        rest = FastAPI(openapi_url=None, telemetry=NO_TELEMETRY)
        rest.add_exception_handler(RequestValidationError, invalid_parameters)
        context.security.protect(rest)
        rest.add_middleware(HeadAsGet)
        rest.add_middleware(EarlyResponse)
        apps.append(rest)
        context.run_service(
            "rest", PortService(rest, settings.host, settings.rest_port, context.security.tls), where="/api"
        )
    for app in apps:
        app.include_router(system_router(*services))
        app.include_router(node_router(*services))
        app.include_router(upload_router(*services))
    context.app.include_router(truth_router(*services))
    context.app.include_router(imu_router(*services))
    context.app.include_router(fault_router(*services))


def _mount(text: str) -> Mount:
    """Return the mount of a further camera: a node (JSON) or a pose."""
    if text.lstrip().startswith("["):
        return Mount(np.eye(4), parse_mount_path(text))
    return Mount(parse_mount_pose(text), None)


def _start_camera(context: Context, number: int, mount: Mount, scene: Snapshot | None) -> StereoService:
    """Start the camera of pipeline ``number``. Camera 0 is the one shown by the browser view and the scene API.

    Args:
        scene: the scene that all cameras see; None: the live tree.
    """
    settings = context.settings
    config = replace(config_of(settings), tokens=context.security.grpc)
    if number > 0:
        port = settings.grpc_port + number if settings.grpc_port else 0
        config = replace(config, port=port, seed=config.seed + number)
    if scene is None:
        view = SceneView(lambda: context.tree.snapshot, context.flattener, mount)
        pose_log = PoseLog(lambda: context.tree.snapshot, view.pose_in, context.tree)
    else:
        view = SceneView(lambda: scene, Flattener(LabelTable()), mount)
        pose_log = PoseLog(lambda: scene, view.pose_in, None)
    simulated = settings.clock == "simulated"
    service = StereoService(
        config,
        view.scene,
        view.pose,
        context.renderer,
        context.workers,
        SimulatedClock() if simulated else None,
        None if simulated else pose_log,
    )
    if settings.stereo_images is not None:
        service.show_pairs(_pairs(settings.stereo_images, service))

    def status() -> dict[str, Any]:
        values, warning = service.status(), view.warning()
        where = {"where": f"gRPC on port {values['port']}"}  # the actual port, if 0 is configured
        return {**values, **where, **({"warning": warning} if warning else {})}

    if context.state is not None:
        context.state.restore_parameters(str(number), lambda: list(NODES), service.parameters)
        service.wait_until_stored = context.state.commits.wait_until_stored
    if number == 0:
        context.stereo_camera = lambda: view.camera(config) if scene is None else None
        context.stereo_sensor = StereoSensor(service, view.copy(), live=scene is None)
    context.run_service(f"stereo {number}" if number else "stereo", service, figures=status)
    return service


async def _scene(settings: Settings) -> Snapshot | None:
    """Return the scene of ``--stereo-scene``; None if that is the live tree."""
    if settings.stereo_scene == "live":
        return None
    file = await asyncio.to_thread(read_scene_file, Path(settings.stereo_scene), up=settings.up)
    return Snapshot(file.root, 0)


def _pairs(folder: Path, service: StereoService) -> PairImaging:
    """Return the pairs of a folder, with the geometry in the folder or else that of the model."""
    config = service.config
    pairs = find_pairs(folder, config.max_pairs, config.max_pair_pixels)
    geometry = read_geometry(folder) or (config.model.focal_factor, config.model.baseline)
    return pair_imaging(service.scene_imaging, pairs, *geometry)


def config_of(settings: Settings) -> StereoConfig:
    """Return the configuration of camera 0."""
    tls = None
    if settings.grpc_certificate is not None and settings.grpc_key is not None:
        tls = Tls(settings.grpc_certificate, settings.grpc_key, settings.grpc_client_ca)
    return StereoConfig(
        host=settings.host,
        port=settings.grpc_port,
        tls=tls,
        model=model_of(settings),
        depth_mode=settings.depth_mode,
        rate=settings.stereo_rate,
        seed=settings.stereo_seed,
        noise=settings.stereo_noise,
        image_noise=settings.stereo_image_noise,
        disparity_error=settings.stereo_d_eps,
        mesh_rgb=settings.stereo_mesh_rgb,
        background=settings.background,
        faults=settings.stereo_faults,
        realism=realism_of(settings),
    )


def realism_of(settings: Settings) -> frozenset[RealismPart]:
    """Return the parts of ``--stereo-realism``; by default none, and all of them for the demo scene."""
    if settings.stereo_realism is None:
        return frozenset(REALISM_PARTS if settings.demo else ())
    return frozenset(settings.stereo_realism)


def model_of(settings: Settings) -> StereoModel:
    """Return one of the device's models, or the model that the settings define."""
    if settings.stereo_model != "custom":
        return MODELS[f"rc_visard {settings.stereo_model}"]
    return custom_model(settings.stereo_size, settings.stereo_focal_factor, settings.stereo_baseline)


class StereoSensor:
    """Images of a stereo camera for the browser view, made as for clients of the stream but independent of them."""

    def __init__(self, service: StereoService, view: SceneView, *, live: bool) -> None:
        """
        Args:
            service: camera.
            view: view of its own, because scene and pose belong together.
            live: True if the camera sees the live tree.
        """
        self._service = service
        self._view = view
        self._live = live
        self._number = 0

    def rig(self, snapshot: Snapshot) -> StereoRig | None:
        """Return the cameras in a snapshot of the live tree; None if the camera sees another scene."""
        if not self._live:
            return None
        model = self._service.config.model
        k = model.intrinsics()
        pose = self._view.pose_in(snapshot)
        return StereoRig(pose, k.width, k.height, k.focal_length, k.focal_length, k.cx, k.cy, model.baseline)

    async def capture(self) -> StereoImages:
        """Capture and return a set of images with the current parameters.

        Raises:
            QueueFull: the worker queue is full.
            ImageError: a texture of the scene cannot be decoded.
        """
        service, settings = self._service, self._service.settings
        self._number += 1
        camera, depth = await service.workers.run(self._captures, settings, self._number)
        frame = Frame(service.imaging, service.workers, settings, camera, depth, (_VIEW_IMAGES,))
        try:
            left, right, images, metered = await asyncio.gather(
                frame.image(NoiseStream.LEFT, color=True),
                frame.image(NoiseStream.RIGHT, color=True),
                frame.depth_images(),
                frame.metered(camera),
            )
        except BaseException:
            frame.cancel()
            raise
        exposure = f"{metered.exposure.time * 1e3:.3g} ms, {metered.exposure.gain:.3g} dB"
        captions: dict[ImageName, str] = {"left": exposure, "right": exposure}
        captions.update(await service.workers.run(self._depth_captions, images, settings))
        return StereoImages(left.image, right.image, images.disparity, images.confidence, captions)

    def _captures(self, settings: StreamSettings, number: int) -> tuple[Capture, Capture]:
        """Return the camera and the depth capture of one instant."""
        scene, revision = self._view.scene()
        pose, now = self._view.pose(), time.time_ns()
        camera = Capture(now, scene, revision, pose, settings.gpio(depth=False), number)
        return camera, replace(camera, gpio=settings.gpio(depth=True))

    def _depth_captions(self, images: DepthImages, settings: StreamSettings) -> dict[ImageName, str]:
        valid = images.disparity[images.disparity > 0]
        if not valid.size:
            return {"disparity": "no depth", "confidence": ""}
        focal_times_baseline = self._service.config.model.focal_times_baseline(settings.quality.divisor)
        far, near = focal_times_baseline / (DISPARITY_SCALE * np.percentile(valid, _CAPTION_PERCENTILES))
        valid_percent = 100.0 * valid.size / images.disparity.size
        return {"disparity": f"{near:.1f}–{far:.1f} m", "confidence": f"{valid_percent:.0f} %"}
