"""The join of the stereo camera with the scene, the browser view and the settings."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

from fastapi import FastAPI

from gateway.figures import watch_stereo
from gateway.house import NO_TELEMETRY, House
from gateway.ops.http import PortService
from gateway.settings import Settings
from gateway.stereo.clock import SimulatedClock
from gateway.stereo.config import StereoConfig, Tls
from gateway.stereo.pairs import PairStudio, geometry_in, pair_studio, pairs_in
from gateway.stereo.parameter_specs import NODES
from gateway.stereo.rest import router
from gateway.stereo.service import StereoService
from gateway.stereo.truth import truth_router
from gateway.stereo.upload import upload_router
from gateway.stereoeyes import StereoEyes
from gateway.stereoview import StereoView
from renderers.stereo.model import MODELS, StereoModel, custom_model


def join_stereo(house: House) -> None:
    """The image stream over gRPC, the device's REST interface, the truth beside them."""
    settings = house.settings
    config = replace(config_of(settings), tokens=house.guard.grpc)
    view = StereoView(house, config)
    clock = SimulatedClock() if settings.clock == "simulated" else None
    service = StereoService(config, view.scene, view.pose, house.renderer, house.workers, clock)

    if settings.stereo_images is not None:
        service.show_pairs(_pairs(settings.stereo_images, service))

    def status() -> dict[str, Any]:
        described = service.status()
        return {**described, "warning": view.mount.warning} if view.mount.warning else described

    if house.state is not None:
        house.state.keep_parameters("0", lambda: list(NODES), service.parameters)
        service.stored = house.state.journal.stored
    watch_stereo(house.metrics, service)
    house.stereo_camera = view.camera
    house.eyes = StereoEyes(service, view, live=settings.stereo_scene == "live")
    house.app.include_router(router(service))
    house.app.include_router(truth_router(service))
    house.app.include_router(upload_router(service))
    house.serve("stereo", service, where=f"gRPC on port {settings.grpc_port}", figures=status)
    if settings.rest_port is not None:
        device = FastAPI(openapi_url=None, telemetry=NO_TELEMETRY)
        device.include_router(router(service))
        device.include_router(upload_router(service))
        house.guard.protect(device)
        port = PortService(device, settings.host, settings.rest_port, house.guard.tls)
        house.serve("rest", port, where="/api")


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
    )


def model_of(settings: Settings) -> StereoModel:
    """One of the device's models, or the one that the settings describe."""
    if settings.stereo_model != "custom":
        return MODELS[f"rc_visard {settings.stereo_model}"]
    return custom_model(settings.stereo_size, settings.stereo_focal_factor, settings.stereo_baseline)
