"""The page of ``/view`` and a recording in one HTML file, which a browser opens from a disk without a network."""

import base64
import hashlib
import html
import re
from functools import cache
from typing import Final

from gateway.adapters.viewer.config import STATIC

RECORDING_ID: Final = "recording"
"""Id of the element with the recording, by which the page finds it."""
_SCRIPT_TAG: Final = re.compile(r"<script [^<>]*></script>")
_STYLE_TAG: Final = re.compile(r'<link rel="stylesheet"[^>]*>')
_ASSET: Final = re.compile(r'/assets/([^/"]+)"')
_SCRIPT_END: Final = re.compile(r"<(/script|!--)", re.IGNORECASE)
"""Texts in a script that HTML takes for its end, or for the begin of a comment that may hide its end."""


def scene_html(recording: bytes, view: str = "") -> bytes:
    """Return the page with a recording, as one HTML file. Its content security policy lets it load nothing else.

    Nothing of the scene is in the file as text: the recording is compressed, and in base64. ``view``: camera to open
    with, as after ``#`` in the page's address; empty: the home view.
    """
    head, tail = _page()
    return b"".join((head, html.escape(view).encode(), b'">', base64.b64encode(recording), tail))


@cache
def _page() -> tuple[bytes, bytes]:
    """Return the file before and after the recording."""
    index = STATIC.joinpath("index.html").read_text("utf-8")
    (script_tag,), (style_tag,) = _SCRIPT_TAG.findall(index), _STYLE_TAG.findall(index)
    script = _SCRIPT_END.sub(r"<\\\1", _asset(script_tag))
    style = _asset(style_tag)
    policy = (
        f"default-src 'none'; script-src {_hash_source(script)}; style-src {_hash_source(style)}; "
        "img-src data: blob:; connect-src blob:; base-uri 'none'; form-action 'none'"
    )
    index = index.replace(script_tag, "").replace(style_tag, f"<style>{style}</style>")
    index = index.replace("<head>", f'<head>\n    <meta http-equiv="Content-Security-Policy" content="{policy}">', 1)
    licenses = html.escape(STATIC.joinpath("THIRD_PARTY_LICENSES.md").read_text("utf-8"))
    head, end = index.split("</body>")
    head += f'  <pre id="licenses" hidden>{licenses}</pre>\n'
    head += f'    <script id="{RECORDING_ID}" type="application/octet-stream" data-view="'
    tail = f'</script>\n    <script type="module">{script}</script>\n  </body>{end}'
    return head.encode(), tail.encode()


def _asset(tag: str) -> str:
    """Return the content of the file that a tag refers to."""
    (name,) = _ASSET.findall(tag)
    return STATIC.joinpath("assets", name).read_text("utf-8")


def _hash_source(text: str) -> str:
    """Return the source expression of a content security policy that allows an inline script or style."""
    return f"'sha256-{base64.b64encode(hashlib.sha256(text.encode()).digest()).decode()}'"
