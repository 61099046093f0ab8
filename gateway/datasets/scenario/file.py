"""Reads scenario files, and describes them to editors."""

import ast
import inspect
import re
import reprlib
import tomllib
from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path
from typing import Any, Final

import msgspec

from gateway.datasets.scenario import tables
from gateway.datasets.scenario.tables import MAX_OBJECTS, MAX_VIEWS, Fixed, Handheld, Scenario, ScenarioError
from scenegate.regular_files import errors_as, read_text

MAX_FILE_BYTES: Final = 1 << 20
"""Maximum size of a scenario file. A file with a table for each of a thousand models has 100 kB."""
_LOCATION: Final = re.compile(r" - at `\$\.?([^`]*)`$")
"""Path of a value at the end of a message of msgspec."""
_PATH_STEP: Final = re.compile(r"([^.\[\]]+)|\[(\d+)\]")
"""Step of such a path: a key, or the index of an array."""


def read_scenario(path: Path) -> Scenario:
    """Read a scenario file. Raises ScenarioError if it cannot be read, or a value is invalid."""
    with errors_as(ScenarioError, path, ValueError, RecursionError):  # ValueErrors: those of TOML and UTF-8, too
        content = tomllib.loads(read_text(path, MAX_FILE_BYTES))
        try:
            scenario = msgspec.convert(content, Scenario)
        except msgspec.ValidationError as error:
            raise ValueError(_key_first(str(error), content)) from None
        _check(scenario)
        return scenario


def _key_first(message: str, content: dict[str, Any]) -> str:
    """Return a message of msgspec with the key first and the value, or the values that are possible, last.

    Each message and its result::

        Expected `int`, got `str` - at `$.seed`
        seed: expected `int`, not 'x'
        Expected `int` >= 1 - at `$.scenes`
        scenes: expected `int` >= 1, not 0
        Invalid enum value 'x' - at `$.models[0].up`
        models[0].up: invalid enum value 'x': must be 'auto' or 'y' or 'z'
        Object missing required field `path` - at `$.models[0]`
        models[0]: object missing required field `path`
    """
    location = _LOCATION.search(message)
    if location is None:
        return message
    value: Any = content
    # msgspec writes [...] for a key of a mapping, such as a joint's name: the value is then the whole mapping.
    for name, index in _PATH_STEP.findall(location[1].partition("[...]")[0]):
        value = value[int(index)] if index else value.get(name)
    reason = message[: location.start()].partition(", got")[0]
    reason += _allowed(location[1]) if reason.startswith("Invalid") else ""
    value_part = "" if reason.startswith(("Invalid", "Object")) else f", not {reprlib.repr(value)}"
    return f"{location[1]}: {reason[:1].lower()}{reason[1:]}{value_part}"


def _allowed(path: str) -> str:
    """Return the values that a key with a fixed list of them may have, as ``: 'y' or 'z'``; empty if unknown."""
    (root,), definitions = msgspec.json.schema_components([Scenario])
    schemas = list(_alternatives(root, definitions))
    for name in (name for name, _ in _PATH_STEP.findall(path) if name):
        values_of_key = [each["properties"][name] for each in schemas if name in each.get("properties", {})]
        schemas = [each for value in values_of_key for each in _alternatives(value, definitions)]
    allowed = sorted(value for each in schemas for value in each.get("enum", []))
    return f": must be {' or '.join(map(repr, allowed))}" if allowed else ""


def _alternatives(schema: dict[str, Any], definitions: dict[str, Any]) -> Iterator[dict[str, Any]]:
    """Yield a JSON schema and all that a value, or an item of an array, can have in its place."""
    yield schema
    parts = [*schema.get("anyOf", ()), *schema.get("oneOf", ())]
    if "items" in schema:
        parts.append(schema["items"])
    if "$ref" in schema:
        parts.append(definitions[schema["$ref"].rpartition("/")[2]])
    for part in parts:
        yield from _alternatives(part, definitions)


def _check(scenario: Scenario) -> None:
    """Raise ValueError for values that contradict each other."""
    views = scenario.camera_count * (scenario.frame_count or 1)
    if not 1 <= views <= MAX_VIEWS:
        raise ValueError(f"cameras: {views} views of a scene; there must be 1 to {MAX_VIEWS}")
    counts = [model.count for model in (*scenario.models, *scenario.distractors)]
    objects = sum(max(count) if isinstance(count, tuple) else count for count in counts)
    if objects > MAX_OBJECTS:
        raise ValueError(f"models and distractors: count is up to {objects} together, {MAX_OBJECTS} are the most")
    if not scenario.surfaces:
        raise ValueError("surfaces: there must be one, such as [[surfaces]] with kind = 'floor'")
    names = {surface.name for surface in scenario.surfaces}
    for kind, models in (("models", scenario.models), ("distractors", scenario.distractors)):
        for index, model in enumerate(models):
            if model.on and model.on not in names:
                raise ValueError(f"{kind}[{index}].on: no surface has the name {model.on!r}")
            moving = model.animation is not None or model.joint_track or model.pose_track
            if moving and scenario.frames is None:
                raise ValueError(f"{kind}[{index}]: it moves, so [frames] must have the count of frames")
    for index, camera in enumerate(scenario.cameras):
        if isinstance(camera, Fixed) and camera.eye == camera.target:
            raise ValueError(f"cameras[{index}]: camera eye and target coincide at {list(camera.eye)}")
        if isinstance(camera, Handheld) and scenario.frames is None:
            raise ValueError(f"cameras[{index}]: a handheld camera moves, so [frames] must have the count of frames")


def schema_text() -> str:
    """Return the JSON schema of the file, for editors. Its descriptions are the docstrings of tables and fields."""
    content = msgspec.json.schema(Scenario)
    docstrings = _field_docstrings()
    for name, definition in content["$defs"].items():
        for table in reversed(getattr(tables, name).__mro__):
            for key, text in docstrings.get(table.__name__, {}).items():
                definition["properties"][key]["description"] = text
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "Scenegate scenario", **content}
    return msgspec.json.format(msgspec.json.encode(schema), indent=1).decode() + "\n"


def _field_docstrings() -> dict[str, dict[str, str]]:
    """Return the docstrings of fields by table and field, from the source: objects do not have them."""
    classes = [each for each in ast.parse(inspect.getsource(tables)).body if isinstance(each, ast.ClassDef)]
    return {
        table.name: {
            field.target.id: " ".join(str(docstring.value.value).replace("``", "`").split())
            for field, docstring in pairwise(table.body)
            if isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(docstring, ast.Expr)
            and isinstance(docstring.value, ast.Constant)
        }
        for table in classes
    }
