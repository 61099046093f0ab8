"""The built site (``make docs-site``): pages as on GitHub, nothing from other hosts, a search that finds."""

import functools
import http.server
import re
import threading
from collections import Counter
from collections.abc import Iterator
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

import pytest
from markdown_it import MarkdownIt

from tests.docs.pages import ROOT
from tests.support.browser import chromium, new_page

DOCS = ROOT / "docs"
SITE = ROOT / "out" / "site"
TAGS = frozenset({"h1", "h2", "h3", "h4", "li", "table", "tr", "td", "pre", "img", "strong", "em", "code", "a"})
PAGES = [page for page in sorted(DOCS.rglob("*.md")) if not page.name.startswith("python-")]
"""All pages but those that are filled with docstrings on the site."""


@pytest.fixture(scope="module")
def site() -> Path:
    """The folder of the site, which has to be newer than its pages."""
    index = SITE / "index.html"
    newest = max(file.stat().st_mtime for file in (ROOT / "mkdocs.yml", *DOCS.rglob("*.*")))
    if not index.is_file() or index.stat().st_mtime < newest:
        pytest.skip("the site is not built, or older than docs/: make docs-site")
    return SITE


class Elements(HTMLParser):
    """Number of elements of an article by tag, without what the site adds: anchors of headings and buttons."""

    def __init__(self, html: str) -> None:
        super().__init__()
        self.count: Counter[str] = Counter()
        self._inside = False
        self.feed(html)

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self._inside |= tag == "article"
        attributes = dict(attrs)
        added = tag == "a" and ("href" not in attributes or attributes.get("class"))
        if self._inside and tag in TAGS and not added:
            self.count[tag] += 1

    def handle_endtag(self, tag: str) -> None:
        self._inside &= tag != "article"


@pytest.mark.parametrize("page", PAGES, ids=lambda page: str(page.relative_to(DOCS)))
def test_page_has_the_elements_that_github_shows(page: Path, site: Path) -> None:
    """The site's Markdown is not GitHub's: an indent or a backslash can swallow a heading in one of them."""
    name = page.relative_to(DOCS)
    built = site / name.parent / ("" if page.name == "README.md" else page.stem) / "index.html"
    github = MarkdownIt("commonmark", {"html": True}).enable("table").render(page.read_text("utf-8"))
    assert Elements(built.read_text("utf-8")).count == Elements(f"<article>{github}</article>").count


def test_nothing_is_loaded_from_other_hosts(site: Path) -> None:
    for file in (*site.rglob("*.html"), *site.rglob("*.css")):
        text = file.read_text("utf-8")
        loaded = re.findall(
            r"""(?:<(?:script|img|link|iframe)[^>]*(?:src|href)="|@import ["']|url\(["']?)(https?:[^"')]*)""", text
        )
        assert not loaded, f"{file.relative_to(site)} loads {loaded}"


def test_python_reference_has_the_docstrings(site: Path) -> None:
    html = (site / "reference" / "python-tree-viewer" / "index.html").read_text("utf-8")
    assert 'id="scenegate.TreeViewer.set_transforms"' in html
    assert "Client of Scenegate or any other viewer" in html


@pytest.fixture
def url(site: Path) -> Iterator[str]:
    """Address of a server of the site."""

    class Handler(http.server.SimpleHTTPRequestHandler):
        def log_message(self, *_: Any) -> None:
            pass

    handler = functools.partial(Handler, directory=str(site))
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}"
        server.shutdown()


@pytest.mark.browser
@pytest.mark.slow
def test_search_and_reference_in_a_browser(url: str) -> None:
    with chromium() as browser:
        page = new_page(browser, viewport={"width": 1440, "height": 900})
        faults: list[str] = []
        page.on("pageerror", lambda error: faults.append(str(error)))
        page.on("request", lambda request: faults.append(request.url) if url not in request.url else None)
        page.goto(url)
        page.locator("input[role=combobox]").wait_for(state="attached")  # the script has made the search
        page.keyboard.press("Control+k")
        page.get_by_role("combobox", name="Search").fill("multicast route")
        page.locator("[role=option][href*=troubleshooting], [role=option] [href*=troubleshooting]").first.click()
        page.wait_for_url("**/troubleshooting/**")

        page.goto(f"{url}/reference/http/")
        text, example = page.locator(".operation").first.locator("> div").all()
        assert text.bounding_box()["x"] < example.bounding_box()["x"]
        page.set_viewport_size({"width": 390, "height": 844})
        assert text.bounding_box()["y"] < example.bounding_box()["y"]
        assert page.evaluate("document.documentElement.scrollWidth") <= 390
        assert faults == []
