"""Reads materials of OGRE scripts (``.material``), which models of Gazebo name: a diffuse colour and a texture.

As in Gazebo, they replace the materials of mesh files. https://ogrecave.github.io/ogre/api/latest/_scripts.html
"""

from __future__ import annotations

import os
import re
from collections import ChainMap
from collections.abc import Mapping
from contextlib import suppress
from dataclasses import dataclass
from pathlib import Path
from typing import Final

from scenegate.robots.errors import RobotFileError
from scenegate.robots.files import RobotFiles
from scenegate.robots.link_model import LinkMaterial
from scenegate.robots.xml_text import finite_numbers

_MAX_SCRIPTS: Final = 100
"""Maximum number of scripts that are read in one folder."""
_MAX_SCRIPT_BYTES: Final = 4 << 20
"""Maximum size of a script: Gazebo's own has 0.1 MB. Each material costs about 300 bytes."""
_MAX_PARENTS: Final = 20
"""Maximum number of materials that inherit from each other."""
_DEFAULT: Final = (1.0, 1.0, 1.0, 1.0)
"""Diffuse colour of OGRE."""
_COMMENT: Final = re.compile(r'(?<![^\s{}:"])(?:("[^"\n]*")|//[^\n]*|/\*.*?(?:\*/|\Z))', re.DOTALL)
"""A comment, which starts where a word may start; or a quoted text, group 1, which may contain the start of one."""
_STATEMENT: Final = re.compile(
    r"(?:^|[{}])[ \t]*(?:abstract[ \t]+)?(material|diffuse|texture)[ \t]+([^\n{}]*)", re.MULTILINE
)
_NAMES: Final = re.compile(r'("[^"]+"|[^\s:"]+)\s*(?::\s*("[^"]+"|[^\s:"]+))?')
"""Name of a material, and of its parent if it has one."""
_TEXTURE: Final = re.compile(r'"[^"]+"|\S+')


@dataclass(slots=True)
class _Material:
    """A material of a script, without what it inherits."""

    script: Path
    parent: str
    """Name of the material that it inherits from; empty: none."""
    rgba: tuple[float, float, float, float] | None = None
    texture: str | None = None


class MaterialScripts:
    """Finds materials in the scripts of models. Each script is read once."""

    def __init__(self, files: RobotFiles) -> None:
        self._files = files
        self._materials: dict[Path, dict[str, _Material]] = {}
        """Materials by name, of scripts and of folders with scripts; none of a script that cannot be read."""

    def material(self, name: str, uris: list[str]) -> LinkMaterial | None:
        """Return a material; None if no script defines it, or it has nothing but a parent that none defines.

        Args:
            name: Name of the material in its script.
            uris: Scripts, folders with scripts, and folders with textures.
        """
        paths = [path for uri in uris if (path := self._files.find_path(uri)) is not None]
        lineage = _with_parents(name, ChainMap(*map(self._materials_of, paths)))
        colors = [each.rgba for each in lineage if each.rgba is not None]
        textures = [(each.texture, each.script.parent) for each in lineage if each.texture is not None]
        if not lineage or (lineage[-1].parent and not colors and not textures):
            return None
        rgba = [*colors, _DEFAULT][0]
        if not textures:
            return LinkMaterial(rgba, None, overrides=True)
        texture, folder = textures[0]
        candidates = (str(each / texture) for each in (folder, folder.parent / "textures", *paths))
        return LinkMaterial(rgba, next(filter(os.path.isfile, candidates), texture), overrides=True)

    def _materials_of(self, path: Path) -> dict[str, _Material]:
        """Return the materials of a script, or of the scripts in a folder; of those with one name, the first."""
        if path not in self._materials:
            materials: dict[str, _Material] = {}
            if path.is_dir():
                scripts = sorted(path.glob("*.material"))[:_MAX_SCRIPTS]
                for script in filter(os.path.isfile, reversed(scripts)):
                    materials.update(self._materials_of(script))
            else:
                with suppress(OSError, RobotFileError):
                    text = self._files.read(path, _MAX_SCRIPT_BYTES).decode("utf-8", "replace")
                    materials = _parse(text.replace("\r", "\n"), path)
            self._materials[path] = materials
        return self._materials[path]


def _with_parents(name: str, materials: Mapping[str, _Material]) -> list[_Material]:
    """Return a material, its parent, the parent's parent and so on. A circle ends at the maximum number."""
    lineage: list[_Material] = []
    while name in materials and len(lineage) <= _MAX_PARENTS:
        lineage.append(materials[name])
        name = lineage[-1].parent
    return lineage


def _parse(text: str, script: Path) -> dict[str, _Material]:
    """Return the materials of a script, each with its first colour and texture: those of its first technique and pass.

    Colours are clamped to 0 to 1. Those that are not 3 or 4 finite numbers are ignored.
    """
    materials: dict[str, _Material] = {}
    material = _Material(script, "")  # takes what is before the first material
    for statement in _STATEMENT.finditer(_COMMENT.sub(r"\1", text)):
        keyword, value = statement.groups()
        if keyword == "material":
            if (names := _NAMES.match(value)) is not None:
                material = _Material(script, (names[2] or "").strip('"'))
                materials.setdefault(names[1].strip('"'), material)
        elif keyword == "texture":
            if material.texture is None and (texture := _TEXTURE.match(value)) is not None:
                material.texture = texture[0].strip('"')
        elif material.rgba is None and len(color := finite_numbers(value)) in (3, 4):
            r, g, b, a = (min(max(number, 0.0), 1.0) for number in (*color, 1.0)[:4])
            material.rgba = (r, g, b, a)
    return materials
