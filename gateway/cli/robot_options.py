"""Options of the commands that read robot files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Literal, TypeAlias

import typer

Joints: TypeAlias = Annotated[
    list[str] | None,
    typer.Option(
        "--joint",
        metavar="NAME=VALUE",
        help="Joint value of a robot file, in radians or metres; several numbers separated by commas for joints that "
        "have several. Can be repeated.",
    ),
]
Roots: TypeAlias = Annotated[
    list[Path] | None,
    typer.Option(
        "--root",
        metavar="FOLDER",
        exists=True,
        file_okay=False,
        help="Folder with the packages of a robot file's package:// names. Can be repeated.",
    ),
]
Keyframe: TypeAlias = Annotated[
    str, typer.Option(metavar="NAME", help="Keyframe of an MJCF file, which has the joints' values.")
]
GltfUp: TypeAlias = Annotated[
    Literal["y", "z", "auto"],
    typer.Option(
        "--robot-gltf-up",
        help="Up axis of the glTF meshes of a URDF or SDF file; auto: the one that fits the collision geometry.",
    ),
]
Strict: TypeAlias = Annotated[
    bool, typer.Option("--strict", help="Refuse a file of which something cannot be drawn, instead of a warning.")
]
