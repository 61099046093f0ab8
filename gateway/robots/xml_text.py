"""Parses XML and its attributes, with errors that name the element."""

from __future__ import annotations

import math
from xml.etree import ElementTree

from gateway.robots.errors import RobotFileError

Element = ElementTree.Element


class _TreeBuilder(ElementTree.TreeBuilder):
    """Builds elements; refuses a DOCTYPE, whose entities can expand to gigabytes."""

    def doctype(self, name: str, public_id: str | None, system_id: str | None) -> None:
        raise RobotFileError("XML with a DOCTYPE is refused")


def parse_xml(data: bytes) -> Element:
    """Return the root element.

    Raises:
        RobotFileError: The data is no XML, or has a DOCTYPE.
    """
    try:
        return ElementTree.fromstring(data, ElementTree.XMLParser(target=_TreeBuilder()))  # noqa: S314 - no entities
    except (ElementTree.ParseError, ValueError, LookupError) as error:
        raise RobotFileError(f"it is not XML: {error}") from None


def required(element: Element, attribute: str, where: str) -> str:
    """Return an attribute that must be there, without surrounding space."""
    text = element.get(attribute)
    if text is None or not text.strip():
        raise RobotFileError(f"{where}: <{element.tag}> has no {attribute}")
    return text.strip()


def numbers(element: Element | None, attribute: str, default: tuple[float, ...], where: str) -> tuple[float, ...]:
    """Return the numbers of an attribute, as many as the default has; the default if the attribute is missing."""
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


def length(element: Element, attribute: str, where: str) -> float:
    """Return a number that must be there, and above zero."""
    text = required(element, attribute, where)
    try:
        value = float(text)
    except ValueError:
        value = math.nan
    if not 0.0 < value < math.inf:
        raise RobotFileError(f"{where}: {attribute}={text[:60]!r} of <{element.tag}> must be a number above 0")
    return value
