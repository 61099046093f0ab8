"""What the stereo camera is told at start."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Literal

from gateway.server.tokens import Tokens
from renderers.interface import LookName
from renderers.stereo.model import MODELS, StereoModel

DepthMode = Literal["ground_truth", "matched"]
Rate = Literal["device", "max"]


@dataclass(frozen=True, slots=True)
class Tls:
    """Files in PEM format."""

    certificate: Path
    key: Path
    client_ca: Path | None = None
    """When given, only clients with a certificate of this authority are served."""


@dataclass(frozen=True, slots=True)
class StereoConfig:
    """Defaults are the device's where it has them."""

    host: str = "127.0.0.1"
    port: int = 50051
    """0: any free port."""
    tls: Tls | None = None
    """None: plaintext, as on the device."""
    tokens: Tokens | None = None
    """None: anybody may call, as on the device."""
    model: StereoModel = field(default_factory=lambda: MODELS["rc_visard 160-4"])
    depth_mode: DepthMode = "ground_truth"
    rate: Rate = "device"
    """``device``: the real camera's rates; ``max``: as fast as the slowest of rendering and clients allows."""
    seed: int = 0
    """Of all noise: seed, scene and frame number determine every byte except timestamps."""
    noise: bool = True
    """False: images without noise, disparity exact up to its rounding, confidence 1 (ground truth)."""
    image_noise: float = 1.0
    """Factor of the images' noise."""
    d_eps: float = 0.25
    """Standard deviation of the disparity in pixels of the full resolution (the manual's typical value)."""
    look: LookName = "pbr"
    background: tuple[int, int, int] = (204, 229, 255)
    """RGB of the picture where nothing is."""
    near: float = 0.01
    """Near clipping plane of the rendered images, metres."""
    far: float = 10_000.0
    """Far clipping plane, metres; depth images have their own limits (mindepth, maxdepth)."""
    projector: bool = True
    """Whether a random-dot projector hangs on output Out1."""
    dot_light: float = 2.0
    """Light of a projected dot relative to the scene's own."""
    mesh_rgb: bool = False
    """Meshes repeat their colours as red, green, blue: trimesh and Open3D ignore the device's diffuse_* names."""
    serial: str = "02900000"
    hostname: str = "scenegate"
    max_clients: int = 64
    """Streams at a time; each holds one set (up to 70 MB with a full mesh) in its mailbox and some in its socket."""
    max_pairs: int = 10_000
    """Stereo pairs in a folder that is shown in the scene's place: 400 s at the camera's rate; their names are kept."""
    max_pair_pixels: int = 20_000_000
    """Of one such image: 16 times the device's; 60 MB decoded, and eight are kept."""
    max_upload: int = 64 << 20
    """Bytes of a pair that is uploaded: four such images, compressed."""
    faults: bool = False
    """Whether faults may be injected over REST."""
    max_late_bytes: int = 256 << 20
    """Of sets that an injected delay holds back: 10 s of 1280x960 camera images at 10 Hz."""
    max_events: int = 64
    """Image events that wait for one listener; at the highest rate 2.5 s of them, some 2 kB."""
    max_kinds: int = 16
    """Different requests at a time: each is serialised separately, and meshes cost up to 0.1 s each."""
    history: int = 100
    """Frames that ``/stereo/truth.npz`` remembers: 4 s of the camera. A frame keeps its draw list, whose meshes are
    shared, and is rendered again when asked for."""
    frames_in_flight: int = 2
    """Frames being made at the same time: one renders while the other is filtered and serialised."""

    @property
    def noise_factor(self) -> float:
        """Of the images' noise; 0: none."""
        return self.image_noise if self.noise else 0.0
