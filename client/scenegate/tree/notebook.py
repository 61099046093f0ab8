"""The scene in a notebook: Jupyter, VS Code, Colab. They show objects by ``_repr_html_`` and ``_repr_png_``."""

import html
import os
import sys
from dataclasses import dataclass, field
from ipaddress import ip_address
from typing import Any, Final
from urllib.parse import urlsplit

from scenegate.credentials import Credentials
from scenegate.gateway_http import fetch

DEFAULT_HTTP_PORT: Final = 8000
_STYLE: Final = "border: 0; width: 100%"


@dataclass(frozen=True, slots=True)
class NotebookFrame:
    """A page in a frame, as the last value of a notebook's cell, or as an argument of ``display``."""

    html: str = field(repr=False)

    def _repr_html_(self) -> str:
        return self.html


@dataclass(frozen=True, slots=True)
class NotebookImage:
    """An image, as the last value of a notebook's cell, or as an argument of ``display``."""

    png: bytes = field(repr=False)
    """The PNG file."""

    def _repr_png_(self) -> bytes:
        return self.png


class NotebookViews:
    """Methods of ``TreeViewer`` that return what a notebook shows as the value of a cell."""

    page_url: str
    """Address of the gateway's HTTP port, for the browser and for this program. Default: the environment variable
    SCENEGATE_URL, or else port 8000 of the hub's host."""

    def __init__(self, lcm_url: str) -> None:
        self.page_url = _default_page_url(lcm_url)

    def show(self, *, static: bool | None = None, seconds: float | None = None, height: int = 480) -> NotebookFrame:
        """Return the page in a frame. A viewer as the value of a cell is shown in the same way.

        Args:
            static: False: the live page, while the gateway runs. True: the page with the scene as it is, which stays
                in the notebook's file (1 MB and the scene). None: static in Colab, where the browser does not reach
                the gateway.
            seconds: length of the motion of a static page; None: all that the gateway has kept.
            height: height of the frame, pixels.

        Raises:
            ConnectionError: the page is static, and the gateway does not respond.
            ValueError: the gateway refuses it.
        """
        if static is None:
            static = "google.colab" in sys.modules
        if not static:
            source = html.escape(f"{self.page_url.rstrip('/')}/view")
            return NotebookFrame(f'<iframe src="{source}" height="{height}" style="{_STYLE}" allowfullscreen></iframe>')
        page = html.escape(self._fetch("view/scene.html", seconds=seconds).decode())
        # A sandbox without "allow-same-origin": the page has no access to the notebook.
        return NotebookFrame(
            f'<iframe srcdoc="{page}" sandbox="allow-scripts allow-downloads" height="{height}" '
            f'style="{_STYLE}" allowfullscreen></iframe>'
        )

    def _repr_html_(self) -> str:
        return self.show().html

    def image(self, /, camera: str = "fit", width: int = 640, height: int = 480, **query: Any) -> NotebookImage:
        """Return an image of the scene by the gateway's rasterizer.

        Args:
            camera: as the parameter of ``/scene/render``: ``fit``, ``stereo``, ``path:["robot"]``, ``eye=…;target=…``.
            width: pixels.
            height: pixels.
            query: further parameters of ``/scene/render``, such as ``type="label"``, ``look="plain"``.

        Raises:
            ConnectionError: the gateway does not respond.
            ValueError: a parameter is invalid.
        """
        return NotebookImage(self._fetch("scene/render", camera=camera, width=width, height=height, **query))

    def _fetch(self, name: str, **query: Any) -> bytes:
        return fetch(self.page_url, name, Credentials(os.environ.get("SCENEGATE_TOKEN") or None), name, **query)


def _default_page_url(lcm_url: str) -> str:
    if url := os.environ.get("SCENEGATE_URL"):
        return url.rstrip("/")
    host = urlsplit(lcm_url).hostname if lcm_url.startswith("tcpq://") else None
    # Browsers send cookies to a frame of the same site only, and notebooks are on localhost.
    return f"http://{'localhost' if host is None or _is_loopback(host) else host}:{DEFAULT_HTTP_PORT}"


def _is_loopback(host: str) -> bool:
    try:
        return ip_address(host).is_loopback
    except ValueError:
        return False
