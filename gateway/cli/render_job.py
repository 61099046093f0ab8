"""What ``scenegate render`` does once its kernels are there."""

from __future__ import annotations

import signal
import time
from functools import partial
from pathlib import Path
from typing import Final

import typer
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeRemainingColumn

from gateway.client import manifest
from gateway.client.manifest import IMAGE_TYPES, ImageType, Settings
from gateway.datasets import run as runs
from gateway.datasets.camera_file import CameraFile, read_camera_file
from gateway.datasets.draw import FORMATS, draw, style_of, unlit_by_rig
from gateway.datasets.local_tasks import run_local
from gateway.datasets.plan import make_order
from gateway.datasets.ray_tasks import run_ray
from gateway.datasets.scenes import SceneError, load_scene
from gateway.datasets.sources import Kind, find_sources
from gateway.datasets.views import View, camera_of
from renderers.raster import CpuRenderer
from renderers.stop import run_within

LINE_SECONDS: Final = 10.0
"""Between two lines of progress in a log."""


def types_of(text: str) -> tuple[ImageType, ...]:
    """``color,depth`` -> its types, in their usual order.

    Raises:
        ValueError: something else is in it.
    """
    wanted = [part.strip() for part in text.split(",") if part.strip()]
    if not wanted or not set(wanted) <= set(IMAGE_TYPES):
        raise ValueError(f"--type {text!r}: of color, depth and label, separated by commas")
    return tuple(image_type for image_type in IMAGE_TYPES if image_type in wanted)


def samples_of(number: int) -> int:
    """
    Raises:
        ValueError: it is none of 0, 1, 4, 8.
    """
    if number not in (0, 1, 4, 8):
        raise ValueError(f"--samples {number} is none of 0, 1, 4, 8")
    return number


def color_of(text: str) -> tuple[int, int, int]:
    """``204,229,255`` -> its numbers.

    Raises:
        ValueError: they are not three from 0 to 255.
    """
    try:
        red, green, blue = (int(part) for part in text.split(","))
    except ValueError:
        red = green = blue = -1
    if not all(0 <= value <= 255 for value in (red, green, blue)):
        raise ValueError(f"--background {text!r}: three numbers from 0 to 255, separated by commas")
    return red, green, blue


def one_picture(
    scenes: list[Path],
    out: Path,
    settings: Settings,
    views: list[View],
    cameras: Path | None,
    threads: int,
    timeout: float,
) -> None:
    """One scene into one file; a label picture gets a ``.labels.json`` beside it.

    Args:
        timeout: seconds for all of it; 0: any time.

    Raises:
        ValueError: more than one picture is meant, or it cannot be drawn.
        OSError: it cannot be written, or took too long.
    """
    error = TimeoutError(f"{out}: it took longer than --timeout = {timeout:g} s")
    run_within(timeout, lambda: _one_picture(scenes, out, settings, views, cameras, threads), error)


def _one_picture(
    scenes: list[Path], out: Path, settings: Settings, views: list[View], cameras: Path | None, threads: int
) -> None:
    """Draw one image of one scene, without a time limit."""
    if len(scenes) != 1 or scenes[0].is_dir() or len(settings.types) != 1 or len(views) > 1 or cameras is not None:
        raise ValueError(f"{out} is one picture: for more scenes, types or cameras name a folder with -o")
    (image_type,) = settings.types
    name = out.suffix[1:].lower()
    if name not in FORMATS[image_type]:
        suffixes = " or ".join(f".{suffix}" for suffix in FORMATS[image_type])
        raise ValueError(f"{out}: a {image_type} picture is written as {suffixes}")
    (source,) = find_sources(scenes)
    if source.kind is Kind.REQUEST:
        raise ValueError(f"{scenes[0]}: a recorded request says itself what it is; name a folder with -o")
    try:
        scene = load_scene(source, settings.up)  # type: ignore[arg-type]  # y, z or auto
    except SceneError as error:
        raise ValueError(f"{scenes[0]}: {error}") from None
    view = views[0] if views else View("default", None)
    camera = camera_of(view, scene.root, scene.drawn, scene.own_camera, settings.width, settings.height, settings.fovy)
    style = style_of(settings)
    data = draw(CpuRenderer(threads), scene, camera, {image_type: name}, style)[image_type]
    out.parent.mkdir(parents=True, exist_ok=True)
    out.write_bytes(data)
    if image_type == "label":
        out.with_suffix(".labels.json").write_bytes(manifest.encode_labels(scene.record))
    for warning in (*scene.record.warnings, unlit_by_rig(scene, settings)):
        if warning is not None:
            typer.echo(f"{scenes[0]}: {warning}", err=True)


def dataset(
    scenes: list[Path],
    out: Path,
    settings: Settings,
    views: tuple[View, ...],
    cameras: Path | None,
    cores: int,
    ray: str | None,
    timeout: float,
) -> bool:
    """Makes or completes a dataset; whether anything failed.

    Args:
        timeout: seconds for reading each scene, and for each of its views; 0: any time.

    Raises:
        ValueError, OSError, RuntimeError: it could not be started, with a sentence.
    """
    file = CameraFile() if cameras is None else read_camera_file(cameras)
    order = make_order(find_sources(scenes), views, file, settings, out.absolute(), timeout)
    signal.signal(signal.SIGTERM, signal.default_int_handler)  # stops as Ctrl+C does
    execute = partial(run_local, workers=cores) if ray is None else partial(run_ray, address=ray)
    console = Console(stderr=True)
    begin = time.monotonic()
    columns = (
        TextColumn("Drawing"),
        BarColumn(),
        MofNCompleteColumn(),
        TimeRemainingColumn(),
        TextColumn("{task.fields[note]}"),
    )
    with Progress(*columns, console=console, transient=True, disable=not console.is_terminal) as bar:
        shown = bar.add_task("", total=order.size, note="")
        said = begin

        def report(progress: runs.Progress) -> None:
            nonlocal said
            note = f"{len(progress.failures)} failed" if progress.failures else ""
            bar.update(shown, completed=progress.finished, note=note)
            if not console.is_terminal and time.monotonic() - said > LINE_SECONDS:
                said = time.monotonic()
                typer.echo(f"{progress.finished} of {progress.total} done {note}", err=True)

        try:
            progress = runs.run(order, execute, report)
        except KeyboardInterrupt:
            typer.echo("Stopped. The same command goes on from here.", err=True)
            raise typer.Exit(130) from None
    for name, warnings in sorted(progress.warnings.items()):
        for warning in warnings:
            typer.echo(f"{name}: {warning}", err=True)
    for failure in progress.failures:
        where = failure.scene if failure.view is None else f"{failure.scene}, {failure.view}"
        typer.echo(f"scenegate: {where}: {failure.reason}", err=True)
    seconds = time.monotonic() - begin
    typer.echo(
        f"{out}: {progress.finished} of {progress.total} samples, {progress.kept} of them from before, "
        f"{progress.drawn} drawn in {seconds:.1f} s"
        + (f"; {len(progress.failures)} problems, see {manifest.FAILED}" if progress.failures else ""),
        err=True,
    )
    return bool(progress.failures)
