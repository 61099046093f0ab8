"""Settings of the stereo camera."""

from functools import partial
from pathlib import Path
from typing import Literal, Self

from pydantic import model_validator
from pydantic_settings import BaseSettings

from gateway.runtime.settings.option import option
from gateway.runtime.settings.types import Cameras, LightLevel, MountPath, MountPose, Port, PortOrOff, Realism
from renderers.stereo.light.levels import LightLevels
from renderers.stereo.realism import REALISM_PARTS

stereo = partial(option, "Stereo camera")


class StereoSettings(BaseSettings):
    """Part of ``Settings``."""

    grpc_port: Port = stereo(50051, "Port of the gRPC image stream. 0 picks a free port.")
    stereo_scene: str = stereo(
        "live",
        "Scene in front of the camera: 'live' for the live tree, or a file: glTF, a mesh, or a robot (urdf, xml), "
        "whose packages are found by --mesh-root.",
    )
    stereo_images: Path | None = stereo(
        None,
        "Folder with stereo pairs (…left….png, …right….png), streamed in turn instead of the scene. Depth is matched "
        "from them.",
    )
    stereo_pose: MountPose = stereo(
        "eye=1.4,-1.1,1.7;target=0,0,0.85",
        "Pose of the left optical frame in the world: x,y,z,qw,qx,qy,qz or eye=x,y,z;target=x,y,z;up=x,y,z.",
    )
    stereo_path: MountPath | None = stereo(
        None,
        'Node of the scene whose frame is the left optical frame, as JSON: ["robot", "head"]. While the node is '
        "missing, the camera keeps its last pose.",
    )
    stereo_cameras: Cameras = stereo(
        (),
        "More stereo cameras, separated by |, each a pose (--stereo-pose) or a node (--stereo-path), which may be "
        "preceded by name=NAME; and profile=PROFILE;. They are pipelines 1, 2, …, on the following ports, each with "
        "its own parameters.",
    )
    stereo_faults: bool = stereo(False, "Allow PUT /stereo/faults to drop, delay and cut streams, for test rigs.")
    stereo_profile: str = stereo(
        "rc_visard_160c",
        "Kind of camera: rc_visard_65c, rc_visard_65m, rc_visard_160c, rc_visard_160m, rc_visard_160m_6mm, rgbd, or a "
        "TOML file (docs/camera-profiles.md).",
    )
    stereo_rate: Literal["device", "max"] = stereo("device", "Frame rate: the device's, or as high as possible.")
    depth_mode: Literal["matched", "ground_truth"] | None = stereo(
        None,
        "Disparity by a matcher from the camera images, or exact, which is also faster. The default is the profile's: "
        "matched, but for rgbd.",
    )
    stereo_realism: Realism = stereo(
        REALISM_PARTS,
        "Realistic camera images: 'all', 'off', which is up to twice as fast, or some of shadows, lens-blur, "
        "vignetting, fixed-pattern, motion-blur, projector, separated by commas.",
    )
    stereo_light: LightLevel = stereo(
        LightLevels(),
        "Light in camera images, which adds up; names that are left out keep their defaults. lamp: a point at the "
        "camera, its light at 1.5 m; sky: light on what faces up; ground: light on what faces down; key: light in "
        "place of the lamp with the realism part shadows; scene, projector: factors of the lights of glTF files or "
        "--rig, and of the projector.",
    )
    stereo_projectors: Literal["own", "shared"] = stereo(
        "own",
        "Projectors whose dots a camera sees: its own, or those of all cameras (--stereo-cameras) while they are on.",
    )
    stereo_noise: bool = stereo(True, "Add noise to camera images. Exact depth is --depth-mode ground_truth.")
    clock: Literal["real", "simulated"] = stereo(
        "real",
        "Image timestamps: the computer's clock, or a fixed start plus one period per frame, which makes runs "
        "reproducible byte by byte.",
    )
    stereo_seed: int = stereo(0, "Seed of all noise.", ge=0)
    rest_port: PortOrOff = stereo(
        None, "Additional port for the device's REST interface, which is also at /api of the HTTP port."
    )
    grpc_certificate: Path | None = stereo(
        None, "PEM certificate. With --grpc-key it turns on TLS for the image stream."
    )
    grpc_key: Path | None = stereo(None, "PEM private key of --grpc-certificate.")
    grpc_client_ca: Path | None = stereo(
        None, "PEM certificate authority. Only clients with a certificate signed by it are accepted."
    )

    @model_validator(mode="after")
    def _pairs_or_scene(self) -> Self:
        if self.stereo_images is not None and self.stereo_scene != "live":
            raise ValueError(
                "--stereo-images and --stereo-scene exclude each other: the pairs are shown in the scene's place"
            )
        return self
