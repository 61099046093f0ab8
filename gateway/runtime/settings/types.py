"""Types of settings' values, and how they are parsed from text."""

import os
import re
from collections.abc import Callable
from importlib import import_module
from pathlib import Path
from typing import Annotated, Final, Literal
from urllib.parse import unquote

from pydantic import AfterValidator, BeforeValidator, Field
from pydantic_settings import NoDecode

from renderers.stereo.light.levels import LightLevels, parse_light_levels
from renderers.stereo.realism import RealismPart, parse_realism
from scenegate.lcm.url import check_lcm_url

_ROOT_PATH: Final = re.compile(r"(/[^/\s?#]+)+")
_ORIGIN: Final = re.compile(r"\*|[A-Za-z][A-Za-z0-9+.-]*:(//[^\s;,'\"/?#]+)?")

InterfaceName = Literal["render", "scene", "treeviewer", "stereo", "view"]


def _from_text(parse: Callable[[str], object]) -> BeforeValidator:
    """Return a validator that parses texts, and leaves other values."""
    return BeforeValidator(lambda value: parse(value) if isinstance(value, str) else value)


def _split(separator: str) -> BeforeValidator:
    return _from_text(lambda text: [part for part in text.split(separator) if part])


def _parsed_by(function: str) -> AfterValidator:
    """Return a check by a function of ``gateway.scene.draw.mount``. It imports NumPy: only for a setting in use."""

    def check(text: str) -> str:
        getattr(import_module("gateway.scene.draw.mount"), function)(text)
        return text

    return AfterValidator(check)


def _parse_color(text: str) -> list[str]:
    """Split R,G,B; check it here, so that there is one error for the value and not one for each number."""
    parts = [part.strip() for part in text.split(",")]
    if len(parts) != 3 or not all(part.isascii() and part.isdigit() and int(part) <= 255 for part in parts):
        raise ValueError("must be R,G,B: three whole numbers of 0 to 255")
    return parts


def _check_xacro_args(texts: tuple[str, ...]) -> tuple[str, ...]:
    from scenegate.robots.xacro_args import parse_xacro_args

    try:
        parse_xacro_args(texts)
    except ValueError as error:
        raise ValueError(str(error).removeprefix("--xacro-arg ")) from None
    return texts


def _check_root_path(path: str) -> str:
    path = path.rstrip("/")
    if path and not _ROOT_PATH.fullmatch(path):
        raise ValueError("must be a path such as /user/ann/scenegate")
    return unquote(path)


def _check_frame_origin(origin: str) -> str:
    if not _ORIGIN.fullmatch(origin):
        raise ValueError("must be '*', an origin such as http://localhost:8888, or a scheme such as vscode-webview:")
    return origin


LcmUrl = Annotated[str, AfterValidator(check_lcm_url)]
Byte = Annotated[int, Field(ge=0, le=255)]
Port = Annotated[int, Field(ge=0, le=65535)]
ProcessCount = Annotated[int, BeforeValidator(lambda value: 0 if value == "auto" else value)]
PortOrOff = Annotated[Port | None, BeforeValidator(lambda value: None if value == "off" else value)]
MountPose = Annotated[str, _parsed_by("parse_mount_pose")]
MountPath = Annotated[str, _parsed_by("parse_mount_path")]
AnyCamera = Annotated[str, _parsed_by("parse_mounted_camera")]
Cameras = Annotated[tuple[AnyCamera, ...], NoDecode, _split("|"), Field(max_length=15)]
XacroArguments = Annotated[tuple[str, ...], NoDecode, _split("|"), AfterValidator(_check_xacro_args)]
Paths = Annotated[tuple[Path, ...], NoDecode, _split(os.pathsep)]
Color = Annotated[tuple[Byte, Byte, Byte], NoDecode, _from_text(_parse_color)]
Realism = Annotated[tuple[RealismPart, ...], NoDecode, _from_text(parse_realism)]
LightLevel = Annotated[LightLevels, NoDecode, _from_text(parse_light_levels)]
Names = Annotated[tuple[str, ...], NoDecode, _split(",")]
FrameOrigins = Annotated[tuple[Annotated[str, AfterValidator(_check_frame_origin)], ...], NoDecode, _split(",")]
RootPath = Annotated[str, AfterValidator(_check_root_path)]
Samples = Annotated[Literal[1, 4, 8], _from_text(lambda text: int(text) if text.isascii() and text.isdigit() else text)]
Interfaces = Annotated[tuple[InterfaceName, ...], NoDecode, _split(",")]
