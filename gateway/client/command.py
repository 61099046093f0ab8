"""``scenegate stream``: receives the image sets of a stereo camera, ours or a real rc_visard."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import Annotated

import typer

_File = Path | None


def stream(
    target: Annotated[str, typer.Argument(metavar="HOST:PORT", help="The camera; port 50051 when it has none.")],
    left: Annotated[bool, typer.Option("--left", help="Left image.")] = False,
    right: Annotated[bool, typer.Option("--right", help="Right image.")] = False,
    disparity: Annotated[bool, typer.Option("--disparity", help="Disparity image.")] = False,
    error: Annotated[bool, typer.Option("--error", help="Disparity error image.")] = False,
    confidence: Annotated[bool, typer.Option("--confidence", help="Confidence image.")] = False,
    mesh: Annotated[bool, typer.Option("--mesh", help="Mesh, as PLY.")] = False,
    color: Annotated[bool, typer.Option("--color", help="Left and right in colour.")] = False,
    max_points: Annotated[int, typer.Option(min=0, help="Points of a mesh: 0 no limit, else at least 1000.")] = 0,
    min_depth: Annotated[
        bool, typer.Option("--min-depth", help="Binned meshes take the nearest point of a bin instead of the mean.")
    ] = False,
    watertight: Annotated[bool, typer.Option("--watertight", help="Mesh without holes.")] = False,
    textured: Annotated[bool, typer.Option("--textured", help="Mesh with colours.")] = False,
    out: Annotated[
        Path | None,
        typer.Option("-o", "--out", metavar="FOLDER", help="Keep PNG, PLY, npz and parameter files for cvkit there."),
    ] = None,
    exposure: Annotated[
        bool, typer.Option("--exposure", help="With -o: keep exposure time, gain, noise and brightness of each image.")
    ] = False,
    gpio: Annotated[
        bool, typer.Option("--gpio", help="With -o: keep the GPIOs of each image, their bits in the file names, too.")
    ] = False,
    truth: Annotated[
        str | None,
        typer.Option(
            metavar="URL",
            help="With -o: keep exact depth and labels of each set from this gateway's HTTP port, http://HOST:PORT.",
        ),
    ] = None,
    pipeline: Annotated[int, typer.Option(min=0, help="Camera of --truth, where there are several.")] = 0,
    preview: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Picture of the newest set, all images side by side, disparity in colour."),
    ] = None,
    count: Annotated[int, typer.Option(min=0, help="End after so many sets; 0: when interrupted.")] = 0,
    timeout: Annotated[float, typer.Option(min=0.0, help="End with an error after so many seconds; 0: never.")] = 0.0,
    token: Annotated[
        str | None,
        typer.Option(envvar="SCENEGATE_TOKEN", help="Bearer token; other users of this machine see command lines."),
    ] = None,
    token_file: Annotated[_File, typer.Option(metavar="FILE", exists=True, help="File with the token.")] = None,
    tls: Annotated[bool, typer.Option("--tls", help="Encrypt, trusting the system's authorities.")] = False,
    ca: Annotated[
        _File,
        typer.Option(metavar="FILE", exists=True, envvar="SCENEGATE_CA", help="Encrypt, trusting this PEM authority."),
    ] = None,
    certificate: Annotated[_File, typer.Option(metavar="FILE", exists=True, help="PEM certificate to show.")] = None,
    key: Annotated[_File, typer.Option(metavar="FILE", exists=True, help="PEM private key of --certificate.")] = None,
) -> None:
    """Receive image sets of a stereo camera, this one or a real rc_visard: left and disparity if nothing is chosen."""
    from gateway.client.channel import Credentials, read_token
    from gateway.client.stream import Progress, StreamOptions, receive_all

    if out is None and (exposure or gpio or truth is not None):
        raise typer.BadParameter("--exposure, --gpio and --truth say what to keep; they need a folder, -o FOLDER")
    if token_file is not None:
        token = read_token(token_file)
    credentials = Credentials(token, tls, ca, certificate, key)
    options = StreamOptions(
        target, left, right, disparity, error, confidence, mesh, color, max_points, min_depth, watertight, textured,
        count, out, preview, credentials, timeout or None, exposure, gpio, truth, pipeline,
    )  # fmt: skip
    on_screen = sys.stderr.isatty()

    def report(progress: Progress) -> None:
        # One line that renews itself for people, a line a second in a log.
        if on_screen:
            typer.echo(f"\r\x1b[K{progress.line()}", nl=False, err=True)
        elif progress.second_passed():
            typer.echo(progress.line(), err=True)

    try:
        progress = receive_all(options, report)
    except KeyboardInterrupt:
        typer.echo(err=True)
        raise typer.Exit(0) from None
    typer.echo(f"{chr(13) if on_screen else ''}{progress.line()}", err=True)
