"""``scenegate render``: one picture of one scene, or a dataset of many."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

PICTURES = (".png", ".jpg", ".jpeg", ".tif", ".tiff")
"""An OUT that ends so is one picture."""
FOREIGN = (".bmp", ".exr", ".gif", ".npy", ".npz", ".webp")
"""An OUT that ends so was meant to be one picture, and would be a folder: it is refused."""


class LookChoice(StrEnum):
    auto = "auto"
    phong = "phong"
    plain = "plain"
    studio = "studio"
    pbr = "pbr"


class UpChoice(StrEnum):
    auto = "auto"
    y = "y"
    z = "z"


class AntialiasChoice(StrEnum):
    fxaa = "fxaa"
    none = "none"


class DepthChoice(StrEnum):
    tiff = "tiff"
    png = "png"


def render(
    scenes: Annotated[
        list[Path],
        typer.Argument(
            metavar="SCENES...",
            exists=True,
            help="glTF files, mesh files (.obj, .stl, .ply, .dae), requests of tree viewer clients (.json), recorded "
            "render requests (.multipart), or folders of them.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            "-o", "--out", metavar="OUT", help="A folder for the dataset; or, for one scene, a picture: .png, .tiff …"
        ),
    ],
    types: Annotated[
        str, typer.Option("--type", metavar="TYPES", help="color, depth, label, or several with commas.")
    ] = "color",
    width: Annotated[int, typer.Option(min=1, max=16384, help="Columns, pixels.")] = 640,
    height: Annotated[int, typer.Option(min=1, max=16384, help="Rows, pixels.")] = 480,
    camera: Annotated[
        list[str] | None,
        typer.Option(
            metavar="CAMERA",
            help='fit; path:["robot", "head"] for a node\'s frame; eye=x,y,z;target=x,y,z;up=x,y,z;fovy=degrees. '
            "May be repeated. Default: the file's first camera, or fit.",
        ),
    ] = None,
    cameras: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", exists=True, dir_okay=False, help="JSON: cameras of all scenes, or of each its own."
        ),
    ] = None,
    orbit: Annotated[int, typer.Option(min=0, max=100_000, help="So many cameras on a circle around each scene.")] = 0,
    orbit_elevation: Annotated[
        float, typer.Option(min=-89.0, max=89.0, help="Of that circle above the horizon, degrees.")
    ] = 30.0,
    fovy: Annotated[
        float, typer.Option(min=0.01, max=179.0, help="Vertical field of view where a camera names none, degrees.")
    ] = 45.0,
    look: Annotated[
        LookChoice, typer.Option(help="How colour is made; auto: studio, but Drake's files as Drake shows them.")
    ] = LookChoice.auto,
    background: Annotated[
        str, typer.Option(metavar="R,G,B", help="Colour where nothing is; 0 to 255 each.")
    ] = "204,229,255",
    antialias: Annotated[
        AntialiasChoice, typer.Option(help="Of colour with one sample a pixel, other than studio.")
    ] = AntialiasChoice.fxaa,
    samples: Annotated[
        int, typer.Option(help="Samples a pixel of colour: 1, 4 or 8; 0: 4 of the studio look, 1 of the others.")
    ] = 0,
    rig: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            exists=True,
            dir_okay=False,
            help="TOML: lights of the studio look, the only one that they light.",
        ),
    ] = None,
    depth_format: Annotated[
        DepthChoice, typer.Option(help="In a dataset: tiff is 32-bit metres, png 16-bit millimetres.")
    ] = DepthChoice.tiff,
    up: Annotated[
        UpChoice, typer.Option(help="The files' up axis; auto: y, but z for files that Drake wrote.")
    ] = UpChoice.auto,
    threads: Annotated[int, typer.Option(min=0, help="Cores that draw; 0: all of this machine.")] = 0,
    timeout: Annotated[
        float,
        typer.Option(
            min=0.0,
            metavar="SECONDS",
            help="Time for one picture; in a dataset, for reading a scene and for each view. 0: any.",
        ),
    ] = 0.0,
    ray: Annotated[
        str | None,
        typer.Option(metavar="ADDRESS", help="Draw on a Ray cluster (HOST:6379, ray://HOST:10001, auto, local)."),
    ] = None,
) -> None:
    """Draw scenes: a dataset of pictures, camera parameters and labels, or one picture.

    Run the same command again to go on where it was stopped: what is done is not done again.
    """
    from gateway.runtime import kernel_cache
    from gateway.runtime.kernel_progress import on_stderr
    from gateway.wiring import warmup

    kernel_cache.ensure_cached(warmup.PARTS, on_stderr)
    # All below imports compiled kernels.
    from gateway.assets.light_rig_file import rig_digest
    from gateway.cli import render_job
    from gateway.client.manifest import Settings
    from gateway.datasets.views import View
    from gateway.runtime.worker_pool import usable_cpus
    from gateway.scene.cameras import OrbitCamera

    settings = Settings(
        types=render_job.types_of(types),
        width=width,
        height=height,
        fovy=fovy,
        look=look.value,
        up=up.value,
        antialias=antialias.value,
        depth_format=depth_format.value,
        background=render_job.color_of(background),
        samples=render_job.samples_of(samples),
        rig=None if rig is None else str(rig.absolute()),
        rig_sha256=None if rig is None else rig_digest(rig),
    )
    if rig is not None and look not in (LookChoice.auto, LookChoice.studio):
        typer.echo(f"--rig lights the studio look only: --look {look.value} is drawn without it", err=True)
    named = [View(f"camera-{index:03d}", text) for index, text in enumerate(camera or ())]
    around = [View(f"orbit-{index:03d}", OrbitCamera(index, orbit, orbit_elevation)) for index in range(orbit)]
    cores = threads or usable_cpus()
    if out.suffix.lower() in FOREIGN and not out.is_dir():
        raise ValueError(f"{out}: pictures are written as {', '.join(PICTURES)}; or name a folder with -o")
    if out.suffix.lower() in PICTURES and not out.is_dir():
        render_job.one_picture(scenes, out, settings, [*named, *around], cameras, cores, timeout)
    elif render_job.dataset(scenes, out, settings, (*named, *around), cameras, cores, ray, timeout):
        raise typer.Exit(1)
