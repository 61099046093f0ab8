"""Limits and thread pitch of SDF joints."""

import math

from scenegate.robots.xml_text import Element, attribute, children_as_attributes, numbers


def limits_of(axis: Element | None, where: str, warnings: list[str]) -> tuple[float, float] | None:
    """Return the limits of a joint's axis; None if there are none."""
    limit = axis.find("limit") if axis is not None else None
    if limit is None:
        return None
    texts = children_as_attributes(limit)
    values = []
    for name, default in (("lower", -1e16), ("upper", 1e16)):
        text = attribute(texts, name).lower()
        infinite = text.lstrip("+-") in ("inf", "infinity")
        values.append(default if infinite else numbers(texts, name, (default,), where, warnings)[0])
    return (values[0], values[1]) if max(map(abs, values)) < 1e16 else None


def thread_pitch(joint: Element, where: str, warnings: list[str]) -> float:
    """Return the translation of a screw joint, metres per radian. As in libsdformat, the default is 1 m per turn."""
    texts = children_as_attributes(joint)
    if "screw_thread_pitch" in texts.attrib:  # metres per turn
        return numbers(texts, "screw_thread_pitch", (1.0,), where, warnings)[0] / math.tau
    (negative_radians_per_metre,) = numbers(texts, "thread_pitch", (-math.tau,), where, warnings)
    if negative_radians_per_metre == 0.0:
        warnings.append(f"{where}: its thread_pitch is 0; it turns without moving")
        return 0.0
    return -1.0 / negative_radians_per_metre
