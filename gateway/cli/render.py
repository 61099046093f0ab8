"""``scenegate render``: pictures of scene files, one or a folder full."""

from __future__ import annotations

from collections.abc import Iterator
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

_SCENES = (".gltf", ".glb")


class Type(StrEnum):
    color = "color"
    depth = "depth"
    label = "label"


class LookChoice(StrEnum):
    auto = "auto"
    phong = "phong"
    plain = "plain"
    pbr = "pbr"


class UpChoice(StrEnum):
    auto = "auto"
    y = "y"
    z = "z"


def render(
    scene: Annotated[
        Path, typer.Argument(metavar="SCENE", exists=True, help="A .gltf or .glb file, or a folder of such files.")
    ],
    out: Annotated[
        Path, typer.Option("-o", "--out", metavar="OUT", help="The picture; for a folder of scenes, a folder.")
    ],
    image_type: Annotated[Type, typer.Option("--type", help="What to draw.")] = Type.color,
    width: Annotated[int, typer.Option(min=1, max=16384, help="Columns, pixels.")] = 640,
    height: Annotated[int, typer.Option(min=1, max=16384, help="Rows, pixels.")] = 480,
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="CAMERA",
            help='fit; path:["robot", "head"] for a node\'s frame; eye=x,y,z;target=x,y,z;up=x,y,z;fovy=degrees. '
            "Default: the file's first camera, or fit.",
        ),
    ] = None,
    look: Annotated[
        LookChoice, typer.Option(help="How colour is made; auto: by the file's generator.")
    ] = LookChoice.auto,
    up: Annotated[
        UpChoice, typer.Option(help="The file's up axis; auto: y, but z for files that Drake wrote.")
    ] = UpChoice.auto,
    threads: Annotated[int, typer.Option(min=0, help="Threads that draw; 0: one per core.")] = 0,
) -> None:
    """Draw scene files: colour as PNG or JPEG, depth as TIFF (metres) or PNG (millimetres), labels as PNG."""
    from gateway.cli.pictures import SUFFIXES, Wish, write_picture
    from gateway.ops import kernels
    from gateway.workers import usable_cpus

    if scene.is_dir():
        suffix = SUFFIXES[image_type.value][0]
        jobs = [(path, (out / path.relative_to(scene)).with_suffix(suffix)) for path in _scenes_below(scene)]
        if not jobs:
            raise ValueError(f"{scene} holds no .gltf and no .glb file")
    else:
        jobs = [(scene, out)]
    wish = Wish(image_type.value, width, height, camera, look.value, up.value)
    if not kernels.are_cached():
        typer.echo("Compiling the rendering kernels; `scenegate warmup` does that once for all ...", err=True)
    from renderers.cpu import CpuRenderer

    renderer = CpuRenderer(threads or usable_cpus())
    failed = 0
    for source, target in _with_progress(jobs):
        try:
            warnings = write_picture(renderer, source, target, wish)
        except (OSError, ValueError) as error:
            failed += 1
            typer.echo(f"scenegate: {error}", err=True)
        else:
            for warning in warnings:
                typer.echo(f"{source}: {warning}", err=True)
    if failed:
        raise typer.Exit(1)


def _scenes_below(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.suffix.lower() in _SCENES and path.is_file())


def _with_progress(jobs: list[tuple[Path, Path]]) -> Iterator[tuple[Path, Path]]:
    """The jobs, with a bar on stderr when there are many and somebody looks."""
    from rich.console import Console
    from rich.progress import Progress

    console = Console(stderr=True)
    with Progress(console=console, transient=True, disable=len(jobs) < 2 or not console.is_terminal) as progress:
        yield from progress.track(jobs, description="Drawing")
