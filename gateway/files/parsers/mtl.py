"""Reads MTL files: colours, opacity and textures of the materials of OBJ files."""

import contextlib
import math
import re
from typing import Final

import numpy as np

from gateway.files.parsers.mesh_data import Shape, as_utf8, srgb_bytes
from gateway.files.parsers.texture_files import ReadFile, TextureFiles

_BETWEEN_LIBRARIES: Final = re.compile(r"(?<=\.mtl)\s+", re.IGNORECASE)
"""Blanks between the names of MTL files in a statement; a name may have blanks, too."""
_TEXTURE_OPTION: Final = re.compile(r"-[a-zA-Z]+(?:\s+(?:on|off|[rgbmlz]|[-+.\deE]+))+\s+")
"""Option before a texture's name in an MTL file, such as ``-clamp on`` and ``-s 1 1 1``."""
_WITHOUT_EFFECT: Final = frozenset({"-blendu", "-blendv", "-bm", "-boost", "-texres"})
"""Options of filters, and of other textures than colours."""
Statements = dict[str, str]
"""Statements of a material in an MTL file by keyword, in lower case."""


def read_materials(libraries: list[str], read_file: ReadFile) -> tuple[dict[str, Statements], list[str]]:
    """Return the statements of each material in the MTL files, and the folders of these files."""
    materials: dict[str, Statements] = {}
    folders: list[str] = []
    for name in dict.fromkeys(name for line in libraries for name in _BETWEEN_LIBRARIES.split(line)):
        try:
            text = as_utf8(read_file(name)).decode("utf-8", "replace").removeprefix("\ufeff")
        except OSError:
            continue
        folders.append(name[: max(name.rfind("/"), name.rfind("\\")) + 1])
        material: Statements = {}
        for line in text.splitlines():
            keyword, _, value = line.replace("\t", " ").strip().partition(" ")
            keyword = keyword.lower()
            if not keyword.startswith("map"):
                value = value.partition(" #")[0]
            if keyword == "newmtl":
                material = materials[" ".join(value.split())] = {}
            else:
                material[keyword] = value.strip()
    return materials, folders


def set_material(
    shape: Shape, material: Statements, folders: list[str], textures: TextureFiles, warnings: list[str]
) -> None:
    """Set the colours and the texture of a shape, whose texture coordinates are kept without a texture, too."""
    map_kd = material.get("map_kd", "")
    image = textures.index(_texture_name(map_kd), folders) if map_kd else None
    color = _color(material, "kd") or (1.0, 1.0, 1.0)
    if image is not None and shape.uv is not None:
        shape.image, shape.colors = image, None
        _place_texture(shape, map_kd, warnings)
        if not any(color):  # a black one would hide the texture
            color = (1.0, 1.0, 1.0)
    elif shape.colors is not None:
        own = bytes((*srgb_bytes(np.array(color)).tolist(), 255))
        if shape.colors == own * (len(shape.colors) // len(own)):  # written twice, for readers of either
            shape.colors = None
    map_d = _texture_name(material.get("map_d", ""))
    if map_d and (shape.image is None or map_d != _texture_name(map_kd)):  # the alpha of map_Kd is drawn
        warnings.append(f"map_d {map_d[:60]!r} is ignored, as only the alpha of map_Kd is read")
    shape.color = (*color, _opacity(material))
    shape.emission = _color(material, "ke") or (0.0, 0.0, 0.0)


def _color(material: Statements, keyword: str) -> tuple[float, float, float] | None:
    """Return an sRGB colour within 0 .. 1, of which one number is a grey; None without."""
    with contextlib.suppress(ValueError):
        match [min(max(0.0, float(word)), 1.0) for word in material.get(keyword, "").split()]:  # NaN: 0
            case [red, green, blue, *_]:
                return red, green, blue
            case [grey]:
                return grey, grey, grey
    return None


def _opacity(material: Statements) -> float:
    """Return the opacity of a material: its ``d``, or 1 - ``Tr``. The default is 1."""
    for keyword in ("d", "tr"):
        with contextlib.suppress(ValueError):
            value = float(material.get(keyword, "").rpartition(" ")[2])
            if math.isfinite(value):
                return value if keyword == "d" else 1.0 - value
    return 1.0


def _texture_name(statement: str) -> str:
    """Return the file name in a statement of an MTL file, without the options before it."""
    name = _TEXTURE_OPTION.sub("", statement) if statement.startswith("-") else statement
    return name[1:-1] if name[:1] == name[-1:] == '"' else name


def _place_texture(shape: Shape, statement: str, warnings: list[str]) -> None:
    """Scale texture coordinates by ``-s`` and move them by ``-o``; others that matter are a warning."""
    assert shape.uv is not None
    scale, offset = np.ones(2, np.float32), np.zeros(2, np.float32)
    ignored: list[str] = []
    for option in _TEXTURE_OPTION.findall(statement) if statement.startswith("-") else ():
        name, *values = option.split()
        if name in ("-s", "-o"):
            with contextlib.suppress(ValueError):
                numbers = np.array(values[:2], np.float32)
                (scale if name == "-s" else offset)[: len(numbers)] = numbers
        elif name not in _WITHOUT_EFFECT and values != ["off"]:
            ignored.append(option.strip())
    uv = np.frombuffer(shape.uv, np.float32).reshape(-1, 2) * (1, -1) + (0, 1)  # (0, 0) is bottom left here
    uv = uv * scale + offset
    shape.uv = (uv * (1, -1) + (0, 1)).astype(np.float32).tobytes()
    if ignored != ["-clamp on"] or uv.min() < 0.0 or uv.max() > 1.0:
        warnings += [f"the option {option!r} of map_Kd is ignored" for option in ignored]
