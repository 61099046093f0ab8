"""Reads scenario files, and describes them to editors."""

from __future__ import annotations

import re
import reprlib
import tomllib
from pathlib import Path
from typing import Any, Final

import msgspec

from gateway.datasets.scenario.tables import MAX_OBJECTS, MAX_VIEWS, Fixed, Handheld, Scenario, ScenarioError
from scenegate.regular_files import errors_as, read_text

MAX_FILE_BYTES: Final = 1 << 20
"""Maximum size of a scenario file. A file with a table for each of a thousand models has 100 kB."""
_LOCATION: Final = re.compile(r" - at `\$\.?([^`]*)`$")
"""Path of a value at the end of a message of msgspec."""
_STEP: Final = re.compile(r"([^.\[\]]+)|\[(\d+)\]")


def read_scenario(path: Path) -> Scenario:
    """Read a scenario file.

    Raises:
        ScenarioError: it cannot be read, or a value is invalid.
    """
    with errors_as(ScenarioError, path, ValueError, RecursionError):  # ValueErrors: those of TOML and UTF-8, too
        content = tomllib.loads(read_text(path, MAX_FILE_BYTES))
        try:
            scenario = msgspec.convert(content, Scenario)
        except msgspec.ValidationError as error:
            raise ValueError(_sentence(str(error), content)) from None
        _check(scenario)
        return scenario


def _sentence(message: str, content: dict[str, Any]) -> str:
    """Return a message of msgspec with the key first and the value last."""
    location = _LOCATION.search(message)
    if location is None:
        return message
    value: Any = content
    for name, index in _STEP.findall(location[1].partition("[...]")[0]):  # the keys of joints are not in the path
        value = value[int(index)] if index else value.get(name)
    reason = message[: location.start()].partition(", got")[0]
    reason += _allowed(location[1]) if reason.startswith("Invalid") else ""
    shown = "" if reason.startswith(("Invalid", "Object")) else f", not {reprlib.repr(value)}"
    return f"{location[1]}: {reason[:1].lower()}{reason[1:]}{shown}"


def _allowed(path: str) -> str:
    """Return the values that a key with a fixed list of them may have, as ``: 'y' or 'z'``; empty if unknown."""
    values: list[str] = []
    (schema,), definitions = msgspec.json.schema_components([Scenario])
    schemas = [schema]
    for name in [*filter(None, (name for name, _ in _STEP.findall(path))), ""]:
        found: list[dict[str, Any]] = []
        while schemas:
            each = schemas.pop()
            schemas += each.get("anyOf", []) + each.get("oneOf", []) + ([each["items"]] if "items" in each else [])
            schemas += [definitions[each["$ref"].rpartition("/")[2]]] if "$ref" in each else []
            found.append(each)
        if name:
            schemas = [each["properties"][name] for each in found if name in each.get("properties", {})]
        else:
            values = [value for each in found for value in each.get("enum", [])]
    return f": must be {' or '.join(map(repr, sorted(values)))}" if values else ""


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
    """Return the JSON schema of the file, for editors."""
    content = msgspec.json.schema(Scenario)
    schema = {"$schema": "https://json-schema.org/draft/2020-12/schema", "title": "Scenegate scenario", **content}
    return msgspec.json.format(msgspec.json.encode(schema), indent=1).decode() + "\n"
