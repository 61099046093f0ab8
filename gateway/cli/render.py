"""``scenegate render``: renders one image of one scene, or a dataset of many."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

import typer
from msgspec.structs import replace

from gateway.cli.dataset import MAX_SHOWN, Format, export_dataset
from gateway.cli.robot_options import GltfUp, Joints, Keyframe, Roots, Strict

if TYPE_CHECKING:
    from gateway.datasets.classes import ClassTable
    from gateway.datasets.sources import Source
    from scenegate.datasets.manifest import ImageType, Settings

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
"""Suffixes of OUT that mean one image."""
UNSUPPORTED_SUFFIXES = (".bmp", ".exr", ".gif", ".npy", ".npz", ".webp")
"""Suffixes of OUT that are rejected: the user meant an image, and would get a folder of that name."""

SAMPLES = (0, 1, 4, 8)


def render(
    scenes: Annotated[
        list[Path],
        typer.Argument(
            metavar="SCENES...",
            exists=True,
            help="glTF files, mesh files (.obj, .stl, .ply, .dae, .vtk), robot files (.urdf, .sdf, .xml, .xacro), tree "
            "viewer requests (.json), recorded render requests (.multipart), scenarios (.toml), or folders of such "
            "files.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "-o", "--out", metavar="OUT", help="Folder for a dataset; or, for one scene, an image: .png, .tiff …"
        ),
    ],
    types: Annotated[
        str,
        typer.Option(
            "--type",
            metavar="TYPES",
            help="Types of images, separated by commas: color, depth, label, normal, albedo; for datasets instance, "
            "class, amodal (each of these three adds poses, boxes and visibility of all objects), flow, stereo, "
            "measured.",
        ),
    ] = "color",
    classes: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            exists=True,
            dir_okay=False,
            help="TOML or JSON file with classes of objects: patterns of models, paths and scenes. Default: a "
            "class for each model.",
        ),
    ] = None,
    baseline: Annotated[
        float,
        typer.Option(min=0.0, max=100.0, metavar="METRES", help="Distance of the right camera, for stereo images."),
    ] = 0.0,
    stereo_profile: Annotated[
        str,
        typer.Option(
            metavar="NAME",
            help="Camera profile (rgbd, rc_visard_160c …, or a .toml file), for stereo and measured images: its size, "
            "lens, baseline and depth errors.",
        ),
    ] = "",
    width: Annotated[int, typer.Option(min=1, max=16384, help="Image width in pixels.")] = 640,
    height: Annotated[int, typer.Option(min=1, max=16384, help="Image height in pixels.")] = 480,
    camera: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CAMERA",
            help='fit; path:["robot", "head"] (the frame of a node); eye=x,y,z;target=x,y,z;up=x,y,z;fovy=degrees, '
            "or xmag=metres in place of fovy for an orthographic camera. "
            "Can be repeated. Default: the file's first camera, or fit.",
        ),
    ] = None,
    cameras: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            exists=True,
            dir_okay=False,
            help="JSON file with cameras for all or single scenes.",
        ),
    ] = None,
    orbit: Annotated[
        int, typer.Option(min=0, max=100_000, help="Number of cameras on a circle around each scene.")
    ] = 0,
    orbit_elevation: Annotated[
        float, typer.Option(min=-89.0, max=89.0, help="Elevation of that circle above the horizon, in degrees.")
    ] = 30.0,
    fovy: Annotated[
        float,
        typer.Option(min=0.01, max=179.0, help="Vertical field of view in degrees, for cameras that have none."),
    ] = 45.0,
    numbers: Annotated[
        str,
        typer.Option(
            "--scenes", metavar="NUMBERS", help="Scenes of a scenario: one number, or FIRST-LAST. Default: all."
        ),
    ] = "",
    recorded: Annotated[
        Path | None,
        typer.Option(
            metavar="FOLDER",
            exists=True,
            file_okay=False,
            help="Dataset of the same scenario, whose choices and settled poses are used again.",
        ),
    ] = None,
    look: Annotated[
        Literal["auto", "phong", "plain", "studio", "pbr", "gltf"],
        typer.Option(help="Shading of colour images; auto: studio, but files written by Drake look as in Drake."),
    ] = "auto",
    background: Annotated[str, typer.Option(metavar="R,G,B", help="Background colour, 0 to 255 each.")] = "204,229,255",
    antialias: Annotated[
        Literal["fxaa", "none"],
        typer.Option(help="Edge smoothing of colour images with one sample per pixel; not for studio."),
    ] = "fxaa",
    samples: Annotated[
        int,
        typer.Option(help="Samples per pixel of colour images: 1, 4 or 8; 0: 4 for the studio look, 1 for the others."),
    ] = 0,
    rig: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            exists=True,
            dir_okay=False,
            help="TOML file with lights for the studio look, or a Radiance image (.hdr).",
        ),
    ] = None,
    alpha_threshold: Annotated[
        float,
        typer.Option(
            min=0.0,
            max=1.0,
            metavar="ALPHA",
            help="Alpha below which blended surfaces are left out of depth and label images; 0: none are.",
        ),
    ] = 0.0,
    depth_format: Annotated[
        Literal["tiff", "png"],
        typer.Option(help="Depth images of datasets: tiff (32-bit float, metres) or png (16-bit, millimetres)."),
    ] = "tiff",
    format_names: Annotated[
        list[str] | None,
        typer.Option(
            "--format",
            metavar="FORMAT",
            help="bop, coco, webdataset or hdf5: the dataset is written again in this format, into OUT/FORMAT. Can be "
            "repeated.",
        ),
    ] = None,
    up: Annotated[
        Literal["auto", "y", "z"],
        typer.Option(help="Up axis of glTF files; auto: z for Drake's files, else y."),
    ] = "auto",
    joint: Joints = None,
    root: Roots = None,
    variant: Annotated[
        str, typer.Option(metavar="NAME", help="Variant of the materials of glTF files (KHR_materials_variants).")
    ] = "",
    keyframe: Keyframe = "",
    robot_gltf_up: GltfUp = "y",
    strict: Strict = False,
    threads: Annotated[int, typer.Option(min=0, help="Number of cores to use; 0: all.")] = 0,
    timeout: Annotated[
        float,
        typer.Option(
            min=0.0,
            metavar="SECONDS",
            help="Maximum time for one image; in a dataset, for reading a scene and for each view. 0: no limit.",
        ),
    ] = 0.0,
    ray: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Render on a Ray cluster (HOST:6379, ray://HOST:10001, auto, local)."),
    ] = None,
) -> None:
    """Render scenes: one image, or a dataset of images, camera parameters and labels.

    If a run was stopped, the same command continues it; finished images are not rendered again.
    """
    image_types, color = _parse_types(types), _parse_color(background)
    if samples not in SAMPLES:
        raise ValueError(f"--samples {samples} is not one of 0, 1, 4, 8")
    single = out.suffix.lower() in IMAGE_SUFFIXES and not out.is_dir()
    if out.suffix.lower() in UNSUPPORTED_SUFFIXES and not out.is_dir():
        raise ValueError(f"{out}: images are written as {', '.join(IMAGE_SUFFIXES)}; or name a folder with -o")
    if single and (len(scenes) != 1 or scenes[0].is_dir() or len(image_types) != 1 or cameras is not None):
        raise ValueError(f"{out} is one image: for more scenes, types or cameras name a folder with -o")
    _check_stereo(image_types, baseline, stereo_profile)
    if format_names and single:
        raise ValueError(f"--format {format_names[0]} is for datasets: name a folder with -o")
    formats = _checked_formats(format_names, image_types, out) if format_names else ()
    if rig is not None and look not in ("auto", "studio"):
        typer.echo(f"--rig lights the studio look only: --look {look} is rendered without it", err=True)
    from gateway.runtime.kernels.loading import ensure_compiled
    from scenegate.robots.joint_text import parse_joints

    joints = tuple(joint or ())
    parse_joints(joints)  # raises an error now instead of for each scene
    ensure_compiled(show=True)
    # The following imports load compiled kernels.
    from gateway.assets.light_rig_file import rig_digest
    from gateway.cli.render_dataset import render_dataset
    from gateway.cli.render_image import render_image
    from gateway.datasets.camera_file import CameraFile, read_camera_file
    from gateway.datasets.job import make_job
    from gateway.datasets.scenario_jobs import find_scenes
    from gateway.datasets.views import View
    from gateway.runtime.scheduling import usable_cpus
    from gateway.scene.cameras import OrbitCamera
    from scenegate.datasets.manifest import Settings

    settings = Settings(
        types=image_types,
        width=width,
        height=height,
        fovy=fovy,
        look=look,
        up=up,
        antialias=antialias,
        depth_format=depth_format,
        background=color,
        samples=samples,
        alpha_threshold=alpha_threshold,
        rig=None if rig is None else str(rig.absolute()),
        rig_sha256=None if rig is None else rig_digest(rig),
        joints=joints,
        roots=tuple(str(folder.absolute()) for folder in root or ()),
        variant=variant,
        keyframe=keyframe,
        robot_gltf_up=robot_gltf_up,
        strict=strict,
        baseline=baseline,
    )
    if stereo_profile:
        settings = _with_profile(settings, stereo_profile)
    views = (
        *(View(f"camera-{index:03d}", text) for index, text in enumerate(camera or ())),
        *(View(f"orbit-{index:03d}", OrbitCamera(index, orbit, orbit_elevation)) for index in range(orbit)),
    )
    cores = threads or usable_cpus()
    if single:
        render_image(scenes[0], out, settings, views, cores, timeout)
        return
    file = CameraFile() if cameras is None else read_camera_file(cameras)
    sources, file, digest = find_scenes(scenes, file, _parse_numbers(numbers), recorded, out.absolute(), bool(views))
    class_table, settings = _parse_classes(classes, sources, replace(settings, scenario_sha256=digest))
    job = make_job(sources, views, file, settings, out.absolute(), timeout, class_table)
    complete = render_dataset(job, cores, ray)
    if classes is not None:
        _report_unseen_classes(out)
    for format_name in formats:
        export_dataset(out, out / format_name, format_name, replace=True)
    if not complete:
        raise typer.Exit(1)


def _parse_numbers(text: str) -> range | None:
    """Return the numbers in ``7`` or ``0-99``; None for an empty text."""
    if not text:
        return None
    first, dash, last = text.partition("-")
    last = last if dash else first
    if not first.isdecimal() or not last.isdecimal() or int(last) < int(first):
        raise ValueError(f"--scenes {text!r}: must be a number, or FIRST-LAST")
    return range(int(first), int(last) + 1)


def _parse_types(text: str) -> tuple[ImageType, ...]:
    """Return the types in ``color,depth``, in the order of ``IMAGE_TYPES``."""
    from scenegate.datasets.manifest import IMAGE_TYPES

    wanted = {part.strip() for part in text.split(",") if part.strip()}
    if not wanted or not wanted <= {*IMAGE_TYPES}:
        raise ValueError(f"--type {text[:80]!r}: must be some of {', '.join(IMAGE_TYPES)}, separated by commas")
    return tuple(name for name in IMAGE_TYPES if name in wanted)


def _checked_formats(names: list[str], types: tuple[ImageType, ...], out: Path) -> tuple[Format, ...]:
    """Return the formats of a dataset; raise ValueError if one cannot be written, now and not after the run."""
    from scenegate.datasets.formats import FORMATS, check_destination, check_types

    if unknown := {*names} - {*FORMATS}:
        raise ValueError(f"--format {min(unknown)[:80]!r}: must be one of {', '.join(FORMATS)}")
    formats = tuple(name for name in FORMATS if name in names)
    for name in formats:
        check_types(types, name)
        check_destination(out / name, out, name, replace=True)
    return formats


def _check_stereo(types: tuple[ImageType, ...], baseline: float, profile: str) -> None:
    """Raise ValueError unless there are a baseline or a profile for the images that need them, and for no others."""
    if "measured" in types and not profile:
        raise ValueError("measured images need --stereo-profile NAME")
    if profile and baseline:
        raise ValueError("--stereo-profile has a baseline: leave out --baseline")
    if not {"stereo", "measured"} & {*types} and (baseline or profile):
        raise ValueError("--baseline and --stereo-profile are for --type stereo or measured")
    if "stereo" in types and not (baseline or profile):
        raise ValueError("stereo images need --baseline METRES or --stereo-profile NAME")


def _with_profile(settings: Settings, name: str) -> Settings:
    """Return settings with the image size, lens and baseline of a camera profile."""
    from hashlib import sha256

    from msgspec.json import encode

    from gateway.stereo.device.profile import read_profile

    profile = read_profile(name)
    width, height = profile.stereo.size
    return replace(
        settings,
        width=width,
        height=height,
        baseline=profile.stereo.baseline,
        stereo_profile=str(Path(name).absolute()) if name.endswith(".toml") else name,
        stereo_profile_sha256=sha256(encode(profile)).hexdigest(),
    )


def _parse_classes(path: Path | None, sources: tuple[Source, ...], settings: Settings) -> tuple[ClassTable, Settings]:
    """Return the classes of a dataset, and its settings with the digest of their file."""
    from gateway.datasets.classes import NO_CLASSES, classes_of_models, read_classes
    from gateway.datasets.scenes import load_options, model_names
    from scenegate.datasets.manifest import ANNOTATED_TYPES

    if not {*ANNOTATED_TYPES} & {*settings.types}:
        if path is not None:
            raise ValueError(f"--classes needs one of {', '.join(ANNOTATED_TYPES)} in --type")
        return NO_CLASSES, settings
    if path is not None:
        table, digest = read_classes(path)
        return table, replace(settings, classes_sha256=digest)
    options = load_options(settings)
    return classes_of_models(name for source in sources for name in model_names(source, options)), settings


def _report_unseen_classes(out: Path) -> None:
    """Print the classes of a dataset without an object in any image."""
    from scenegate.datasets import manifest

    unseen = dict(manifest.read_dataset(out).classes)
    for sample in manifest.read_lines(out / manifest.MANIFEST_FILE, manifest.SampleRecord):
        for each in sample.objects:
            unseen.pop(str(each.class_id), None)
        if not unseen:
            return
    names = [*unseen.values()][:MAX_SHOWN]
    more = f" and {len(unseen) - len(names)} more" if len(unseen) > len(names) else ""
    typer.echo(f"--classes: no image has an object of {', '.join(names)}{more}", err=True)


def _parse_color(text: str) -> tuple[int, int, int]:
    """Return the numbers in ``204,229,255``."""
    try:
        red, green, blue = (int(part) for part in text.split(","))
    except ValueError:
        red = green = blue = -1
    if not all(0 <= value <= 255 for value in (red, green, blue)):
        raise ValueError(f"--background {text!r}: must be three numbers from 0 to 255, separated by commas")
    return red, green, blue
