"""``scenegate export``: the scene of a running gateway with its motion in one file."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Final

import typer

SUFFIXES: Final = (".html",)
"""Suffixes of the files that can be written."""


def export(
    source: Annotated[str, typer.Argument(metavar="URL", help="Address of a running gateway: http://127.0.0.1:8000.")],
    out: Annotated[
        Path,
        typer.Argument(metavar="OUT.html", help="The page with the scene, which a browser opens without a network."),
    ],
    duration: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            metavar="SECONDS",
            help="Length of the motion; of a gateway, the last seconds. 0: the scene as it is. Default: all there is.",
        ),
    ] = None,
    rate: Annotated[float, typer.Option(min=0.01, max=240.0, help="Samples of the scene per second.")] = 30.0,
    token: Annotated[
        str | None,
        typer.Option(envvar="SCENEGATE_TOKEN", help="Bearer token of the gateway."),
    ] = None,
) -> None:
    """Write a scene and its motion into one file."""
    from gateway.datasets.files import write_atomically
    from scenegate.tree.scene_file import fetch_scene_file

    if out.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{out}: the file must end with {' or '.join(SUFFIXES)}")
    data = fetch_scene_file(source, "view/scene.html", token=token, seconds=duration, rate=rate)
    write_atomically(out, data)
    typer.echo(f"{out}: {len(data) / 1e6:.1f} MB", err=True)
