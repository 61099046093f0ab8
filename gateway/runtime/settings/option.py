"""A setting as a pydantic field, and its flag, environment variable and value as text for help and reference."""

from pathlib import Path
from typing import Any, Literal, get_args, get_origin

from pydantic import Field
from pydantic.fields import FieldInfo

from gateway.runtime.settings.types import AnyCamera, Byte, Port

ENV_PREFIX = "SCENEGATE_"


def option(group: str, default: Any, text: str, *, flag: str | None = None, **limits: Any) -> Any:
    """Return a pydantic field with a heading for help and reference, a help text, and a second name of the flag.

    ``limits``: ``ge``, ``le``, ``gt``, ``pattern`` as in ``pydantic.Field``.
    """
    return Field(default, description=text, json_schema_extra={"group": group, "flag": flag or ""}, **limits)


def flag_of(name: str) -> str:
    """Return the flag of a setting."""
    return "--" + name.replace("_", "-")


def second_flag_of(field: FieldInfo) -> str | None:
    """Return the second flag of a setting, if any."""
    return _extra(field, "flag") or None


def env_of(name: str) -> str:
    """Return the environment variable of a setting."""
    return ENV_PREFIX + name.upper()


def group_of(field: FieldInfo) -> str:
    """Return the heading under which a setting is listed."""
    return _extra(field, "group")


def _extra(field: FieldInfo, name: str) -> str:
    assert isinstance(field.json_schema_extra, dict)
    return str(field.json_schema_extra[name])


def default_of(default: Any) -> str:
    """Return a default value as text; empty for none."""
    if isinstance(default, bool):
        return "on" if default else "off"
    if default is None or default == () or default == "":
        return ""
    if isinstance(default, tuple):
        return ",".join(map(str, default))
    return f"{default:g}" if isinstance(default, float) else str(default)


def metavar_of(field: FieldInfo) -> str:
    """Return the placeholder of a value: its choices, or a word such as NUMBER."""
    annotation: Any = field.annotation
    arguments = [part for part in get_args(annotation) if part is not type(None)]
    if len(arguments) == 1 and get_origin(arguments[0]) is Literal:  # or None
        annotation, arguments = arguments[0], list(get_args(arguments[0]))
    if get_origin(annotation) is Literal:
        return "|".join(map(str, arguments))
    words = {bool: "on|off", int: "NUMBER", float: "NUMBER", Path: "PATH", str: "TEXT"}
    if annotation in words:
        return words[annotation]
    if arguments == [Port]:  # PortOrOff
        return "NUMBER|off"
    if get_origin(annotation) is tuple:
        return {Path: "PATHS", Byte: "R,G,B", AnyCamera: "CAMERAS"}.get(arguments[0], "NAMES")
    return words.get(arguments[0], "TEXT") if arguments else "TEXT"
