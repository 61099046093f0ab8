"""Options of the render endpoint, the live scene and the tree viewer, and which interfaces there are."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Literal

from pydantic_settings import BaseSettings

from gateway.settings.types import Color, Interfaces, Paths, Port, PortOrOff, Samples, option


class InterfaceSettings(BaseSettings):
    """Part of ``Settings``."""

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
