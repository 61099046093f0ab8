"""The command ``scenegate stream``: receive the image sets of Scenegate's stereo camera or of a real rc_visard."""

from __future__ import annotations

import contextlib
from pathlib import Path
from typing import Annotated

import typer


def stream(
    target: Annotated[
        str, typer.Argument(metavar="HOST:PORT", help="Address of the camera; the default port is 50051.")
    ],
    left: Annotated[bool, typer.Option("--left", help="Left image.")] = False,
    right: Annotated[bool, typer.Option("--right", help="Right image.")] = False,
    disparity: Annotated[bool, typer.Option("--disparity", help="Disparity image.")] = False,
    error: Annotated[bool, typer.Option("--error", help="Disparity error image.")] = False,
    confidence: Annotated[bool, typer.Option("--confidence", help="Confidence image.")] = False,
    mesh: Annotated[bool, typer.Option("--mesh", help="Mesh, as PLY.")] = False,
    color: Annotated[bool, typer.Option("--color", help="Left and right in colour.")] = False,
    color_camera: Annotated[bool, typer.Option("--color-camera", help="Image of the colour camera.")] = False,
    depth: Annotated[bool, typer.Option("--depth", help="Depth in millimetres, 16 bits.")] = False,
    aligned: Annotated[bool, typer.Option("--aligned", help="With --depth: as seen by the colour camera.")] = False,
    max_points: Annotated[
        int, typer.Option(min=0, help="Maximum number of points of a mesh, at least 1000; 0: no limit.")
    ] = 0,
    min_depth: Annotated[
        bool, typer.Option("--min-depth", help="Take the nearest point of each bin of a mesh instead of the mean.")
    ] = False,
    watertight: Annotated[bool, typer.Option("--watertight", help="Mesh without holes.")] = False,
    textured: Annotated[bool, typer.Option("--textured", help="Mesh with colours.")] = False,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FOLDER", help="Write PNG, PLY, npz and parameter files for cvkit there."),
    ] = None,
    exposure: Annotated[
        bool, typer.Option("--exposure", help="With -o: write exposure time, gain, noise and brightness of each image.")
    ] = False,
    gpio: Annotated[
        bool, typer.Option("--gpio", help="With -o: write the GPIOs of each image, and their bits in the file names.")
    ] = False,
    truth: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="With -o: write exact depth and labels of each set, from this gateway's HTTP port http://HOST:PORT.",
        ),
    ] = None,
    imu: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="With -o: write imu.csv with accelerations and angular velocities, from this gateway's HTTP port.",
        ),
    ] = None,
    pipeline: Annotated[
        int, typer.Option(min=0, help="Number of the camera of --truth and --imu, if there are several.")
    ] = 0,
    preview: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Image of the newest set, all images side by side, disparity in colours."),
    ] = None,
    count: Annotated[int, typer.Option(min=0, help="End after this number of sets; 0: when interrupted.")] = 0,
    timeout: Annotated[
        float, typer.Option(min=0.0, help="End with an error after this number of seconds; 0: never.")
    ] = 0.0,
    token: Annotated[
        str | None,
        typer.Option(
            envvar="SCENEGATE_TOKEN", help="Bearer token. Other users of this machine can read command lines."
        ),
    ] = None,
    token_file: Annotated[Path | None, typer.Option(metavar="FILE", exists=True, help="File with the token.")] = None,
    tls: Annotated[bool, typer.Option("--tls", help="Encrypt, and trust the system's authorities.")] = False,
    ca: Annotated[
        Path | None,
        typer.Option(metavar="FILE", exists=True, envvar="SCENEGATE_CA", help="Encrypt, and trust this PEM authority."),
    ] = None,
    certificate: Annotated[
        Path | None, typer.Option(metavar="FILE", exists=True, help="PEM certificate of this client.")
    ] = None,
    key: Annotated[
        Path | None, typer.Option(metavar="FILE", exists=True, help="PEM private key of --certificate.")
    ] = None,
) -> None:
    """Receive image sets of a stereo camera, Scenegate's or a real rc_visard. Default: left and disparity."""
    from gateway.client.channel import Credentials, read_token
    from gateway.client.stream import Progress, StreamOptions, receive_all
    from gateway.runtime.progress_bar import progress_bar

    if out is None and (exposure or gpio or truth is not None or imu is not None):
        raise typer.BadParameter("--exposure, --gpio, --truth and --imu need -o FOLDER")
    if token_file is not None:
        token = read_token(token_file)
    credentials = Credentials(token, tls, ca, certificate, key)
    options = StreamOptions(
        target, left=left, right=right, disparity=disparity, error=error, confidence=confidence, mesh=mesh, color=color,
        color_camera=color_camera, depth=depth, aligned=aligned,
        max_points=max_points, min_depth=min_depth, watertight=watertight, textured=textured, count=count, output=out,
        preview=preview, credentials=credentials, timeout=timeout or None, exposure=exposure, gpio=gpio, truth=truth,
        imu=imu, pipeline=pipeline,
    )  # fmt: skip
    newest = Progress()
    sets = f"of {count} sets" if count else "sets"
    with contextlib.suppress(KeyboardInterrupt), progress_bar("Receiving", sets, count or None) as bar:

        def report(progress: Progress) -> None:
            # On a terminal there is a bar, otherwise one line per second.
            nonlocal newest
            newest = progress
            bar.update(progress.sets, progress.sets, note=f"newest {progress.timestamp}")
            if not bar.shown and progress.second_passed():
                typer.echo(progress.line(), err=True)

        newest = receive_all(options, report)
    typer.echo(newest.line(), err=True)
