"""Write the description of the package: README.md, whose links and pictures an index can show.

An index shows the README without the files beside it, so links to these become links to the repository. Its address is
``Repository`` in ``[project.urls]`` of pyproject.toml. Without one they stay as they are.
"""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface

_LINK = re.compile(r"""(?P<start>\]\(|src="|href=")(?P<target>(?!https?:|#)[^)\s"]+)""")
"""The target of a Markdown or HTML link or picture, if it is a file of the repository."""

_PICTURES = (".gif", ".jpg", ".png", ".svg", ".webp")


class CustomMetadataHook(MetadataHookInterface):
    """Hatchling's hook for metadata that pyproject.toml lists as dynamic."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set ``readme``."""
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        repository = metadata.get("urls", {}).get("Repository", "")
        metadata["readme"] = {"content-type": "text/markdown", "text": with_absolute_links(text, repository)}


def with_absolute_links(text: str, repository: str) -> str:
    """Return the Markdown text with links to files below a GitHub repository's address, if there is one."""
    if not repository:
        return text
    files = f"{repository.rstrip('/')}/blob/HEAD"

    def absolute(link: re.Match[str]) -> str:
        raw = "?raw=true" if link["target"].endswith(_PICTURES) else ""
        return f"{link['start']}{files}/{link['target']}{raw}"

    return _LINK.sub(absolute, text)
