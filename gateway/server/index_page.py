"""The page at ``/``: links and the states of the interfaces, without requests to other hosts."""

from __future__ import annotations

from html import escape

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
  async function show() {{
    const health = await (await fetch("healthz")).json();
    table.replaceChildren(...Object.entries(health.interfaces).map(([name, entry]) => {{
      const row = document.createElement("tr");
      for (const text of [name, entry.state, entry.problem || entry.where || ""]) {{
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


def index_page(version: str, links: dict[str, str]) -> str:
    """Return the page as HTML.

    Args:
        links: link texts by path relative to the page.
    """
    link_list = " · ".join(f'<a href="{escape(path)}">{escape(text)}</a>' for path, text in links.items())
    return _PAGE.format(version=escape(version), links=link_list)
