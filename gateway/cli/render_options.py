"""Options of ``scenegate render``, from which Typer makes its flags."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

from typer import Argument, BadParameter, Option

from scenegate.regular_files import standard_input


def _file(text: str) -> Any:
    """Return the option of an existing file."""
    return Option(metavar="FILE", exists=True, dir_okay=False, help=text)


def _folder(text: str) -> Any:
    """Return the option of an existing folder."""
    return Option(metavar="FOLDER", exists=True, file_okay=False, help=text)


def _scene(text: str) -> Path:
    """Return the path of a file, folder or pipe; ``-`` is the standard input."""
    path = standard_input() if text == "-" else Path(text)
    if not path.exists():
        raise BadParameter(f"path {text!r} does not exist.")
    return path


@dataclass(frozen=True, slots=True)
class RenderOptions:
    """Values of the options, named as in ``manifest.Settings`` where they are settings of a dataset."""

    scenes: Annotated[
        list[Path],
        Argument(
            metavar="SCENES...",
            parser=_scene,
            help="glTF files, mesh files (.obj, .stl, .ply, .dae, .vtk), robot files (.urdf, .sdf, .xml, .xacro), tree "
            "viewer requests (.json), recorded render requests (.multipart), scenarios (.toml), or folders of such "
            "files. For one image also a pipe with a robot file; - is the standard input.",
        ),
    ]
    out: Annotated[
        Path,
        Option("-o", "--out", metavar="OUT", help="Folder for a dataset; or, for one scene, an image: .png, .tiff …"),
    ]
    types: Annotated[
        str,
        Option(
            "--type",
            metavar="TYPES",
            help="Types of images, separated by commas: color, depth, label, normal, albedo; for datasets instance, "
            "class, amodal (each of these three adds poses, boxes and visibility of all objects), flow, stereo, "
            "measured.",
        ),
    ] = "color"
    classes: Annotated[
        Path | None,
        _file(
            "TOML or JSON file with classes of objects: patterns of models, paths and scenes. Default: a "
            "class for each model."
        ),
    ] = None
    baseline: Annotated[
        float, Option(min=0.0, max=100.0, metavar="METRES", help="Distance of the right camera, for stereo images.")
    ] = 0.0
    stereo_profile: Annotated[
        str,
        Option(
            metavar="NAME",
            help="Camera profile (rgbd, rc_visard_160c …, or a .toml file), for stereo and measured images: its size, "
            "lens, baseline and depth.",
        ),
    ] = ""
    depth_mode: Annotated[
        Literal["matched", "ground_truth"] | None,
        Option(help="Depth of measured images: by a matcher, or exact. The default is the profile's."),
    ] = None
    width: Annotated[int, Option(min=1, max=16384, help="Image width in pixels.")] = 640
    height: Annotated[int, Option(min=1, max=16384, help="Image height in pixels.")] = 480
    camera: Annotated[
        list[str] | None,
        Option(
            metavar="CAMERA",
            help='fit; path:["robot", "head"] (the frame of a node); eye=x,y,z; target=x,y,z; up=x,y,z; fovy=degrees, '
            "or xmag=metres in place of fovy for an orthographic camera. "
            "Can be repeated. Default: the file's first camera, or fit.",
        ),
    ] = None
    cameras: Annotated[Path | None, _file("JSON file with cameras for all or single scenes.")] = None
    orbit: Annotated[int, Option(min=0, max=100_000, help="Number of cameras on a circle around each scene.")] = 0
    orbit_elevation: Annotated[
        float, Option(min=-89.0, max=89.0, help="Elevation of that circle above the horizon, in degrees.")
    ] = 30.0
    fovy: Annotated[
        float, Option(min=0.01, max=179.0, help="Vertical field of view in degrees, for cameras that have none.")
    ] = 45.0
    numbers: Annotated[
        str,
        Option("--scenes", metavar="NUMBERS", help="Scenes of a scenario: one number, or FIRST-LAST. Default: all."),
    ] = ""
    recorded: Annotated[
        Path | None, _folder("Dataset of the same scenario, whose choices and settled poses are used again.")
    ] = None
    look: Annotated[
        Literal["auto", "phong", "plain", "studio", "pbr", "gltf"],
        Option(help="Shading of colour images; auto: studio, but pbr for files that Drake merged."),
    ] = "auto"
    background: Annotated[str, Option(metavar="R,G,B", help="Background colour, 0 to 255 each.")] = "204,229,255"
    antialias: Annotated[
        Literal["fxaa", "none"], Option(help="Edge smoothing of colour images with one sample per pixel.")
    ] = "fxaa"
    samples: Annotated[
        int, Option(help="Samples per pixel of colour images: 1, 4 or 8; 0: 4 for the studio look, 1 for the others.")
    ] = 0
    rig: Annotated[Path | None, _file("TOML file with lights for the studio look, or a Radiance image (.hdr).")] = None
    alpha_threshold: Annotated[
        float,
        Option(
            min=0.0,
            max=1.0,
            metavar="ALPHA",
            help="Alpha below which blended surfaces are left out of depth and label images; 0: none are.",
        ),
    ] = 0.0
    depth_format: Annotated[
        Literal["tiff", "png"],
        Option(help="Depth images of datasets: tiff (32-bit float, metres) or png (16-bit, millimetres)."),
    ] = "tiff"
    format_names: Annotated[
        list[str] | None,
        Option(
            "--format",
            metavar="FORMAT",
            help="bop, coco, webdataset or hdf5: the dataset is written again in this format, into OUT/FORMAT. Can be "
            "repeated.",
        ),
    ] = None
    up: Annotated[
        Literal["auto", "y", "z"],
        Option(
            help="Up axis of glTF and mesh files; auto: of glTF y, or z for files that Drake merged; of COLLADA as the "
            "file says; of others z."
        ),
    ] = "auto"
    scale: Annotated[
        float,
        Option(
            min=1e-9,
            max=1e9,
            metavar="FACTOR",
            help="Factor of all lengths in glTF, mesh and robot files: 0.001 for millimetres.",
        ),
    ] = 1.0
    joint: Annotated[
        list[str] | None,
        Option(
            metavar="NAME=VALUE",
            help="Joint value of a robot file, in radians or metres; several numbers separated by commas for joints "
            "that have several. Can be repeated.",
        ),
    ] = None
    root: Annotated[
        list[Path] | None, _folder("Folder with the packages of a robot file's package:// names. Can be repeated.")
    ] = None
    xacro_arg: Annotated[
        list[str] | None,
        Option(metavar="NAME:=VALUE", help="Value of an argument of a xacro file, $(arg NAME). Can be repeated."),
    ] = None
    variant: Annotated[
        str, Option(metavar="NAME", help="Variant of the materials of glTF files that have several.")
    ] = ""
    keyframe: Annotated[str, Option(metavar="NAME", help="Keyframe of an MJCF file, which has the joints' values.")] = (
        ""
    )
    robot_gltf_up: Annotated[
        Literal["y", "z", "auto"],
        Option(
            help="Up axis of the glTF meshes of a URDF or SDF file; auto: the one that fits the collision geometry."
        ),
    ] = "y"
    strict: Annotated[
        bool, Option("--strict", help="Refuse a file of which something cannot be drawn, instead of a warning.")
    ] = False
    threads: Annotated[int, Option(min=0, help="Number of cores to use; 0: all.")] = 0
    timeout: Annotated[
        float,
        Option(
            min=0.0,
            metavar="SECONDS",
            help="Maximum time for one image; in a dataset, for reading a scene and for each view. 0: no limit.",
        ),
    ] = 0.0
    ray: Annotated[
        str | None,
        Option(metavar="ADDRESS", help="Render on a Ray cluster (HOST:6379, ray://HOST:10001, auto, local)."),
    ] = None
