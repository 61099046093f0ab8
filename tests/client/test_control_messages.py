"""Controls in messages: defaults, and the sentences about invalid fields."""

from typing import Any

import msgspec
import numpy as np
import pytest

from scenegate.messages.controls import (
    AnyControl,
    Button,
    Checkbox,
    ColorInput,
    Control,
    Dropdown,
    Gizmo,
    NumberInput,
    Plot,
    Pose,
    Slider,
    TextInput,
    Value,
)

PATH = ("folder", "name")
SLIDER = Slider(PATH, -1.0, 2.0)
PLOT = Plot(PATH, ("a", "b"))
POSE = {"translation": [1, 2, 3], "quaternion": [1, 0, 0, 0]}


@pytest.mark.parametrize(
    ("control", "value"),
    [
        (Button(PATH), 0),
        (SLIDER, -1.0),
        (Slider(PATH, 0, 2, value=1), 1.0),
        (NumberInput(PATH), 0.0),
        (NumberInput(PATH, min=2.0), 2.0),
        (NumberInput(PATH, max=-2.0), -2.0),
        (TextInput(PATH), ""),
        (Checkbox(PATH), False),
        (Checkbox(PATH, value=True), True),
        (Dropdown(PATH, ("x", "y")), "x"),
        (Dropdown(PATH, ("x", "y"), value="y"), "y"),
        (ColorInput(PATH), (1.0, 1.0, 1.0)),
        (PLOT, None),
        (Gizmo(PATH, ("robot",)), None),
    ],
)
def test_values_at_first(control: Control, value: Value) -> None:
    assert control.initial == value
    assert type(control.initial) is type(value)
    assert msgspec.convert(msgspec.to_builtins(control), AnyControl) == control


@pytest.mark.parametrize(
    ("make", "reason"),
    [
        (lambda: Button(()), "path has 0 names, it must have 1 to 8"),
        (lambda: Button(("a",) * 9), "path has 9 names, it must have 1 to 8"),
        (lambda: Button(("x" * 101,)), f'path has 101 characters in "{"x" * 56}..., the limit is 100'),
        (lambda: Button(("\ud800",)), r"path is not Unicode text: '\ud800'"),
        (lambda: Slider(PATH, 1, 1), "min is 1, it must be below max, which is 1"),
        (lambda: Slider(PATH, 0, float("nan")), "max must be a number of at most 1e+15, not NaN"),
        (lambda: Slider(PATH, 0, 1, value=1.5), "value is 1.5, it must be from 0 to 1"),
        (lambda: Slider(PATH, 0, 1, step=0), "step is 0, it must be above 0 and at most 1e+15"),
        (lambda: Slider(PATH, 0, 1, unit="x" * 101), f'unit has 101 characters in "{"x" * 56}..., the limit is 100'),
        (lambda: NumberInput(PATH, min=2, max=1), "min is 2, it must not be above max, which is 1"),
        (lambda: NumberInput(PATH, 2, max=1), "value is 2, it must be from -1e+15 to 1"),
        (lambda: TextInput(PATH, value="x" * 1001), f'value has 1001 characters in "{"x" * 56}..., the limit is 1000'),
        (lambda: Dropdown(PATH, ()), "options has 0 texts, it must have 1 to 200"),
        (lambda: Dropdown(PATH, ("a", "a")), "options has a text twice"),
        (lambda: Dropdown(PATH, ("a", "b"), value="c"), 'value is "c", it must be one of the 2 options'),
        (lambda: ColorInput(PATH, value=(1, 2, 0)), "value is 2, it must be from 0 to 1"),
        (lambda: Plot(PATH, ("a",) * 11), "series has 11 texts, it must have 1 to 10"),
        (lambda: Plot(PATH, ("a",), seconds=0), "seconds is 0, it must be above 0 and at most 1e+15"),
        (lambda: Gizmo(PATH, ("a",) * 129), "node has 129 names, the limit is 128"),
    ],
)
def test_invalid_fields(make: Any, reason: str) -> None:
    with pytest.raises(ValueError) as error:  # noqa: PT011 - the text is compared
        make()
    assert str(error.value) == reason


@pytest.mark.parametrize(
    ("control", "value", "reason"),
    [
        (Button(PATH), -1, "value must be a number of clicks, 0 to 1e+15, not -1"),
        (SLIDER, True, "value must be a number of at most 1e+15, not true"),
        (SLIDER, 10**400, "value must be a number of at most 1e+15, not 1000"),
        pytest.param(SLIDER, 10**5000, "value must be a number of at most 1e+15, not <int>", id="long"),
        (TextInput(PATH), 3, "value must be a text, not 3"),
        (Checkbox(PATH), 1, "value must be true or false, not 1"),
        (Dropdown(PATH, ("a",)), ["a"], 'value is ["a"], it must be one of the 1 options'),
        (ColorInput(PATH), [1] * 50, "value must be 3 numbers from 0 to 1, not a list of 50"),
        (PLOT, 1, "1 cannot be set: the control has no value"),
        (Gizmo(PATH, ()), POSE | {"quaternion": [0] * 4}, "value has a quaternion of zeros"),
        (Gizmo(PATH, ()), POSE | {"translation": [1e16, 0, 0]}, "value must be a number of at most 1e+15, not 1e+16"),
        (Gizmo(PATH, ()), [1, 2], "value must be a translation and a quaternion, not [1, 2]"),
    ],
)
def test_invalid_values(control: Control, value: Any, reason: str) -> None:
    with pytest.raises(ValueError) as error:  # noqa: PT011 - the text is compared below
        control.checked(value)
    assert str(error.value).startswith(reason)


def test_values_are_converted() -> None:
    assert SLIDER.checked(1) == 1.0
    assert ColorInput(PATH).checked([0, 0.5, 1]) == (0.0, 0.5, 1.0)
    assert Gizmo(PATH, ()).checked(POSE) == Pose((1, 2, 3), (1, 0, 0, 0))


def test_samples() -> None:
    checked = PLOT.checked_samples(np.array([[0, 1, np.nan], [1, np.inf, -3e15]]))
    np.testing.assert_array_equal(checked, [[0, 1, np.nan], [1, np.nan, np.nan]])
    for samples, reason in (
        (np.zeros((3, 2)), r"rows of a time and 2 numbers, not of shape \(3, 2\)"),
        (np.zeros((2001, 3)), "samples has 2001 rows, the limit is 2000"),
        (np.full((2, 3), np.nan), "samples has the time nan, the limit is 1e[+]15 s"),
    ):
        with pytest.raises(ValueError, match=reason):
            PLOT.checked_samples(samples)
