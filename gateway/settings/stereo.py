"""Options of the stereo camera."""

from __future__ import annotations

from pathlib import Path
from typing import Literal, Self

from pydantic import model_validator
from pydantic_settings import BaseSettings

from gateway.settings.types import MountPath, MountPose, Mounts, Port, PortOrOff, option


class StereoSettings(BaseSettings):
    """Part of ``Settings``."""

    grpc_port: Port = option(50051, "Stereo camera", "Port of the image stream over gRPC. 0 takes a free one.")
    stereo_scene: str = option(
        "live", "Stereo camera", "What the camera sees: 'live' for the live tree, or a .gltf or .glb file."
    )
    stereo_images: Path | None = option(
        None,
        "Stereo camera",
        "Folder with stereo pairs (…left….png, …right….png) that are shown in turn in the scene's place; depth is "
        "matched from them.",
    )
    stereo_pose: MountPose = option(
        "eye=1.4,-1.1,1.7;target=0,0,0.85",
        "Stereo camera",
        "Pose of the left optical frame in the world: x,y,z,qw,qx,qy,qz or eye=x,y,z;target=x,y,z;up=x,y,z.",
    )
    stereo_path: MountPath | None = option(
        None,
        "Stereo camera",
        'Node of the scene whose frame is the left optical frame, as JSON: ["robot", "head"]. While it is missing, the '
        "last pose holds.",
    )
    stereo_cameras: Mounts = option(
        (),
        "Stereo camera",
        "Further stereo cameras, separated by |, each a pose or a node as above: pipelines 1, 2, … with the next ports "
        "and parameters of their own.",
    )
    stereo_faults: bool = option(
        False, "Stereo camera", "Let PUT /stereo/faults drop, delay and cut streams, for test rigs."
    )
    stereo_model: Literal["65-4", "160-4", "160-6", "custom"] = option(
        "160-4",
        "Stereo camera",
        "Which rc_visard it is; 'custom' is described by --stereo-size, --stereo-focal-factor and --stereo-baseline.",
    )
    stereo_size: str | None = option(
        None, "Stereo camera", "Custom model: camera images, WIDTHxHEIGHT pixels; 1280x960 when not given."
    )
    stereo_focal_factor: float | None = option(
        None, "Stereo camera", "Custom model: focal length divided by image width; 0.8449 when not given."
    )
    stereo_baseline: float | None = option(
        None, "Stereo camera", "Custom model: distance of the cameras, metres; 0.16 when not given."
    )
    stereo_d_eps: float = option(
        0.25, "Stereo camera", "Standard deviation of the disparity, pixels of a camera image.", ge=0, le=5
    )
    stereo_image_noise: float = option(
        1.0, "Stereo camera", "Factor of the images' noise; 1 is like the device.", ge=0, le=100
    )
    stereo_rate: Literal["device", "max"] = option(
        "device", "Stereo camera", "Images as often as the device makes them, or as often as possible."
    )
    depth_mode: Literal["ground_truth", "matched"] = option(
        "ground_truth",
        "Stereo camera",
        "Disparity from the exact depth and the device's error model, or matched from the rendered images.",
    )
    stereo_noise: bool = option(True, "Stereo camera", "Noise of images and disparity.")
    stereo_mesh_rgb: bool = option(
        False,
        "Stereo camera",
        "Textured meshes repeat their colours as red, green, blue, for trimesh and Open3D.",
    )
    clock: Literal["real", "simulated"] = option(
        "real",
        "Stereo camera",
        "Timestamps of the images: the computer's time, or one period after the other from a fixed start, so that the "
        "same frames have the same bytes.",
    )
    stereo_seed: int = option(0, "Stereo camera", "Seed of all noise.", ge=0)
    rest_port: PortOrOff = option(
        None, "Stereo camera", "A further port for the device's REST interface, which is at /api of the HTTP port, too."
    )
    grpc_certificate: Path | None = option(
        None, "Stereo camera", "PEM certificate; with --grpc-key the stream is encrypted."
    )
    grpc_key: Path | None = option(None, "Stereo camera", "PEM private key of --grpc-certificate.")
    grpc_client_ca: Path | None = option(
        None, "Stereo camera", "PEM authority; only clients with a certificate of it are served."
    )

    @model_validator(mode="after")
    def _pairs_or_scene(self) -> Self:
        if self.stereo_images is not None and self.stereo_scene != "live":
            raise ValueError(
                "--stereo-images and --stereo-scene exclude each other: the pairs are shown in the scene's place"
            )
        return self

    @model_validator(mode="after")
    def _custom_camera(self) -> Self:
        described = (self.stereo_size, self.stereo_focal_factor, self.stereo_baseline)
        if self.stereo_model != "custom":
            if any(value is not None for value in described):
                raise ValueError(
                    "--stereo-size, --stereo-focal-factor and --stereo-baseline need --stereo-model custom"
                )
        elif any(value is not None for value in described):
            from renderers.stereo.model import custom_model  # numpy, for those who set it only

            custom_model(*described)
        return self
