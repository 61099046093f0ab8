"""The page at ``/docs``: Swagger UI from this package, with addresses relative to the page.

A proxy may serve the gateway below a path prefix that only the proxy knows.
"""

from __future__ import annotations

from fastapi import FastAPI
from fastapi.openapi.docs import get_swagger_ui_html
from starlette.responses import HTMLResponse

_FILES = "static-offline-docs"
"""Path at which fastapi_offline serves the files of Swagger UI."""


def docs_page(app: FastAPI) -> HTMLResponse:
    """Return the page."""
    return get_swagger_ui_html(
        openapi_url="openapi.json",
        title=f"{app.title}: HTTP interface",
        swagger_js_url=f"{_FILES}/swagger-ui-bundle.js",
        swagger_css_url=f"{_FILES}/swagger-ui.css",
        swagger_favicon_url=f"{_FILES}/favicon.png",
        swagger_ui_parameters=app.swagger_ui_parameters,
    )
