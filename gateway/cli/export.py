"""``scenegate export``: a scene in one file, from a running gateway or from an LCM log."""

from __future__ import annotations

import asyncio
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Final

import msgspec
import typer

from gateway.cli.log_files import MeshRoot, open_log_file, print_warnings
from scenegate.cli.output import print_note

if TYPE_CHECKING:
    from gateway.scene.tree.timeline import Timeline

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
            help="The page with scene and motion, which a browser opens without a network; or glTF of a moment.",
        ),
    ],
    start: Annotated[
        float | None,
        typer.Option(
            min=0.0,
            max=1e9,
            metavar="SECONDS",
            help="Start of the motion after the start of the log; of OUT.glb, the moment. Default: the start; the end.",
        ),
    ] = None,
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
    """Write a scene into one file: with its motion as a page, or at one moment as glTF."""
    from gateway.datasets.files import write_atomically
    from scenegate.credentials import Credentials
    from scenegate.gateway_http import fetch

    if out.is_dir():
        raise ValueError(f"{out} is a folder; the file needs a name in it")
    if out.suffix.lower() not in SUFFIXES:
        raise ValueError(f"{out}: the file must end with {' or '.join(SUFFIXES)}")
    is_gltf = out.suffix.lower() == ".glb"
    if is_gltf and duration is not None:
        raise ValueError(f"--duration is for OUT.html: {out} has one moment, of a log that of --start")
    if source.startswith(("http://", "https://")):
        if start is not None:
            raise ValueError("--start is for logs: of a gateway, --duration has the last seconds")
        credentials = Credentials(token or None)
        if is_gltf:
            data = fetch(source, "scene.glb", credentials, "scene.glb")
        else:
            data = fetch(source, "view/scene.html", credentials, "view/scene.html", seconds=duration, rate=rate)
    elif Path(source).is_dir():
        raise ValueError(f"{source} is a folder, not a log")
    elif not Path(source).is_file():
        raise ValueError(f"{source}: there is no such log; the address of a gateway begins with http://")
    elif is_gltf:
        data = asyncio.run(_moment_of_log(Path(source), start, mesh_root))
    else:
        data = asyncio.run(_section_of_log(Path(source), start or 0.0, duration, rate, mesh_root))
    write_atomically(out, data)
    print_warnings(out, _warnings(data) if is_gltf else ())
    print_note(f"{out}: {len(data) / 1e6:.1f} MB")


async def _moment_of_log(log: Path, start: float | None, mesh_root: str) -> bytes:
    """Return the state of a log at a moment as glTF."""
    from gateway.files.gltf.export import export_glb

    with open_log_file(log, mesh_root) as timeline:
        time = timeline.span[1] if start is None else _time_in(log, timeline, start)
        snapshot = await timeline.snapshot_at(time)
    print_warnings(log, timeline.incomplete.listed())
    return export_glb(snapshot.root)


async def _section_of_log(log: Path, start: float, duration: float | None, rate: float, mesh_root: str) -> bytes:
    """Return the page with a section of a log."""
    from gateway.replay.page_file import scene_html
    from gateway.replay.page_recorder import PageRecorder, record_section
    from gateway.scene.page.live_page import LivePage
    from scenegate.cli.progress_bar import progress_bar

    recorder = PageRecorder(LivePage())
    with open_log_file(log, mesh_root) as timeline, progress_bar("Exporting", "%", 1.0) as bar:
        first, end = _time_in(log, timeline, start), timeline.span[1]
        last = end if duration is None else min(end, first + int(duration * 1e9))
        data = await record_section(
            recorder, timeline, first, last, rate, asyncio.to_thread, lambda done: bar.update(done, round(100 * done))
        )
    print_warnings(log, timeline.incomplete.listed())
    return scene_html(data)


def _time_in(log: Path, timeline: Timeline, start: float) -> int:
    """Return the time ``start`` seconds after the start of a log, nanoseconds. Raises ValueError if it has ended."""
    begin, end = timeline.span
    if (time := begin + int(start * 1e9)) > end:
        raise ValueError(f"{log}: --start {start:g} is after its end, at {(end - begin) / 1e9:.1f} s")
    return time


def _warnings(glb: bytes) -> list[str]:
    """Return the sentences about what a glTF file does not have."""
    end = 20 + int.from_bytes(glb[12:16], "little")
    extras = msgspec.json.decode(glb[20:end]).get("asset", {}).get("extras", {})
    return [str(sentence) for sentence in extras.get("warnings", ())]
