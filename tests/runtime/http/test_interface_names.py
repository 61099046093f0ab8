"""Names of the interfaces, and the pages that describe them."""

import importlib.metadata
from collections.abc import Iterator
from email.message import Message
from pathlib import Path

import pytest

from gateway.runtime.http import interface_names
from gateway.runtime.http.interface_names import NAMES, documentation_of, documentation_url, title_of
from gateway.wiring.startup import INTERFACES

DOCS = Path(__file__).parents[3] / "docs"


@pytest.fixture
def _documented(monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """The package says where its documentation is."""
    described = Message()
    described["Project-URL"] = "Repository, https://example.org/repository"
    described["Project-URL"] = "Documentation, https://example.org/docs"
    monkeypatch.setattr(interface_names, "metadata", lambda name: described)
    documentation_url.cache_clear()
    yield
    documentation_url.cache_clear()


def test_every_interface_has_a_name_and_its_page_exists() -> None:
    assert set(INTERFACES) <= set(NAMES)
    assert [entry.page for entry in NAMES.values() if entry.page and not (DOCS / f"{entry.page}.md").exists()] == []


def test_titles() -> None:
    assert title_of("drakeviewer") == "Drake's visualizer"
    assert title_of("stereo 2") == "Stereo camera 2"
    assert title_of("other") == "other"


@pytest.mark.usefixtures("_documented")
def test_links_to_the_documentation() -> None:
    assert documentation_of("treeviewer") == "https://example.org/docs/tree-viewer/"
    assert documentation_of("stereo 2") == "https://example.org/docs/stereo-camera/"
    assert documentation_of("other") == documentation_of("demo") == ""


def test_no_links_without_an_address() -> None:
    documentation_url.cache_clear()
    if "Documentation" in str(importlib.metadata.metadata("scenegate").get_all("Project-URL")):
        pytest.skip("the package says where its documentation is")
    assert documentation_of("treeviewer") == ""
