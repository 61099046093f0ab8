"""Adds the package's description to its metadata: README.md with absolute links.

A package index shows the README without the other files of the repository, so links to them become links to the
repository: ``Repository`` in ``[project.urls]`` of pyproject.toml. Without that entry, links stay as they are.
"""

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

_LINK = re.compile(r"""(?P<start>\]\(|src="|href=")(?P<target>(?!https?:|#)[^)\s"]+)""")
"""A Markdown or HTML link or image whose target is a file of the repository."""
_IMAGE_SUFFIXES = (".gif", ".jpg", ".png", ".svg", ".webp")


class CustomMetadataHook(MetadataHookInterface):
    """Hatchling's hook for the metadata that pyproject.toml lists as dynamic."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set ``readme`` in the package's metadata."""
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        repository = metadata.get("urls", {}).get("Repository", "")
        metadata["readme"] = {"content-type": "text/markdown", "text": with_absolute_links(text, repository)}


def with_absolute_links(text: str, repository: str) -> str:
    """Return Markdown with absolute links.

    Args:
        text: Markdown with links to files of the repository.
        repository: URL of the GitHub repository; empty: the links stay as they are.
    """
    if not repository:
        return text
    files = f"{repository.rstrip('/')}/blob/HEAD"

    def absolute(link: re.Match[str]) -> str:
        raw = "?raw=true" if link["target"].endswith(_IMAGE_SUFFIXES) else ""
        return f"{link['start']}{files}/{link['target']}{raw}"

    return _LINK.sub(absolute, text)
