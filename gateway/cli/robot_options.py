"""Options of the commands that read robot files."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, TypeAlias

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
