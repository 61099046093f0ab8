"""Store of the device's parameters, with validation."""

import math
from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final

from gateway.adapters.stereo.device.parameter_specs import NODES, DeviceLimits, Spec, Value, specs_of

_MAX_SHOWN_CHARS: Final = 80
"""Maximum number of characters of a client's value in an error message."""


class ParameterError(ValueError):
    """Invalid value; the message names the parameter and the limit."""


class UnknownParameterError(LookupError):
    """The device has no such node or parameter."""


class Parameters:
    """Values of the parameters of all nodes."""

    def __init__(self, limits: DeviceLimits | None = None, on_change: Callable[[], object] = lambda: None) -> None:
        """``limits`` None: those of the rc_visard. ``on_change`` is called after each change."""
        self._on_change = on_change
        self.limits = limits or DeviceLimits()
        self._specs = specs_of(self.limits)
        self._values: dict[str, dict[str, Value]] = {
            node: {spec.name: spec.default for spec in specs.values()} for node, specs in self._specs.items()
        }
        self.version = 0
        """Number of changes."""

    def values(self, node: str) -> Mapping[str, Value]:
        """Return all values of a node."""
        return self._values[node]

    def spec(self, node: str, name: str) -> Spec:
        """Return the specification of a parameter. Raises UnknownParameterError for an unknown node or parameter."""
        specs = self._specs.get(node)
        if specs is None:
            raise UnknownParameterError(f"there is no node {node!r}; there are {', '.join(NODES)}")
        spec = specs.get(name)
        if spec is None:
            raise UnknownParameterError(f"{node} has no parameter {name!r}")
        return spec

    def set(self, node: str, values: Iterable[tuple[str, object]]) -> list[str]:
        """Set parameters of a node: all values, or none if one is invalid; return the names, in the given order.

        Raises UnknownParameterError, or ParameterError for a wrong type or a value out of range.
        """
        checked = [(name, check_value(self.spec(node, name), value)) for name, value in values]
        for name, value in checked:
            self._values[node][name] = value
            # The older switch exp_auto and the newer choice exp_control mean the same.
            if name == "exp_auto":
                self._values[node]["exp_control"] = "Auto" if value else "Manual"
            elif name == "exp_control":
                self._values[node]["exp_auto"] = value != "Manual"
        if checked:
            self._count_change()
        return [name for name, _ in checked]

    def reset(self, node: str) -> None:
        """Restore the defaults of a node."""
        for spec in self._specs[node].values():
            self._values[node][spec.name] = spec.default
        self._count_change()

    def _count_change(self) -> None:
        self.version += 1
        self._on_change()

    def describe(self, node: str, name: str) -> dict[str, Any]:
        """Return the device's REST representation of a parameter."""
        spec = self.spec(node, name)
        return {
            "name": spec.name,
            "type": spec.type,
            "value": self._values[node][spec.name],
            "min": spec.minimum,
            "max": spec.maximum,
            "default": spec.default,
            "description": spec.description,
        }


def check_value(spec: Spec, value: object) -> Value:
    """Return the validated value, given decoded JSON. Raises ParameterError for a wrong type, another choice, or out of
    range."""
    if spec.type == "string":
        if not isinstance(value, str):
            raise ParameterError(f"{spec.name}: {_shown_value(value)} is not a string")
        value = spec.aliases.get(value, value)
        if value not in spec.choices:
            raise ParameterError(f"{spec.name}: {_shown_value(value)} is not one of {', '.join(spec.choices)}")
        return value
    if spec.type == "bool":
        if isinstance(value, (bool, int, float)) and value in (0, 1):
            return bool(value)
        raise ParameterError(f"{spec.name}: {_shown_value(value)} is not true or false")
    number = _number(spec, value)
    assert isinstance(spec.minimum, (int, float))
    assert isinstance(spec.maximum, (int, float))
    if not spec.minimum <= number <= spec.maximum:
        raise ParameterError(
            f"{spec.name}: {number:g} is out of range, {spec.minimum:g} to {spec.maximum:g} are allowed"
        )
    return number


def _number(spec: Spec, value: object) -> int | float:
    """Return a finite number of the parameter's type. Raises ParameterError for anything else."""
    if isinstance(value, bool) or not isinstance(value, (int, float)):
        raise ParameterError(f"{spec.name}: {_shown_value(value)} is not a number")
    try:
        number = float(value)
    except OverflowError:
        raise ParameterError(f"{spec.name}: the number is too large") from None
    if not math.isfinite(number):
        raise ParameterError(f"{spec.name}: {number} is not a finite number")
    if spec.type == "float64":
        return number
    if number != int(number):
        raise ParameterError(f"{spec.name}: {number:g} is not a whole number")
    return int(number)


def _shown_value(value: object) -> str:
    """Return a client's value for an error message, without the content of lists and objects."""
    if isinstance(value, (list, dict)):
        return "a list" if isinstance(value, list) else "an object"
    text = repr(value)
    return text if len(text) <= _MAX_SHOWN_CHARS else f"{text[:_MAX_SHOWN_CHARS]}…"
