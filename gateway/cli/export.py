"""``scenegate export``: a scene with its motion in one file, from a running gateway or from an LCM log."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import Annotated, Final

import msgspec
import typer

from gateway.cli.log_files import MeshRoot, open_log_file, print_warnings

SUFFIXES: Final = (".html", ".glb")
"""Suffixes of the files that can be written."""


def export(
    source: Annotated[
        str,
        typer.Argument(
            metavar="LOG|URL",
            help="LCM log of tree viewer clients or of Drake; or the address of a running gateway: "
            "http://127.0.0.1:8000.",
        ),
    ],
    out: Annotated[
        Path,
        typer.Argument(
            metavar="OUT.html|OUT.glb",
            help="The page with the scene, which a browser opens without a network; or glTF with an animation.",
        ),
    ],
    start: Annotated[
        float, typer.Option(min=0.0, max=1e9, metavar="SECONDS", help="Start of the motion after the start of the log.")
    ] = 0.0,
    duration: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=1e9,
            metavar="SECONDS",
            help="Length of the motion; of a gateway, its last seconds. 0: no motion. Default: all there is.",
        ),
    ] = None,
    rate: Annotated[float, typer.Option(min=0.01, max=240.0, help="Samples of the scene per second.")] = 30.0,
    mesh_root: MeshRoot = "auto",
    token: Annotated[str | None, typer.Option(envvar="SCENEGATE_TOKEN", help="Bearer token of the gateway.")] = None,
) -> None:
    """Write a scene and its motion into one file."""
    from gateway.datasets.files import write_atomically
    from scenegate.credentials import Credentials
    from scenegate.gateway_http import fetch

    if out.is_dir():
        raise ValueError(f"{out} is a folder; the file needs a name in it")
    if out.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{out}: the file must end with {' or '.join(SUFFIXES)}")
    is_gltf = out.suffix.lower() == ".glb"
    if source.startswith(("http://", "https://")):
        if start:
            raise ValueError("--start is for logs: of a gateway, --duration has the last seconds")
        name = "scene/motion.glb" if is_gltf else "view/scene.html"
        data = fetch(source, name, Credentials(token or None), name, seconds=duration, rate=rate)
    elif Path(source).is_dir():
        raise ValueError(f"{source} is a folder, not a log")
    elif not Path(source).is_file():
        raise ValueError(f"{source}: there is no such log; the address of a gateway begins with http://")
    else:
        data = asyncio.run(_export_log(Path(source), start, duration, rate, mesh_root, is_gltf=is_gltf))
    write_atomically(out, data)
    print_warnings(out, _warnings(data) if is_gltf else ())
    typer.echo(f"{out}: {len(data) / 1e6:.1f} MB", err=True)


async def _export_log(
    log: Path, start: float, duration: float | None, rate: float, mesh_root: str, *, is_gltf: bool
) -> bytes:
    """Return the file of a section of a log. What the file does not have is named on stderr."""
    from gateway.adapters.viewer.scene_file import SceneFileWriter
    from gateway.files.gltf.export import MotionWriter
    from gateway.scene.page.live_page import LivePage
    from gateway.scene.tree.sampling import write_section
    from scenegate.cli.progress_bar import progress_bar

    writer = MotionWriter() if is_gltf else SceneFileWriter(LivePage())
    with open_log_file(log, mesh_root) as timeline, progress_bar("Exporting", "%", 1.0) as bar:
        begin, end = timeline.span
        first = begin + int(start * 1e9)
        if first > end:
            raise ValueError(f"{log}: --start {start:g} is after its end, at {(end - begin) / 1e9:.1f} s")
        last = end if duration is None else min(end, first + int(duration * 1e9))
        data = await write_section(
            writer, timeline, first, last, rate, asyncio.to_thread, lambda done: bar.update(done, round(100 * done))
        )
    print_warnings(log, timeline.incomplete.listed())
    return data


def _warnings(glb: bytes) -> list[str]:
    """Return the sentences about what a glTF file does not have."""
    end = 20 + int.from_bytes(glb[12:16], "little")
    extras = msgspec.json.decode(glb[20:end]).get("asset", {}).get("extras", {})
    return [str(sentence) for sentence in extras.get("warnings", ())]
