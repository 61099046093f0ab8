"""``scenegate render``: renders one image of one scene, or a dataset of many."""

from __future__ import annotations

from dataclasses import fields
from inspect import signature
from pathlib import Path
from typing import TYPE_CHECKING, Any, get_type_hints

import typer
from msgspec.structs import replace

from gateway.cli.dataset import MAX_SHOWN, ExportFormat, export_dataset
from gateway.cli.render_options import RenderOptions
from scenegate.cli.output import print_note
from scenegate.regular_files import is_pipe

if TYPE_CHECKING:
    from gateway.datasets.classes import ClassTable
    from gateway.datasets.scene_sources import Source
    from gateway.datasets.views import View
    from scenegate.datasets.manifest import ImageType, Settings

IMAGE_SUFFIXES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
"""Suffixes of OUT that mean one image."""
UNSUPPORTED_SUFFIXES = (".bmp", ".exr", ".gif", ".npy", ".npz", ".webp")
"""Suffixes of OUT that are rejected: the user meant an image, and would get a folder of that name."""

SAMPLES = (0, 1, 4, 8)
HELP = """Render scenes: one image, or a dataset of images, camera parameters and labels.

If a run was stopped, the same command continues it; finished images are not rendered again.
"""


def add_render(app: typer.Typer) -> None:
    """Add the command. Typer reads its flags from the signature of ``RenderOptions``."""

    def render(**values: Any) -> None:
        run(RenderOptions(**values))

    render.__signature__ = signature(RenderOptions, eval_str=True)  # type: ignore[attr-defined]  # functions have it at run time
    render.__annotations__ = get_type_hints(RenderOptions, include_extras=True)
    app.command("render", help=HELP)(render)


app = typer.Typer(add_completion=False, pretty_exceptions_enable=False, rich_markup_mode="rich")
add_render(app)


def run(options: RenderOptions) -> None:
    """Render one image or a dataset."""
    if options.samples not in SAMPLES:
        raise ValueError(f"--samples {options.samples} is not one of 0, 1, 4, 8")
    suffix, is_folder = options.out.suffix.lower(), options.out.is_dir()
    if suffix in UNSUPPORTED_SUFFIXES and not is_folder:
        raise ValueError(f"{options.out}: images are written as {', '.join(IMAGE_SUFFIXES)}; or name a folder with -o")
    is_image = suffix in IMAGE_SUFFIXES and not is_folder
    if not is_image and any(map(is_pipe, options.scenes)):
        raise ValueError("a pipe is for one image, as it can be read only once: for a dataset write it into a file")
    image_types = _parse_types(options.types)
    formats = _check_options(options, image_types, is_image=is_image)
    background = _parse_color(options.background)
    from gateway.runtime.kernels.parts import ensure_compiled
    from gateway.runtime.workers import process_tuning

    ensure_compiled(show=True)
    process_tuning.pause_gc()
    # The following imports load compiled kernels.
    from gateway.cli.render_image import render_image
    from gateway.datasets.views import View
    from gateway.runtime.workers.scheduling import usable_cpus
    from gateway.scene.draw.cameras import OrbitCamera

    process_tuning.freeze_gc()
    settings = _settings(options, image_types, background)
    views = (
        *(View(f"camera-{index:03d}", text) for index, text in enumerate(options.camera or ())),
        *(
            View(f"orbit-{index:03d}", OrbitCamera(index, options.orbit, options.orbit_elevation))
            for index in range(options.orbit)
        ),
    )
    threads = options.threads or usable_cpus()
    if is_image:
        render_image(options.scenes[0], options.out, settings, views, threads, options.timeout)
    else:
        _render_dataset(options, settings, views, formats, threads)


def _render_dataset(
    options: RenderOptions, settings: Settings, views: tuple[View, ...], formats: tuple[ExportFormat, ...], threads: int
) -> None:
    """Render a dataset and export it to ``formats``. Exit with status 1 if it is incomplete."""
    from gateway.cli.render_dataset import render_dataset
    from gateway.datasets.job import make_job
    from gateway.datasets.scene_sources import find_scenes
    from gateway.datasets.views import CameraFile, read_camera_file

    out = options.out.absolute()
    cameras = CameraFile() if options.cameras is None else read_camera_file(options.cameras)
    scene_numbers = _parse_scene_numbers(options.numbers)
    sources, cameras, scenario_sha256 = find_scenes(
        options.scenes, cameras, scene_numbers, options.recorded, out, bool(views)
    )
    settings = replace(settings, scenario_sha256=scenario_sha256)
    class_table, settings = _parse_classes(options.classes, sources, settings)
    job = make_job(sources, views, cameras, settings, out, options.timeout, class_table)
    complete = render_dataset(job, threads, options.ray)
    if options.classes is not None:
        _report_unseen_classes(options.out)
    for format_name in formats:
        export_dataset(options.out, options.out / format_name, format_name, replace=True)
    if not complete:
        raise typer.Exit(1)


def _check_options(options: RenderOptions, types: tuple[ImageType, ...], *, is_image: bool) -> tuple[ExportFormat, ...]:
    """Check options before kernels are compiled and scenes are read; return the formats to export the dataset to.

    Raises ValueError if an option is invalid, or excluded by another.
    """
    from scenegate.datasets.formats import FORMATS, check_destination, check_types
    from scenegate.robots.joint_text import parse_joints
    from scenegate.robots.xacro_args import parse_xacro_args

    _check_stereo(types, options.baseline, options.stereo_profile)
    if options.depth_mode is not None and "measured" not in types:
        raise ValueError("--depth-mode is for --type measured")
    if is_image and (len(options.scenes) != 1 or options.scenes[0].is_dir() or len(types) != 1 or options.cameras):
        raise ValueError(f"{options.out} is one image: for more scenes, types or cameras name a folder with -o")
    names = options.format_names or []
    if names and is_image:
        raise ValueError(f"--format {names[0]} is for datasets: name a folder with -o")
    if unknown := {*names} - {*FORMATS}:
        raise ValueError(f"--format {min(unknown)[:80]!r}: must be one of {', '.join(FORMATS)}")
    formats = tuple(name for name in FORMATS if name in names)
    for name in formats:
        check_types(types, name)
        check_destination(options.out / name, options.out, name, replace=True)
    if options.rig is not None and options.look not in ("auto", "studio"):
        print_note(f"--rig lights the studio look only: --look {options.look} is rendered without it")
    parse_joints(options.joint or ())
    parse_xacro_args(options.xacro_arg or ())
    return formats


def _settings(options: RenderOptions, types: tuple[ImageType, ...], background: tuple[int, int, int]) -> Settings:
    """Return the settings in the options. Most options have the names of the settings."""
    from scenegate.datasets.manifest import Settings

    shared_names = {each.name for each in fields(options)} & {*Settings.__struct_fields__}
    values = {name: getattr(options, name) for name in shared_names}
    values |= {"types": types, "background": background, "joints": tuple(options.joint or ())}
    values["xacro_args"] = tuple(options.xacro_arg or ())
    values["roots"] = tuple(str(folder.absolute()) for folder in options.root or ())
    if options.rig is not None:
        from gateway.files.assets.light_rig_file import rig_digest

        values |= {"rig": str(options.rig.absolute()), "rig_sha256": rig_digest(options.rig)}
    settings = Settings(**values)
    return _with_profile(settings, options.stereo_profile) if options.stereo_profile else settings


def _parse_scene_numbers(text: str) -> range | None:
    """Return the range of ``--scenes``, ``7`` or ``0-99``; None for an empty text."""
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

    from gateway.adapters.stereo.device.profile import read_profile

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
    print_note(f"--classes: no image has an object of {', '.join(names)}{more}")


def _parse_color(text: str) -> tuple[int, int, int]:
    """Return the numbers in ``204,229,255``."""
    try:
        red, green, blue = (int(part) for part in text.split(","))
    except ValueError:
        red = green = blue = -1
    if not all(0 <= value <= 255 for value in (red, green, blue)):
        raise ValueError(f"--background {text!r}: must be three numbers from 0 to 255, separated by commas")
    return red, green, blue
