"""Converts names of links to paths in the live tree, relative to their family's node."""

from collections import Counter
from collections.abc import Iterable
from typing import Final

from gateway.adapters.drakeviewer.config import Limits
from gateway.adapters.drakeviewer.wire import LinkKey, MessageError
from gateway.files.assets.mesh_files import quoted
from gateway.scene.tree.nodes import Path

SEPARATOR: Final = "::"
"""Separates source, model and link in Drake's names."""
OWN_NODE: Final = "body"
"""Name of a link's own node if other links are below its path. Their poses are in the world, so that a link's node must
not be above another one's."""


def split_name(name: str, limits: Limits) -> Path:
    """Return the elements of a scoped name, ``("",)`` if it has none. Raises MessageError if it has too many."""
    elements = tuple(element for element in name.split(SEPARATOR) if element) or ("",)
    if len(elements) > limits.name_elements:
        raise MessageError(f"the name {quoted(name)} has {len(elements)} elements, the limit is {limits.name_elements}")
    return elements


def link_paths(links: Iterable[LinkKey], limits: Limits) -> dict[LinkKey, Path]:
    """Return a path for each link, none above another one. Raises MessageError if a name has too many elements.

    Links of different models that have the same name get the model's index in parentheses, as Drake writes it.
    """
    keys = list(dict.fromkeys(links))
    uses = Counter(name for _, name in keys)
    paths: dict[LinkKey, Path] = {}
    for key in keys:
        robot, name = key
        *scopes, last = split_name(name, limits)
        paths[key] = (*scopes, f"{last}({robot})" if uses[name] > 1 else last)
    above = {path[:depth] for path in paths.values() for depth in range(len(path))}
    return {key: (*path, OWN_NODE) if path in above else path for key, path in paths.items()}


def count_nodes(paths: Iterable[Path]) -> int:
    """Return the number of nodes that paths have together, without the root."""
    return len({path[:depth] for path in paths for depth in range(1, len(path) + 1)})
