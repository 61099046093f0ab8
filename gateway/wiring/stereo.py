"""The join of the stereo camera with the scene, the browser view and the settings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from fastapi import FastAPI

from gateway.scene.mount import Mount, parse_mount_path, parse_mount_pose
from gateway.server.error_handlers import HeadAsGet
from gateway.server.http_server import PortService
from gateway.settings import Settings
from gateway.stereo.clock import SimulatedClock
from gateway.stereo.config import StereoConfig, Tls
from gateway.stereo.fault_routes import fault_router
from gateway.stereo.pairs import PairStudio, geometry_in, pair_studio, pairs_in
from gateway.stereo.parameter_specs import NODES
from gateway.stereo.rest import router
from gateway.stereo.service import StereoService
from gateway.stereo.system_routes import system_router
from gateway.stereo.truth import truth_router
from gateway.stereo.upload import upload_router
from gateway.wiring.context import NO_TELEMETRY, Context
from gateway.wiring.metrics import watch_stereo
from gateway.wiring.stereo_scene import StereoView
from gateway.wiring.stereo_sensors import StereoEyes
from renderers.stereo.model import MODELS, StereoModel, custom_model


def setup(context: Context) -> None:
    """Every camera's image stream over gRPC, the device's REST interface, the truth and the faults beside them."""
    settings = context.settings
    path = parse_mount_path(settings.stereo_path) if settings.stereo_path is not None else None
    mounts = [Mount(parse_mount_pose(settings.stereo_pose), path), *map(_mount, settings.stereo_cameras)]
    services = [_join_camera(context, number, mount) for number, mount in enumerate(mounts)]
    watch_stereo(context.metrics, *services)
    apps = [context.app]
    if settings.rest_port is not None:
        apps.append(FastAPI(openapi_url=None, telemetry=NO_TELEMETRY))
        context.security.protect(apps[1])
        apps[1].add_middleware(HeadAsGet)
        context.run_service(
            "rest", PortService(apps[1], settings.host, settings.rest_port, context.security.tls), where="/api"
        )
    for app in apps:
        app.include_router(router(*services))
        app.include_router(system_router(*services))
        app.include_router(upload_router(*services))
    context.app.include_router(truth_router(*services))
    context.app.include_router(fault_router(*services))


def _mount(text: str) -> Mount:
    """A further camera, at a node (JSON) or a pose."""
    if text.lstrip().startswith("["):
        return Mount(np.eye(4), parse_mount_path(text))
    return Mount(parse_mount_pose(text), None)


def _join_camera(context: Context, number: int, mount: Mount) -> StereoService:
    """Pipeline ``number``; the first one is what the rest of the context calls the stereo camera."""
    settings = context.settings
    config = replace(config_of(settings), tokens=context.security.grpc)
    if number > 0:
        port = settings.grpc_port + number if settings.grpc_port else 0
        config = replace(config, port=port, seed=config.seed + number)
    view = StereoView(context, config, mount)
    clock = SimulatedClock() if settings.clock == "simulated" else None
    service = StereoService(config, view.scene, view.pose, context.renderer, context.workers, clock)
    if settings.stereo_images is not None:
        service.show_pairs(_pairs(settings.stereo_images, service))

    def status() -> dict[str, Any]:
        described, warning = service.status(), view.warning()
        where = {"where": f"gRPC on port {described['port']}"}  # the one that was free, where 0 was asked for
        return {**described, **where, **({"warning": warning} if warning else {})}

    if context.state is not None:
        context.state.keep_parameters(str(number), lambda: list(NODES), service.parameters)
        service.stored = context.state.journal.stored
    if number == 0:
        context.stereo_camera = view.camera
        context.stereo_sensor = StereoEyes(service, view, live=settings.stereo_scene == "live")
    name = f"stereo {number}" if number else "stereo"
    context.run_service(name, service, figures=status)
    return service


def _pairs(folder: Path, service: StereoService) -> PairStudio:
    """The pairs of a folder, with the geometry that is written there or else the model's."""
    config = service.config
    pairs = pairs_in(folder, config.max_pairs, config.max_pair_pixels)
    geometry = geometry_in(folder) or (config.model.focal_factor, config.model.baseline)
    return pair_studio(service.scene_studio, pairs, *geometry)


def config_of(settings: Settings) -> StereoConfig:
    """What the settings say of the camera."""
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
        d_eps=settings.stereo_d_eps,
        mesh_rgb=settings.stereo_mesh_rgb,
        background=settings.background,
        faults=settings.stereo_faults,
    )


def model_of(settings: Settings) -> StereoModel:
    """One of the device's models, or the one that the settings describe."""
    if settings.stereo_model != "custom":
        return MODELS[f"rc_visard {settings.stereo_model}"]
    return custom_model(settings.stereo_size, settings.stereo_focal_factor, settings.stereo_baseline)
