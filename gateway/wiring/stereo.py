"""Wiring of the stereo cameras: settings → configuration → service → routes, and their images for the browser view."""

import asyncio
from dataclasses import replace
from typing import Any, Final

import numpy as np
from fastapi import FastAPI
from fastapi.exceptions import RequestValidationError

from gateway.adapters.stereo.device.camera_config import StereoConfig, Tls
from gateway.adapters.stereo.device.parameter_store import ParameterStore
from gateway.adapters.stereo.device.profile import read_profile
from gateway.adapters.stereo.device.stream_settings import StreamSettings
from gateway.adapters.stereo.imaging.recorded_pairs import RecordedPairs, find_pairs, read_geometry
from gateway.adapters.stereo.imaging.scene_view import OtherProjector, ProjectorSource, SceneState, SceneView
from gateway.adapters.stereo.routes.camera_routes import camera_router, pose_router
from gateway.adapters.stereo.routes.fault_routes import fault_router
from gateway.adapters.stereo.routes.node_routes import node_router
from gateway.adapters.stereo.routes.system_routes import system_router
from gateway.adapters.stereo.routes.truth_routes import truth_router
from gateway.adapters.stereo.service import StereoService
from gateway.adapters.stereo.stream.set_kind import SetKind
from gateway.adapters.viewer.messages import ImageName, PlacedRig
from gateway.adapters.viewer.sources import StereoImages
from gateway.files.assets.light_rig_file import rig_of
from gateway.runtime.http.error_handlers import invalid_parameters
from gateway.runtime.http.http_server import PortService
from gateway.runtime.settings import Settings
from gateway.scene.draw.bounds import MIN_SUSPECT, loose_bounds, scale_hint
from gateway.scene.draw.flatten import Flattener, flatten
from gateway.scene.draw.mount import (
    Mount,
    MountedCamera,
    mount_pose_text,
    parse_mount_path,
    parse_mount_pose,
    parse_mounted_camera,
)
from gateway.scene.tree.labels import LabelTable
from gateway.scene.tree.live import LiveTree, Snapshot
from gateway.scene.tree.timeline import state_at
from gateway.wiring import metrics
from gateway.wiring.context import Context, Provided, ProvidedCamera
from gateway.wiring.scene_setting import read_scene_setting
from gateway.wiring.telemetry import NO_TELEMETRY
from renderers.light_rig import Rig
from renderers.stereo.depth.depth_images import DepthImages
from renderers.stereo.model import DISPARITY_SCALE
from renderers.stereo.sensor.camera_image import NoiseStream

_VIEW_IMAGES: Final = SetKind(left=True, right=True, disparity=True, confidence=True, color=True)
_CAPTION_PERCENTILES: Final = (1.0, 99.0)
"""Percentiles of the valid disparities between which a caption's range of depths lies."""


async def setup(context: Context, provided: Provided) -> Provided:
    """Serve every camera's image stream over gRPC, the device's REST interface, ground truth and fault injection."""
    settings = context.settings
    configs, mounts = await asyncio.to_thread(_cameras, settings)
    rig = Rig() if settings.rig is None else await asyncio.to_thread(rig_of, settings.rig)
    scene = await _scene(context)
    projectors: dict[SceneView, ProjectorSource] = {}
    started = [
        _start_camera(context, number, replace(config, tokens=context.security.grpc, rig=rig), mount, scene, projectors)
        for number, (config, mount) in enumerate(zip(configs, mounts, strict=True))
    ]
    services = [camera.service for camera, _ in started]
    if not settings.stereo_noise and any(config.depth_mode == "matched" for config in configs):
        warning = "images have no noise, but depth is matched; exact depth is --depth-mode ground_truth"
        context.registry.warn("stereo", "--no-stereo-noise", warning)
    metrics.watch_stereo(context.metrics, services)
    apps = [context.app]
    if settings.rest_port is not None:
        rest = FastAPI(openapi_url=None, telemetry=NO_TELEMETRY)
        rest.add_exception_handler(RequestValidationError, invalid_parameters)
        context.security.protect(rest)
        apps.append(rest)
        context.run_service(
            "rest", PortService(rest, settings.host, settings.rest_port, context.security.tls), where="/api"
        )
    for app in apps:
        app.include_router(system_router(*services))
        app.include_router(node_router(*services))
    context.app.include_router(pose_router({camera.service.config.name: view for camera, view in started}))
    context.app.include_router(camera_router(*services))
    context.app.include_router(truth_router(*services))
    context.app.include_router(fault_router(*services))
    return replace(provided, stereo=started[0][0])


def _cameras(settings: Settings) -> tuple[list[StereoConfig], list[Mount]]:
    """Return the configuration and the mount of every camera. Reads profiles: call this in a worker thread.

    Raises ValueError if a profile cannot be used, or two cameras have one name.
    """
    path = parse_mount_path(settings.stereo_path) if settings.stereo_path is not None else None
    specs = [parse_mounted_camera(text) for text in settings.stereo_cameras]
    configs = [config_of(settings), *(config_of(settings, number, spec) for number, spec in enumerate(specs, 1))]
    names = [config.name for config in configs]
    if duplicates := {name for name in names if names.count(name) > 1}:
        raise ValueError(f"--stereo-cameras: two cameras have the name {min(duplicates)!r}")
    mounts = [Mount(parse_mount_pose(settings.stereo_pose), path), *(spec.new_mount() for spec in specs)]
    return configs, mounts


def _start_camera(
    context: Context,
    number: int,
    config: StereoConfig,
    mount: Mount,
    scene: LiveTree | None,
    projectors: dict[SceneView, ProjectorSource],
) -> tuple[ProvidedCamera, SceneView]:
    """Start the camera of pipeline ``number``. ``scene``: the one that all cameras see; None: the live tree.

    ``projectors``: those that all cameras see; this camera's is added.
    """
    settings, live = context.settings, scene is None
    flattener = context.flattener if scene is None else Flattener(LabelTable())
    view = SceneView(context.tree if scene is None else scene, flattener, mount, projectors)

    def on_streaming(streaming: bool) -> None:
        view.tree.keep_recent(number, active=streaming)
        context.workers.give_way(number, active=streaming)

    async def earlier_state(time: float) -> SceneState:
        snapshot = await state_at(context.history, time)
        return await context.camera_workers.run(view.state_in, snapshot, Flattener(context.labels))

    pairs = None
    if settings.stereo_images is not None:
        geometry = read_geometry(settings.stereo_images) or (config.model.focal_factor, config.model.baseline)
        pairs = RecordedPairs(find_pairs(settings.stereo_images, config.max_pairs), *geometry, config.max_pair_pixels)
    service = StereoService(
        config,
        view.state,
        context.renderer,
        context.camera_workers,
        on_streaming,
        view.tree.has_unapplied_before,
        pairs,
    )
    service.earlier_state = earlier_state if live else None
    if settings.stereo_projectors == "shared" and config.projector and config.dot_light > 0.0:
        projectors[view] = lambda snapshot: OtherProjector(
            view.pose_in(snapshot), config.model, config.dot_light, service.settings
        )
    if context.state is not None:
        context.state.add(ParameterStore(str(number), service.parameters))
        service.wait_until_stored = context.state.wait_until_stored
    name = f"stereo {number}" if number else "stereo"
    context.run_service(name, service, figures=lambda: _figures(service, view))
    sensor = StereoSensor(service, view, live=live)
    return ProvidedCamera(service, sensor, lambda snapshot: view.camera(config, snapshot) if live else None), view


def _figures(service: StereoService, view: SceneView) -> dict[str, Any]:
    """Return figures and warnings of a camera for ``/healthz``."""
    values, warnings = service.status(), view.warnings()
    values["where"] = f"gRPC on port {values['port']}"  # the actual port, if 0 is configured
    if warnings:
        values["warnings"] = [*values.get("warnings", ()), *warnings]
    return values


async def _scene(context: Context) -> LiveTree | None:
    """Return the scene of ``--stereo-scene``; None for the live tree."""
    settings = context.settings
    if settings.stereo_scene == "live":
        return None
    file = await read_scene_setting(settings.stereo_scene, settings)
    bounds = loose_bounds(flatten(file.root))
    is_suspect = bounds is not None and (bounds[1] - bounds[0]).max() >= 10.0 * MIN_SUSPECT
    hints = (scale_hint(bounds),) if bounds is not None and is_suspect else ()
    context.registry.warn("stereo", settings.stereo_scene, *file.warnings, *hints)
    tree = LiveTree()
    with tree.edit() as edit:
        edit.set_subtree((), file.root)
    return tree


def config_of(settings: Settings, number: int = 0, camera: MountedCamera | None = None) -> StereoConfig:
    """Return a camera's configuration, of ``--stereo-cameras`` (None: camera 0). Raises ProfileError."""
    tls = None
    if settings.grpc_certificate is not None and settings.grpc_key is not None:
        tls = Tls(settings.grpc_certificate, settings.grpc_key, settings.grpc_client_ca)
    profile = read_profile((camera and camera.profile) or settings.stereo_profile)
    profile_config = StereoConfig.of_profile(profile)
    return replace(
        profile_config,
        name=(camera and camera.name) or (f"stereo{number}" if number else "stereo"),
        host=settings.host,
        port=settings.grpc_port + number if settings.grpc_port else 0,
        tls=tls,
        dot_light=profile_config.dot_light * settings.stereo_light.projector,
        depth_mode=settings.depth_mode or profile.depth.mode,
        rate=settings.stereo_rate,
        simulated_clock=settings.clock == "simulated",
        seed=settings.stereo_seed + number,
        noise=settings.stereo_noise,
        background=settings.background,
        alpha_threshold=settings.alpha_threshold,
        faults=settings.stereo_faults,
        realism=frozenset(settings.stereo_realism),
        light=settings.stereo_light,
    )


class StereoSensor:
    """Images of a stereo camera for the browser view, with the parameters of the image stream."""

    def __init__(self, service: StereoService, view: SceneView, *, live: bool) -> None:
        """``live``: the camera sees the live tree."""
        self._service = service
        self._view = view
        self._live = live

    def rig(self, snapshot: Snapshot) -> PlacedRig | None:
        """Return pose and intrinsics in a snapshot of the live tree; None if the camera sees another scene."""
        if not self._live:
            return None
        model = self._service.config.model
        k = model.intrinsics()
        pose = self._view.pose_in(snapshot).T.ravel().tolist()
        intrinsics = {"fx": k.focal_length, "fy": k.focal_length, "cx": k.cx, "cy": k.cy}
        return PlacedRig(pose=pose, width=k.width, height=k.height, baseline=model.baseline, **intrinsics)

    async def capture(self) -> StereoImages:
        """Capture and return a set of images with the current parameters. Raises QueueFull or ImageError."""
        service = self._service
        frame = await service.capture(_VIEW_IMAGES)
        left, right, images, metered = await asyncio.gather(
            frame.image(NoiseStream.LEFT, color=True),
            frame.image(NoiseStream.RIGHT, color=True),
            frame.depth_images(),
            frame.metered(frame.record.camera_capture),
        )
        exposure = f"{metered.exposure.time * 1e3:.3g} ms, {metered.exposure.gain:.3g} dB"
        captions: dict[ImageName, str] = {"left": exposure, "right": exposure}
        captions.update(await service.workers.run(self._depth_captions, images, frame.record.settings))
        pose = mount_pose_text(frame.record.camera_capture.X_world_left)
        return StereoImages(left.image, right.image, images.disparity, images.confidence, captions, pose)

    def _depth_captions(self, images: DepthImages, settings: StreamSettings) -> dict[ImageName, str]:
        """Return the range of depths, metres, and the percentage of valid pixels, as texts."""
        valid = images.disparity[images.disparity > 0]
        if not valid.size:
            return {"disparity": "no depth", "confidence": ""}
        focal_times_baseline = self._service.config.model.focal_times_baseline(settings.quality.divisor)
        far, near = focal_times_baseline / (DISPARITY_SCALE * np.percentile(valid, _CAPTION_PERCENTILES))
        valid_percent = 100.0 * valid.size / images.disparity.size
        return {"disparity": f"{near:.1f}–{far:.1f} m", "confidence": f"{valid_percent:.0f} %"}
