"""Arguments of xacro: ``$(arg name)`` in a robot file, whose values the user gives."""

import re
from collections.abc import Iterable, Mapping
from typing import Final, TypeAlias

from scenegate.messages.arguments import describe
from scenegate.robots.robot_errors import RobotFileError
from scenegate.robots.xml_text import Element, attribute

XacroArgs: TypeAlias = Mapping[str, "str | float"]
"""Values by name. xacro reads numbers and booleans from their text."""

_ARG: Final = re.compile(r"\$\(arg ([^()$]+)\)")
_FIND: Final = re.compile(r"(?:file://)?\$\(find ([^()$]+)\)")


def parse_xacro_args(texts: Iterable[str]) -> dict[str, str]:
    """Return values by name of texts such as ``dof:=7``. Raises RobotFileError for others, or a name twice."""
    values: dict[str, str] = {}
    for text in texts:
        name, separator, value = text.partition(":=")
        if not separator or not name.strip():
            raise RobotFileError(f"--xacro-arg {text!r}: must be name:=value, such as dof:=7")
        if name.strip() in values:
            raise RobotFileError(f"--xacro-arg {text!r}: {name.strip()} has a value already")
        values[name.strip()] = value
    return values


def as_texts(args: XacroArgs) -> dict[str, str]:
    """Return the values as texts; raise RobotFileError unless ``args`` is a mapping from names to texts or numbers."""
    if not isinstance(args, Mapping) or not all(isinstance(each, (str, int, float)) for each in args.values()):
        raise RobotFileError(f"xacro_args must be a mapping such as {{'dof': 7}}, not {describe(args)}")
    return {str(name): str(value) for name, value in args.items()}


def missing_arg(name: str) -> str:
    """Return the sentence about an argument without a value."""
    return f"its argument {name[:60]!r} has no value, give one with --xacro-arg {name[:60]}:=VALUE"


def expand_args(root: Element, args: Mapping[str, str], used: set[str], warnings: list[str]) -> None:
    """Replace ``$(arg name)`` and ``$(find package)`` in a document without elements of xacro.

    Others than ``args`` are the defaults of elements ``<arg name default>``. Names of its arguments are added to
    ``used``.
    """
    values = {attribute(arg, "name"): attribute(arg, "default") for arg in root.iter("arg") if "default" in arg.attrib}
    values |= args
    missing: set[str] = set()

    def value_of(match: re.Match[str]) -> str:
        name = match[1].strip()
        used.add(name)
        if name not in values:
            missing.add(name)
        return values.get(name, match[0])

    def expanded(text: str) -> str:
        return _FIND.sub(lambda match: f"package://{match[1].strip()}", _ARG.sub(value_of, text))

    for element in root.iter():
        if element.text and "$(" in element.text:
            element.text = expanded(element.text)
        for name, text in element.items():
            if "$(" in text:
                element.set(name, expanded(text))
    warnings += [missing_arg(name) for name in sorted(missing)]


def warn_of_unused(args: Mapping[str, str], used: Iterable[str], warnings: list[str]) -> None:
    """Append a warning about each argument that a document does not use."""
    warnings += [f"it does not use --xacro-arg {name}" for name in args if name not in used]
