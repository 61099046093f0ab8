"""Every option of the gateway, once: its name, default, limits and what it means.

From here come the flags of ``scenegate serve``, the ``SCENEGATE_*`` environment variables, the keys of the TOML file
and ``docs/configuration.md``. A flag wins over the environment, the environment over the file, the file over the
default.
"""

from __future__ import annotations

import os
import tomllib
from collections.abc import Mapping
from difflib import get_close_matches
from pathlib import Path
from typing import Any, Literal, Self

from pydantic import ValidationError, model_validator
from pydantic_settings import BaseSettings, PydanticBaseSettingsSource, SettingsConfigDict

from gateway.options import (
    CONFIG_ENV,
    ENV_PREFIX,
    OTHER_ENV,
    Color,
    Interfaces,
    MountPath,
    MountPose,
    Mounts,
    Names,
    Paths,
    Port,
    PortOrOff,
    Samples,
    env_of,
    flag_of,
    option,
)

MIB = 1 << 20


class SettingsError(ValueError):
    """Settings cannot be used; the message has one sentence a line."""


class Settings(BaseSettings):
    """See ``docs/configuration.md``, which is generated from this class."""

    model_config = SettingsConfigDict(
        env_prefix=ENV_PREFIX, extra="forbid", frozen=True, env_ignore_empty=True, validate_default=False
    )

    # --- Interfaces
    host: str = option(
        "127.0.0.1",
        "Interfaces",
        "Address that HTTP, gRPC and TCPQ listen on; 0.0.0.0 lets other machines in (gRPC then listens on IPv6, too: "
        "its library makes no difference between 0.0.0.0 and ::).",
    )
    http_port: Port = option(
        8000, "Interfaces", "Port of HTTP: render endpoint, scene, docs, health. 0 takes a free one.", flag="--port"
    )
    only: Interfaces = option(
        (),
        "Interfaces",
        "Start these interfaces and no others, separated by commas: render, scene, treeviewer, stereo, view.",
    )
    demo: bool = option(False, "Interfaces", "Publish a moving scene into the live tree under 'demo'.")

    # --- Render endpoint
    render_path: str = option("/render", "Render endpoint", "Path of Drake's render endpoint.", pattern=r"^/\S*[^/\s]$")
    look: Literal["auto", "phong", "pbr"] = option(
        "auto",
        "Render endpoint",
        "How colour is made: 'phong' as Drake without glTF meshes, 'pbr' as Drake with them, 'auto' decides by the "
        "generator that the posted scene names.",
    )
    samples: Samples = option(
        1,
        "Render endpoint",
        "Samples a pixel of colour pictures; with 1, edges are smoothed by FXAA, as Drake's RenderEngineVtk does.",
    )
    background: Color = option((204, 229, 255), "Render endpoint", "Colour where nothing is; 0 to 255 each.")
    depth_format: Literal["tiff", "png"] = option(
        "tiff", "Render endpoint", "Depth as 32-bit float TIFF in metres, or as 16-bit PNG in millimetres."
    )
    backdrop: str | None = option(
        None, "Render endpoint", "Geometry added to every render: a .gltf or .glb file, or 'live' for the live tree."
    )
    up: Literal["auto", "y", "z"] = option(
        "auto", "Render endpoint", "Which axis is up in --backdrop and --stereo-scene files; 'auto' asks the generator."
    )
    keep_failures: Path | None = option(
        None, "Render endpoint", "Folder that rejected render requests are written to, for replay."
    )

    # --- Live scene
    rig: Path | None = option(
        None,
        "Live scene",
        "TOML file with the lights, surroundings and exposure of the 'studio' look of GET /scene/render and of "
        "/view/frame.jpg.",
    )

    # --- Tree viewer
    lcm_url: str | None = option(
        None, "Tree viewer", "LCM network, as in LCM_DEFAULT_URL, which counts when this is not given; 'off': no LCM."
    )
    tcpq_port: PortOrOff = option(
        7700, "Tree viewer", "Port of the embedded TCPQ hub, for clients without multicast; 'off': no hub."
    )
    mesh_root: Paths = option(
        (),
        "Tree viewer",
        f"Folders that mesh_file may read, package:// among them, separated by '{os.pathsep}'; none are read without.",
    )

    # --- Stereo camera
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

    # --- Access
    http_certificate: Path | None = option(
        None, "Access", "PEM certificate; with --http-key HTTP, WebSocket and REST are encrypted."
    )
    http_key: Path | None = option(None, "Access", "PEM private key of --http-certificate, without a password.")
    http_token_file: Path | None = option(
        None,
        "Access",
        "File with bearer tokens, one a line: HTTP, WebSocket and REST want one of them, /healthz and /readyz apart.",
    )
    grpc_token_file: Path | None = option(
        None, "Access", "The same for the image stream: 'authorization: Bearer TOKEN' in a call's metadata."
    )
    tcpq_host: str | None = option(
        None,
        "Access",
        "Address of the TCPQ hub, which knows neither tokens nor TLS. Without it that of --host, or 127.0.0.1 where "
        "one of the others wants a token.",
    )
    trusted_hosts: Names = option(
        (),
        "Access",
        "Names that HTTP may be called by (Host header) besides numbers and localhost, separated by commas; '*' for "
        "any, '*.example.org' for those below. Without it other names are refused on connections from this machine.",
    )
    cors_origins: Names = option(
        (), "Access", "Origins whose pages may use HTTP (https://example.org), separated by commas; '*' for any."
    )

    # --- State
    state: Path | None = option(
        None,
        "State",
        "File that keeps the live tree and the stereo camera's parameters: nothing that was answered is lost when the "
        "process ends, however it ends. Made where it is missing; without it everything begins anew.",
    )

    # --- Speed and limits
    threads: int = option(0, "Speed and limits", "Threads that render; 0: one per core.", ge=0, le=1024)
    frame_threads: int = option(
        0,
        "Speed and limits",
        "Threads that may work on one picture while others are idle; 0: as many as render. Fewer leave processors to "
        "other programs when few pictures are asked for at once.",
        ge=0,
        le=1024,
    )
    queue: int = option(
        256,
        "Speed and limits",
        "Requests that may wait for a thread. Waiting is normal, Drake's client never retries; beyond it the answer "
        "is 503 with Retry-After.",
        ge=0,
        le=100_000,
    )
    niceness: int = option(
        0,
        "Speed and limits",
        "How far threads that draw stand behind the process's own priority, so that other programs of the machine go "
        "before them. The event loop does on Linux 6.12 and later; on older kernels it may need 10 here.",
        ge=0,
        le=19,
    )
    queue_mb: int = option(
        2048, "Speed and limits", "MiB of request bodies that arrive, wait or are rendered.", ge=1, le=1 << 20
    )
    max_body_mb: int = option(256, "Speed and limits", "MiB of one request's body; beyond it 413.", ge=1, le=1 << 16)
    max_pixels: int = option(4096 * 4096, "Speed and limits", "Width times height of one picture.", ge=1, le=1 << 28)
    max_triangles: int = option(
        10_000_000,
        "Speed and limits",
        "Triangles, lines and points of one posted scene, all instances counted: 210 bytes each while drawn.",
        ge=1,
        le=1 << 31,
    )
    max_nodes: int = option(100_000, "Speed and limits", "Nodes of one posted scene.", ge=1, le=1 << 24)
    max_image_pixels: int = option(
        8192 * 8192, "Speed and limits", "Width times height of one texture of a posted scene.", ge=1, le=1 << 28
    )
    mesh_cache_mb: int = option(
        512, "Speed and limits", "MiB of geometry kept for requests that bring it again.", ge=0, le=1 << 20
    )
    scene_cache_mb: int = option(
        256, "Speed and limits", "MiB of whole posted scenes kept for requests that bring them again.", ge=0, le=1 << 20
    )
    shutdown_seconds: float = option(
        10.0,
        "Speed and limits",
        "Time that accepted requests get to finish after SIGTERM; streams end at once, nothing new is taken. The "
        "process has ended two seconds later at most.",
        ge=0,
        le=3600,
    )

    # --- Logs
    log_format: Literal["auto", "human", "json"] = option(
        "auto", "Logs", "'human' with colours, 'json' one object a line; 'auto': human in a terminal, else JSON."
    )
    log_level: Literal["debug", "info", "warning", "error"] = option("info", "Logs", "The least that is logged.")

    @model_validator(mode="after")
    def _certificate_and_key(self) -> Self:
        if (self.grpc_certificate is None) != (self.grpc_key is None):
            raise ValueError("--grpc-certificate and --grpc-key need each other")
        if (self.http_certificate is None) != (self.http_key is None):
            raise ValueError("--http-certificate and --http-key need each other")
        if self.grpc_client_ca is not None and self.grpc_certificate is None:
            raise ValueError("--grpc-client-ca needs --grpc-certificate and --grpc-key")
        return self

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

    @classmethod
    def settings_customise_sources(
        cls,
        settings_cls: type[BaseSettings],
        init_settings: PydanticBaseSettingsSource,
        env_settings: PydanticBaseSettingsSource,
        dotenv_settings: PydanticBaseSettingsSource,
        file_secret_settings: PydanticBaseSettingsSource,
    ) -> tuple[PydanticBaseSettingsSource, ...]:
        """Flags, then environment; the file is joined in ``load``, no .env file is read."""
        return init_settings, env_settings


def load(flags: Mapping[str, Any] | None = None, config: Path | None = None) -> Settings:
    """Settings from flags, environment and TOML file, in this order of precedence.

    Args:
        flags: what the command line gave, by setting; absent is not given.
        config: the TOML file; None: the one that SCENEGATE_CONFIG names, if any.

    Raises:
        SettingsError: with a sentence for each value that cannot be used and where it came from.
    """
    flags = dict(flags or {})
    if config is None and os.environ.get(CONFIG_ENV):
        config = Path(os.environ[CONFIG_ENV])
    from_file = _read_file(config) if config is not None else {}
    in_force = {name: value for name, value in from_file.items() if not os.environ.get(env_of(name))}
    try:
        return Settings(**{**in_force, **flags})
    except ValidationError as error:
        sentences = []
        for fault in error.errors(include_url=False):
            reason = fault["msg"].removeprefix("Value error, ")
            if not fault["loc"]:
                sentences.append(f"{reason}.")
                continue
            name = str(fault["loc"][0])
            if name in flags:
                origin = flag_of(name)
            elif os.environ.get(env_of(name)):
                origin = env_of(name)
            else:
                origin = f"{name} in {config}"
            sentences.append(f"{origin}: {reason[:1].lower()}{reason[1:]}, got {fault['input']!r}.")
        raise SettingsError("\n".join(sentences)) from None


def unknown_environment() -> list[str]:
    """A sentence for each SCENEGATE_* variable that is no setting: a typing error would pass unseen otherwise."""
    known = {env_of(name) for name in Settings.model_fields} | OTHER_ENV
    return [
        f"{name} is no setting{_suggestion(name, known)}"
        for name in sorted(os.environ)
        if name.startswith(ENV_PREFIX) and name not in known
    ]


def _read_file(path: Path) -> dict[str, Any]:
    try:
        values = tomllib.loads(path.read_text("utf-8"))
    except OSError as error:
        raise SettingsError(f"The configuration file {path} cannot be read: {error.strerror}.") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise SettingsError(f"The configuration file {path} is not TOML: {error}.") from None
    values = {name.replace("-", "_"): value for name, value in values.items()}
    unknown = [name for name in values if name not in Settings.model_fields]
    if unknown:
        raise SettingsError(
            "\n".join(f"{name} in {path} is no setting{_suggestion(name, Settings.model_fields)}" for name in unknown)
        )
    return values


def _suggestion(name: str, known: Any) -> str:
    close = get_close_matches(name, list(known), n=1)
    return f"; did you mean {close[0]}?" if close else "."
