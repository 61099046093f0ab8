"""What kinds of values settings have, how they are read from text, and how they are called and described for people."""

from __future__ import annotations

import os
from pathlib import Path
from typing import Annotated, Any, Literal, get_args, get_origin

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic.fields import FieldInfo
from pydantic_settings import NoDecode

ENV_PREFIX = "SCENEGATE_"
CONFIG_ENV = "SCENEGATE_CONFIG"
OTHER_ENV = frozenset(
    {
        CONFIG_ENV,
        "SCENEGATE_ASSET_GENERATOR",
        "SCENEGATE_CA",
        "SCENEGATE_CACHE_DIR",
        "SCENEGATE_CORPUS",
        "SCENEGATE_DIRECTOR",
        "SCENEGATE_DRAKE_PYTHON",
        "SCENEGATE_FIDELITY",
        "SCENEGATE_RAY_PYTHON",
        "SCENEGATE_REGENERATE_PICTURES",
        "SCENEGATE_SCHEMATHESIS",
        "SCENEGATE_TOKEN",
        "SCENEGATE_URL",
    }
)
"""Variables of ours that are no settings."""

InterfaceName = Literal["render", "scene", "treeviewer", "stereo", "view"]


def _split(separator: str) -> BeforeValidator:
    def split(value: object) -> object:
        return [part for part in value.split(separator) if part] if isinstance(value, str) else value

    return BeforeValidator(split)


def _check_pose(text: str) -> str:
    from gateway.scene.mount import parse_mount_pose  # numpy, for those who set it only

    parse_mount_pose(text)
    return text


def _check_mount(text: str) -> str:
    return _check_path(text) if text.lstrip().startswith("[") else _check_pose(text)


def _check_path(text: str) -> str:
    from gateway.scene.mount import parse_mount_path

    parse_mount_path(text)
    return text


def _check_color(value: object) -> object:
    """One sentence for the whole value, instead of one for each of its parts."""
    if not isinstance(value, str):
        return value
    parts = [part.strip() for part in value.split(",")]
    if len(parts) != 3 or not all(part.isascii() and part.isdigit() and int(part) <= 255 for part in parts):
        raise ValueError("must be R,G,B: three whole numbers of 0 to 255")
    return parts


def _to_number(value: object) -> object:
    return int(value) if isinstance(value, str) and value.isascii() and value.isdigit() else value


Byte = Annotated[int, Field(ge=0, le=255)]
Port = Annotated[int, Field(ge=0, le=65535)]
PortOrOff = Annotated[Port | None, BeforeValidator(lambda value: None if value == "off" else value)]
MountPose = Annotated[str, AfterValidator(_check_pose)]
MountPath = Annotated[str, AfterValidator(_check_path)]
AnyMount = Annotated[str, AfterValidator(_check_mount)]
Mounts = Annotated[tuple[AnyMount, ...], NoDecode, _split("|"), Field(max_length=15)]
Paths = Annotated[tuple[Path, ...], NoDecode, _split(os.pathsep)]
Color = Annotated[tuple[Byte, Byte, Byte], NoDecode, BeforeValidator(_check_color)]
Names = Annotated[tuple[str, ...], NoDecode, _split(",")]
Samples = Annotated[Literal[1, 4, 8], BeforeValidator(_to_number)]
Interfaces = Annotated[tuple[InterfaceName, ...], NoDecode, _split(",")]


def option(default: Any, group: str, text: str, *, flag: str | None = None, **limits: Any) -> Any:
    """A setting: ``text`` is what people read, ``flag`` a second name on the command line."""
    extra: dict[str, Any] = {"group": group}
    if flag is not None:
        extra["flag"] = flag
    return Field(default, description=text, json_schema_extra=extra, **limits)


def flag_of(name: str) -> str:
    """The flag of a setting."""
    return "--" + name.replace("_", "-")


def env_of(name: str) -> str:
    """The environment variable of a setting."""
    return ENV_PREFIX + name.upper()


def group_of(field: FieldInfo) -> str:
    """The heading under which a setting is listed."""
    extra = field.json_schema_extra
    return str(extra["group"]) if isinstance(extra, dict) else ""


def default_of(default: Any) -> str:
    """A default as people write it; empty when there is none."""
    if isinstance(default, bool):
        return "on" if default else "off"
    if default is None or default == () or default == "":
        return ""
    if isinstance(default, tuple):
        return ",".join(map(str, default))
    return f"{default:g}" if isinstance(default, float) else str(default)


def kind_of(field: FieldInfo) -> str:
    """What a value looks like, in a word or as the choices."""
    annotation: Any = field.annotation
    options = [part for part in get_args(annotation) if part is not type(None)]
    if get_origin(annotation) is Literal:
        return "|".join(map(str, options))
    kinds = {bool: "on|off", int: "NUMBER", float: "NUMBER", Path: "PATH", str: "TEXT"}
    if annotation in kinds:
        return kinds[annotation]
    if options == [Port]:  # the ports that may be missing
        return "NUMBER|off"
    if get_origin(annotation) is tuple:
        return {Path: "PATHS", Byte: "R,G,B", AnyMount: "POSES"}.get(options[0], "NAMES")
    return kinds.get(options[0], "TEXT") if options else "TEXT"
