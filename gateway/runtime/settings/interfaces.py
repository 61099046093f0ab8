"""Settings of the render endpoint, the live scene and the tree viewer; which interfaces run, and where they listen."""

import os
from functools import partial
from pathlib import Path
from typing import Literal

from pydantic_settings import BaseSettings

from gateway.runtime.settings.option import option
from gateway.runtime.settings.types import Color, Interfaces, LcmUrl, Paths, Port, PortOrOff, Samples, XacroArguments
from renderers.interface import LookName

interface = partial(option, "Interfaces")
render = partial(option, "Render endpoint")
tree_viewer = partial(option, "Tree viewer")


class InterfaceSettings(BaseSettings):
    """Part of ``Settings``."""

    host: str = interface(
        "127.0.0.1",
        "Address on which HTTP, gRPC and TCPQ listen. 0.0.0.0 accepts other machines; gRPC then also listens on IPv6, "
        "because its library treats 0.0.0.0 and :: alike.",
    )
    http_port: Port = interface(
        8000, "HTTP port: render endpoint, scene, docs, health. 0 picks a free port.", flag="--port"
    )
    only: Interfaces = interface(
        (), "Start only these interfaces, separated by commas: render, scene, treeviewer, stereo, view."
    )
    foxglove_port: PortOrOff = interface(
        None,
        "Port of Foxglove's WebSocket on 127.0.0.1: live scene and stereo camera for the Foxglove app; 'off': none. 0 "
        "picks a free port. Needs scenegate[foxglove]; it has no tokens.",
    )
    demo: bool = interface(False, "Publish a moving demo scene in the live tree, under 'demo'.")

    render_path: str = render("/render", "Path of Drake's render endpoint.", pattern=r"^/\S*[^/\s]$")
    look: Literal["auto", LookName] = render(
        "auto",
        "Shading of colour images: 'phong' as RenderEngineVtk without glTF meshes, 'pbr' as with them, 'gltf' as the "
        "glTF specification says; 'auto' is 'phong' or 'pbr' for Drake's scenes, and 'gltf' for others; 'plain' as the "
        "browser view, 'studio' with the lights and environment of --rig.",
    )
    rig: Path | None = render(
        None,
        "TOML file with lights, environment map and exposure of the look 'studio' of the render endpoint, GET "
        "/scene/render and /view/frame.jpg; or a Radiance image (.hdr), the environment map alone.",
    )
    samples: Samples = render(
        1, "Samples per pixel of colour images. With 1, edges are smoothed by FXAA, as in Drake's RenderEngineVtk."
    )
    background: Color = render((204, 229, 255), "Background colour, 0 to 255 each.")
    alpha_threshold: float = render(
        0.0,
        "Alpha, 0 to 1, below which blended surfaces are left out of depth and label images, also of the live scene "
        "and the stereo camera; 0: none are. The looks 'phong' and 'pbr' leave out nothing, as RenderEngineVtk.",
        ge=0.0,
        le=1.0,
    )
    depth_format: Literal["tiff", "png"] = render(
        "tiff", "Depth as 32-bit float TIFF in metres, or as 16-bit PNG in millimetres."
    )
    backdrop: str | None = render(
        None,
        "Geometry added to every image: 'live' for the live tree, or a file: glTF, a mesh, or a robot (urdf, xml), "
        "whose packages are found by --mesh-root.",
    )
    up: Literal["auto", "y", "z"] = render(
        "auto",
        "Up axis of glTF and mesh files of --backdrop and --stereo-scene; 'auto': of glTF Y, or Z if Drake's render "
        "client merged the file; of COLLADA as the file says; of others Z.",
    )
    scale: float = render(
        1.0,
        "Factor of all lengths in the files of --backdrop and --stereo-scene: 0.001 for millimetres.",
        gt=0.0,
        le=1e9,
    )
    robot_gltf_up: Literal["y", "z", "auto"] = render(
        "y",
        "Up axis of the glTF meshes of a robot in --backdrop and --stereo-scene; 'auto': what fits the collision "
        "geometry.",
    )
    xacro_arg: XacroArguments = render(
        (),
        "Values of the arguments of a xacro file in --backdrop and --stereo-scene, $(arg NAME), as NAME:=VALUE; "
        "separated by |, and the flag can be repeated.",
    )
    strict: bool = render(
        False,
        "Refuse what cannot be drawn completely, instead of a warning: files of --backdrop and --stereo-scene, scenes "
        "of render requests, commands of the tree viewer, Drake's messages.",
    )
    keep_failures: Path | None = render(None, "Folder in which rejected render requests are stored for replay.")

    lcm_url: LcmUrl | None = tree_viewer(
        None, "LCM network, in the format of LCM_DEFAULT_URL, which is the default; 'off': no LCM."
    )
    tcpq_port: PortOrOff = tree_viewer(
        7700, "Port of the built-in TCPQ hub, for clients without multicast; 'off': no hub."
    )
    drake_viewer: bool = tree_viewer(
        True,
        "Show what Drake's simulations publish over LCM: the channels DRAKE_VIEWER_*, CONTACT_RESULTS, "
        "DRAKE_POINT_CLOUD* and DRAKE_DRAW_FRAMES*.",
    )
    mesh_root: Paths = tree_viewer(
        (Path("auto"),),
        f"Folders from which mesh_file, package:// and Drake's meshes may read, separated by '{os.pathsep}'. 'auto' "
        "among them: programs on this machine (by UDP with ttl=0, or by TCPQ on loopback) may name meshes and textures "
        "in any folder, unless there is a --root-path. 'off': no files.",
    )

    def is_enabled(self, interface: str) -> bool:
        """Return True if ``--only`` names the interface, or is not set."""
        return not self.only or interface in self.only
