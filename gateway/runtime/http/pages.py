"""The pages at ``/`` and ``/docs``, without requests to other hosts.

Their addresses are relative: a proxy may serve the gateway below a path prefix that only the proxy knows.
"""

import json
from collections.abc import Mapping
from html import escape
from typing import Final

from fastapi import FastAPI
from fastapi.openapi.docs import get_swagger_ui_html
from starlette.responses import HTMLResponse

_DOCS_FILES: Final = "static-offline-docs"
"""Path at which fastapi_offline serves the files of Swagger UI."""

_PAGE = """<!doctype html>
<html lang="en">
<meta charset="utf-8">
<meta name="viewport" content="width=device-width, initial-scale=1">
<title>Scenegate</title>
<link rel="icon" href="data:,">
<style>
  body {{ font: 16px/1.5 system-ui, sans-serif; max-width: 44rem; margin: 3rem auto; padding: 0 1rem; }}
  @media (prefers-color-scheme: dark) {{ body {{ background: #16191d; color: #dde1e6; }} a {{ color: #7db7ff; }} }}
  td {{ padding: .15rem 1rem .15rem 0; vertical-align: top; }}
  .failed {{ color: #d33; }}
  img {{ max-width: 100%; }}
</style>
<h1>Scenegate</h1>
<p>Version {version}. {links}</p>
<table id="interfaces"></table>
<script>
  const table = document.getElementById("interfaces");
  const names = {names};
  async function show() {{
    const health = await (await fetch("healthz")).json();
    table.replaceChildren(...Object.entries(health.interfaces).map(([name, entry]) => {{
      const row = document.createElement("tr");
      const kind = name.split(" ")[0];  // further cameras are "stereo 1" and so on
      const [title, page] = names[kind] ?? [kind, ""];
      const link = document.createElement(page ? "a" : "span");
      if (page) link.href = page;
      link.textContent = title + name.slice(kind.length);
      row.insertCell().append(link);
      for (const text of [entry.state, entry.problem || entry.where || ""]) {{
        const cell = row.insertCell();
        cell.textContent = text;
        if (text === "failed") cell.className = "failed";
      }}
      return row;
    }}));
    setTimeout(show, 2000);
  }}
  show();
</script>
</html>
"""


def index_page(version: str, links: Mapping[str, str], names: Mapping[str, tuple[str, str]]) -> HTMLResponse:
    """Return the page with links and the states of the interfaces.

    Args:
        links: link texts by path relative to the page, or URL.
        names: title of each interface, and the address of its documentation or "", by name in ``/healthz``.
    """
    link_list = " · ".join(f'<a href="{escape(path)}">{escape(text)}</a>' for path, text in links.items())
    return HTMLResponse(_PAGE.format(version=escape(version), links=link_list, names=json.dumps(names)))


def docs_page(app: FastAPI) -> HTMLResponse:
    """Return the page with the HTTP interface: Swagger UI from this package."""
    return get_swagger_ui_html(
        openapi_url="openapi.json",
        title=f"{app.title}: HTTP interface",
        swagger_js_url=f"{_DOCS_FILES}/swagger-ui-bundle.js",
        swagger_css_url=f"{_DOCS_FILES}/swagger-ui.css",
        swagger_favicon_url=f"{_DOCS_FILES}/favicon.png",
        swagger_ui_parameters=app.swagger_ui_parameters,
    )
