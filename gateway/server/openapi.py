"""Parts of the OpenAPI description that all routes share: tokens, common refusals, examples."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from typing import Any, Final

from fastapi import FastAPI

from gateway.server.access import COOKIE, QUERY

Responses = dict[int | str, dict[str, Any]]
"""Responses of a route by status, as FastAPI takes them."""

TEXT: Final[Mapping[str, Any]] = {"text/plain": {"schema": {"type": "string"}}}
"""Content of refusals: one sentence."""
SECURITY_SCHEMES: Final[Mapping[str, Any]] = {
    "token": {
        "type": "http",
        "scheme": "bearer",
        "description": "A token of --http-token-file, if the gateway has one: `Authorization: Bearer TOKEN`.",
    },
    "cookie": {
        "type": "apiKey",
        "in": "cookie",
        "name": COOKIE,
        "description": f"What a browser gets instead of the token after one GET with `?{QUERY}=TOKEN`.",
    },
}
_REFUSALS: Final[Mapping[int, str]] = {
    414: "The path with its query is too long.",
    421: "The Host header names a host that this gateway is not (--trusted-hosts).",
    500: "A defect of the server; the text names the request's id.",
    503: "The gateway did not start, or too many requests wait; see Retry-After.",
}
"""Text responses that every route may give."""
_CROSS_SITE: Final = "A web page of another site has sent the request."
_NO_TOKEN: Final = "A token is needed."  # noqa: S105 - a sentence
_UNSAFE: Final = frozenset({"post", "put", "patch", "delete"})


def example(value: Any, name: str = "example") -> dict[str, Any]:
    """Example of a parameter, as FastAPI's Path and Query and OpenAPI's media types take it."""
    return {name: {"value": value}}


def json_example(value: Any, description: str = "Success.") -> Responses:
    """The 200 response of a route that answers with JSON."""
    return {200: {"description": description, "content": {"application/json": {"example": value}}}}


def describe(app: FastAPI, *, token: bool, open_paths: Collection[str]) -> None:
    """Adds the security schemes and the common refusals to the description that ``app`` makes of itself.

    Args:
        token: whether requests need a token.
        open_paths: paths that do not.
    """
    generate = app.openapi

    def openapi() -> dict[str, Any]:
        schema = generate()
        if "securitySchemes" not in schema.setdefault("components", {}):  # FastAPI keeps what it has made
            _complete(schema, token, open_paths)
        return schema

    app.openapi = openapi  # type: ignore[method-assign]  # as FastAPI's manual extends the description


def _complete(schema: dict[str, Any], token: bool, open_paths: Collection[str]) -> None:
    schema["components"]["securitySchemes"] = dict(SECURITY_SCHEMES)
    if token:
        schema["security"] = [{name: []} for name in SECURITY_SCHEMES]
    for path, methods in schema["paths"].items():
        for method, operation in methods.items():
            refusals = dict(_REFUSALS)
            if method in _UNSAFE:
                refusals[403] = _CROSS_SITE
            if token and path in open_paths:
                operation["security"] = []
            elif token:
                refusals[401] = _NO_TOKEN
            for status, text in refusals.items():
                response = operation["responses"].setdefault(str(status), {"description": text})
                response.setdefault("content", {}).update(TEXT)
