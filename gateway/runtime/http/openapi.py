"""Parts of the OpenAPI description that all routes share: tokens, common errors, examples."""

from collections.abc import Collection, Mapping
from typing import Any, Final

from fastapi import FastAPI

from gateway.runtime.http.access import COOKIE_NAME, TOKEN_PARAMETER
from gateway.runtime.http.error_handlers import JSON_PATHS

Responses = dict[int | str, dict[str, Any]]
"""Responses of a route by status, in FastAPI's format."""

TEXT: Final[Mapping[str, Any]] = {"text/plain": {"schema": {"type": "string"}}}
"""Content of error responses: one sentence."""
BINARY: Final[Mapping[str, Any]] = {"type": "string", "format": "binary"}
"""Schema of a file."""
SECURITY_SCHEMES: Final[Mapping[str, Any]] = {
    "token": {
        "type": "http",
        "scheme": "bearer",
        "description": "A token of --http-token-file: `Authorization: Bearer TOKEN`.",
    },
    "cookie": {
        "type": "apiKey",
        "in": "cookie",
        "name": COOKIE_NAME,
        "description": f"Cookie that a browser gets after a GET with `?{TOKEN_PARAMETER}=TOKEN`.",
    },
}
_COMMON_ERRORS: Final[Mapping[int, str]] = {
    414: "The path with its query is too long.",
    421: "The Host header has an unknown name (--trusted-hosts).",
    500: "Internal error; the text has the request's id.",
    503: "The gateway did not start, or the queue is full (with Retry-After).",
}
"""Text responses that every route may return."""
_MESSAGE: Final[Mapping[str, Any]] = {"application/json": {"schema": {"type": "object"}}}
"""Content of the stereo camera's error responses: one sentence in the field message."""
_INVALID: Final = "A parameter is not valid; the text says why."
_CROSS_SITE: Final = "The request comes from a page of another site."
_NO_TOKEN: Final = "A token is required."  # noqa: S105 - a sentence
_UNSAFE: Final = frozenset({"post", "put", "patch", "delete"})


def example(value: Any, name: str = "example") -> dict[str, Any]:
    """Return an example in the format of OpenAPI parameters and media types."""
    return {name: {"value": value}}


def json_example(
    value: Any, description: str = "Success.", other_content: Mapping[str, Any] | None = None
) -> Responses:
    """Return the description of a 200 response with JSON, an object or objects as the example, or of other content."""
    one: dict[str, Any] = {"type": "object"}
    schema = {"type": "array", "items": one} if isinstance(value, list) else one
    content = {"application/json": {"schema": schema, "example": value}, **(other_content or {})}
    return {200: {"description": description, "content": content}}


def error_responses(descriptions: Mapping[int, str]) -> Responses:
    """Return the descriptions of responses with one sentence as text, by status."""
    return {status: {"description": text, "content": dict(TEXT)} for status, text in descriptions.items()}


def file_response(description: str, *media_types: str) -> Responses:
    """Return the description of a 200 response with a file of one of these types."""
    # Generated clients decode text/*, and could not write what they have decoded as binary.
    content = {each: {"schema": {"type": "string"} if each.startswith("text/") else BINARY} for each in media_types}
    return {200: {"description": description, "content": content}}


def describe(app: FastAPI, *, token: bool, open_paths: Collection[str]) -> None:
    """Add the security schemes and common errors to the OpenAPI description of ``app``.

    Args:
        token: True if requests need a token.
        open_paths: paths that need none.
    """
    generate = app.openapi

    def openapi() -> dict[str, Any]:
        if app.openapi_schema is None:  # FastAPI keeps the schema there
            _complete(generate(), token, open_paths)
        return generate()

    app.openapi = openapi  # type: ignore[method-assign]  # FastAPI's documented way


def _complete(schema: dict[str, Any], token: bool, open_paths: Collection[str]) -> None:
    if token:
        schema.setdefault("components", {})["securitySchemes"] = dict(SECURITY_SCHEMES)
        schema["security"] = [{name: []} for name in SECURITY_SCHEMES]
    for path, methods in schema["paths"].items():
        for method, operation in methods.items():
            errors = dict(_COMMON_ERRORS)
            if method in _UNSAFE:
                errors[403] = _CROSS_SITE
            if token and path in open_paths:
                operation["security"] = []
            elif token:
                errors[401] = _NO_TOKEN
            if (invalid := operation["responses"].get("422")) is not None:
                if invalid["description"] == "Validation Error":  # FastAPI's
                    invalid["description"] = _INVALID
                invalid["content"] = dict(_MESSAGE if path.startswith(JSON_PATHS) else TEXT)
            for status, text in errors.items():
                response = operation["responses"].setdefault(str(status), {"description": text})
                response.setdefault("content", {}).update(TEXT)
