"""Parses XML and attributes, with errors that name the element.

All functions raise RobotFileError. ``where`` is the start of its message: the link or joint of the element.
"""

from __future__ import annotations

import math
from typing import Any, Final
from xml.etree import ElementTree

from gateway.robots.errors import RobotFileError

Element = ElementTree.Element


MAX_DEPTH: Final = 10_000
"""Maximum depth of XML elements. Bodies of MJCF files contain each other: a chain of 1000 links has as many levels."""


class _TreeBuilder(ElementTree.TreeBuilder):
    """Builds elements. A DOCTYPE is an error: its entities could expand to gigabytes."""

    def __init__(self, max_elements: int) -> None:
        super().__init__()
        self._max_elements = max_elements
        self._count = self._depth = 0

    def start(self, tag: str, attrs: dict[Any, Any]) -> Element:
        self._count, self._depth = self._count + 1, self._depth + 1
        if self._count > self._max_elements:
            raise RobotFileError(f"it has more than {self._max_elements} XML elements, which is the limit")
        if self._depth > MAX_DEPTH:
            raise RobotFileError(f"its XML has more than {MAX_DEPTH} levels, which is the limit")
        return super().start(tag, attrs)

    def end(self, tag: str) -> Element:
        self._depth -= 1
        return super().end(tag)

    def doctype(self, name: str, public_id: str | None, system_id: str | None) -> None:
        raise RobotFileError("XML with a DOCTYPE is refused")


def parse_xml(data: bytes, max_elements: int) -> Element:
    """Return the root element.

    Raises:
        RobotFileError: The data is not XML, has a DOCTYPE, or more elements than allowed.
    """
    parser = ElementTree.XMLParser(target=_TreeBuilder(max_elements))  # noqa: S314 - no entities
    try:
        return ElementTree.fromstring(data, parser)  # noqa: S314
    except RobotFileError:
        raise
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise RobotFileError(f"it is not XML: {error}") from None


def required(element: Element, attribute: str, where: str) -> str:
    """Return a required attribute without surrounding space. An empty one counts as missing."""
    text = element.get(attribute)
    if text is None or not text.strip():
        raise RobotFileError(f"{where}: <{element.tag}> has no {attribute}")
    return text.strip()


def numbers(element: Element | None, attribute: str, default: tuple[float, ...], where: str) -> tuple[float, ...]:
    """Return as many finite numbers as the default has; the default if the attribute is missing."""
    text = element.get(attribute) if element is not None else None
    if text is None or element is None:
        return default
    try:
        values = tuple(float(number) for number in text.split())
    except ValueError:
        values = ()
    if len(values) != len(default) or not all(map(math.isfinite, values)):
        raise RobotFileError(
            f"{where}: {attribute}={text[:60]!r} of <{element.tag}> must be {len(default)} finite numbers"
        )
    return values


def positive_number(element: Element, attribute: str, where: str) -> float:
    """Return a required attribute as a finite number above zero."""
    text = required(element, attribute, where)
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise RobotFileError(f"{where}: {attribute}={text[:60]!r} of <{element.tag}> must be a number above 0")
    return value
