"""Reads materials of OGRE scripts (``.material``), which models of Gazebo name: a diffuse colour and a texture.

As in Gazebo, they replace the materials of mesh files.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Final

from scenegate.robots.errors import RobotFileError
from scenegate.robots.files import RobotFiles
from scenegate.robots.link_model import LinkMaterial
from scenegate.robots.xml_text import finite_numbers

_MAX_SCRIPTS: Final = 100
"""Maximum number of scripts that are read in one folder."""
_COMMENT: Final = re.compile(r"//[^\n]*")
_MATERIAL: Final = re.compile(r'^[ \t]*material[ \t]+"?([^\s":{]+)', re.MULTILINE)
_DIFFUSE: Final = re.compile(r"^[ \t]*diffuse[ \t]+([^\n]+)", re.MULTILINE)
_TEXTURE: Final = re.compile(r"^[ \t]*texture[ \t]+(\S+)", re.MULTILINE)


class MaterialScripts:
    """Finds materials in the scripts of models. Each script is read once."""

    def __init__(self, files: RobotFiles) -> None:
        self._files = files
        self._texts: dict[Path, str] = {}
        """Scripts that were read; empty for one that cannot be read."""

    def material(self, name: str, uris: list[str]) -> LinkMaterial | None:
        """Return a material; None if no script defines it.

        Args:
            name: Name of the material in its script.
            uris: Scripts, folders with scripts, and folders with textures.
        """
        folders = [path for uri in uris if (path := self._files.find_path(uri)) is not None]
        for path in folders:
            for script in sorted(path.glob("*.material"))[:_MAX_SCRIPTS] if path.is_dir() else [path]:
                definition = _definition(self._text(script), name)
                if definition is not None:
                    return _read(definition, [script.parent, script.parent.parent / "textures", *folders])
        return None

    def _text(self, script: Path) -> str:
        if script not in self._texts:
            try:
                text = self._files.read(script).decode("utf-8", "replace")
            except (OSError, RobotFileError):
                text = ""
            self._texts[script] = _COMMENT.sub("", text)
        return self._texts[script]


def _definition(text: str, name: str) -> str | None:
    """Return the text from a material's name to the next material; None if the script does not define it."""
    starts = [*_MATERIAL.finditer(text)]
    ends = [*(start.start() for start in starts[1:]), len(text)]
    return next((text[start.end() : end] for start, end in zip(starts, ends, strict=True) if start[1] == name), None)


def _read(definition: str, folders: list[Path]) -> LinkMaterial:
    """Return the first colour and texture of a definition: those of its first technique and pass.

    Args:
        folders: Folders that may contain the texture.
    """
    diffuse, texture = _DIFFUSE.search(definition), _TEXTURE.search(definition)
    color = finite_numbers(diffuse[1]) if diffuse is not None else ()
    r, g, b, a = (*color, 1.0)[:4] if len(color) in (3, 4) else (1.0, 1.0, 1.0, 1.0)  # OGRE's default
    if texture is None:
        return LinkMaterial((r, g, b, a), None, overrides=True)
    paths = [str(path) for folder in folders if (path := folder / texture[1]).is_file()]
    return LinkMaterial((r, g, b, a), [*paths, texture[1]][0], overrides=True)
