"""Parts of an OpenAPI description as text: types, tables of fields, example requests."""

import json
import shlex
from collections.abc import Iterator, Mapping
from typing import Any, Final
from urllib.parse import quote

URL: Final = "http://127.0.0.1:8000"
"""Address of the gateway in example requests."""
_MAX_EXTRA_PARAMETERS: Final = 3
"""Maximum number of optional query parameters in an example request: more would hide the route."""
_MAX_COLUMNS: Final = 60
"""Maximum length of a line of an example, which the site shows in half of its width."""
_SUFFIXES: Final[Mapping[str, str]] = {
    "image/png": "png",
    "image/jpeg": "jpg",
    "application/zip": "npz",
    "model/gltf-binary": "glb",
}
"""File suffixes of binary media types."""
ENDLESS: Final = frozenset({"application/x-ndjson", "multipart/x-mixed-replace"})
"""Media types of responses that end only when the client disconnects."""


def type_text(schema: Mapping[str, Any]) -> str:
    """Return a schema's type, values and limits in words, such as ``integer, 1 to 16384``."""
    if "anyOf" in schema and len(kinds := [each for each in schema["anyOf"] if each != {"type": "null"}]) == 1:
        schema = {**schema, **kinds[0]}  # an optional parameter
    if "enum" in schema:
        return ", ".join(f"`{json.dumps(value).strip(chr(34))}`" for value in schema["enum"])
    kind = schema.get("type", "any")
    text = " or ".join(kind) if isinstance(kind, list) else kind
    if kind == "array":
        return f"array of: {type_text(schema['items'])}"
    if schema.get("format") == "binary":
        return "file"
    low, high = schema.get("minimum"), schema.get("maximum")
    if low is not None and high is not None:
        return f"{text}, {low:.12g} to {high:.12g}"
    limits = [
        f"{word} {schema[key]:.12g}"
        for key, word in (
            ("minimum", "at least"),
            ("exclusiveMinimum", "more than"),
            ("maximum", "at most"),
            ("exclusiveMaximum", "less than"),
        )
        if key in schema
    ]
    return ", ".join([text, *limits])


def json_text(value: Any, indent: str = "") -> str:
    """Return JSON in which objects and arrays that fit into a line are on one."""
    line = json.dumps(value, ensure_ascii=False)
    if len(indent) + len(line) <= _MAX_COLUMNS or not isinstance(value, dict | list) or not value:
        return line
    inner = indent + "  "
    if isinstance(value, dict):
        members = [f"{json.dumps(key)}: {json_text(each, inner)}" for key, each in value.items()]
    else:
        members = [json_text(each, inner) for each in value]
    first, last = "{}" if isinstance(value, dict) else "[]"
    return f"{first}\n" + ",\n".join(inner + member for member in members) + f"\n{indent}{last}"


def field_rows(schema: Mapping[str, Any]) -> Iterator[str]:
    """Yield a table row for each field of an object. For an array (the camera's parameters): for each type of item."""
    if schema.get("type") == "array" and "anyOf" in schema["items"]:
        for item in schema["items"]["anyOf"]:
            yield row(item["title"], type_text(item["properties"]["value"]), item.get("description", ""))
    required = schema.get("required", ())
    for name, field in schema.get("properties", {}).items():
        text = field.get("description", "")
        yield row(name, type_text(field), f"Required. {text}" if name in required else text)


def row(name: str, kind: str, text: str) -> str:
    """Return a table row of three cells: name, type and text."""
    cells = (f"`{name}`", kind, " ".join(text.split()))
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def example_of(description: Mapping[str, Any]) -> Any:
    """Return the first example in the description of a parameter or media type; None if it has none."""
    if "example" in description:
        return description["example"]
    return next((entry["value"] for entry in description.get("examples", {}).values()), None)


def curl(method: str, path: str, operation: Mapping[str, Any]) -> str:
    """Return a curl command for an operation, with its example values."""
    parameters = operation.get("parameters", ())
    for parameter in parameters:
        if parameter["in"] == "path":
            path = path.replace(f"{{{parameter['name']}}}", str(example_of(parameter)))
    ((media_type, _), *_) = operation["responses"]["200"].get("content", {"": None}).items()
    words = ["curl"]
    if media_type in ENDLESS:
        words.append("-N")
    if media_type in _SUFFIXES:
        words.append(f"-o {path.rpartition('/')[2].partition('.')[0]}.{_SUFFIXES[media_type]}")
    if method != "GET":
        words.append(f"-X {method}")
    words += _body_arguments(operation.get("requestBody", {}))
    return wrapped([*words, shlex.quote(f"{URL}{path}{_query(parameters)}")])


def wrapped(words: list[str]) -> str:
    """Return a command line, broken before words that would exceed ``_MAX_COLUMNS``."""
    lines = [words[0]]
    for word in words[1:]:
        if len(lines[-1]) + len(word) < _MAX_COLUMNS:
            lines[-1] += f" {word}"
        else:
            lines.append(f"  {word}")
    return " \\\n".join(lines)


def _query(parameters: Any) -> str:
    """Return the query of an example request: required parameters, and the first optional ones.

    Parameters whose example is their default are left out.
    """
    pairs, optional_count = [], 0
    for parameter in parameters:
        value = example_of(parameter)
        if parameter["in"] != "query" or value in (None, "", parameter["schema"].get("default")):
            continue
        if not parameter["required"]:
            optional_count += 1
            if optional_count > _MAX_EXTRA_PARAMETERS:
                continue
        values = value if isinstance(value, list) else [value]
        pairs += [f"{parameter['name']}={quote(str(item), safe=',;=')}" for item in values]
    return f"?{'&'.join(pairs)}" if pairs else ""


def _body_arguments(body: Mapping[str, Any]) -> list[str]:
    """Return the arguments of curl for a request's body."""
    for media_type, content in body.get("content", {}).items():
        value = example_of(content)
        if media_type == "application/json" and value is not None:
            return ["-H 'Content-Type: application/json'", f"-d {shlex.quote(json.dumps(value))}"]
        if media_type == "multipart/form-data" and value is not None:
            fields = content["schema"]["properties"]
            return [
                f"-F {name}=@{name}.glb" if fields[name].get("format") == "binary" else f"-F {name}={item}"
                for name, item in value.items()
            ]
    return []
