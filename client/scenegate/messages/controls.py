"""Controls that a program shows in the page: one class for each type, for client and server.

A command ``setcontrols`` has them as objects, with the type's name as ``type``. A ``value`` of None is the default of
the type. Invalid fields raise ValueError, which names the field, its value and the limit.
"""

from typing import Any, ClassVar, Final, TypeAlias

import msgspec
import numpy as np
from numpy.typing import NDArray

from scenegate.messages.changes import Path
from scenegate.messages.field_kinds import show

MAX_DEPTH: Final = 8
"""Maximum number of names in a control's path: folders are nested on the page."""
MAX_NODE_DEPTH: Final = 128
"""Maximum number of names in the path of a gizmo's node, as of all nodes."""
MAX_NAME_CHARS: Final = 100
"""Maximum number of characters in a name, a unit, an option of a menu or the name of a curve: the panel is narrow."""
MAX_TEXT_CHARS: Final = 1000
"""Maximum number of characters in a text: it has one line."""
MAX_OPTIONS: Final = 200
"""Maximum number of options in a menu: people search in it."""
MAX_SERIES: Final = 10
"""Maximum number of curves in a plot: more colours cannot be told apart."""
MAX_SAMPLES: Final = 2000
"""Maximum number of samples that a plot keeps: a screen has about as many pixels. Older ones are dropped."""
MAX_NUMBER: Final = 1e15
"""Maximum absolute value of a number: larger ones have no digits after the point."""


class Pose(msgspec.Struct, frozen=True):
    """A rigid transform, as in ``settransform``."""

    translation: tuple[float, float, float]
    """Metres."""
    quaternion: tuple[float, float, float, float]
    """[w, x, y, z]."""


Value: TypeAlias = bool | int | float | str | tuple[float, float, float] | Pose | None
"""Value of a control, by its type: see ``checked``."""


class Control(msgspec.Struct, frozen=True, tag_field="type", omit_defaults=True):
    """Base class."""

    path: Path
    """Names of the folders, and the control's own name."""
    default: ClassVar[Value] = None

    def __post_init__(self) -> None:
        if not 1 <= len(self.path) <= MAX_DEPTH:
            raise ValueError(f"path has {len(self.path)} names, it must have 1 to {MAX_DEPTH}")
        for name in _names(self.path, "path"):
            check_length(str(name), "path")
        value = getattr(self, "value", None)
        if value is not None:
            self.checked(value)

    @property
    def initial(self) -> Value:
        """The value at first."""
        value = getattr(self, "value", None)
        return self.default if value is None else self.checked(value)

    def checked(self, value: Any) -> Value:
        """Return a value as it is stored. Raises ValueError if the control cannot have it."""
        raise ValueError(f"{show(value)} cannot be set: the control has no value")


class Button(Control, frozen=True, tag="button"):
    """A button. Its value is the number of clicks."""

    value: int | None = None
    default = 0

    def checked(self, value: Any) -> int:
        """See ``Control``."""
        if type(value) is not int or not 0 <= value <= MAX_NUMBER:
            raise ValueError(f"value must be a number of clicks, 0 to {MAX_NUMBER:g}, not {show(value)}")
        return value


class Slider(Control, frozen=True, tag="slider"):
    """A slider. Its value is a number."""

    min: float
    max: float
    value: float | None = None
    """Default: ``min``."""
    step: float | None = None
    """Distance between the values of the slider; None: any value."""
    unit: str = ""

    def __post_init__(self) -> None:
        low, high = number(self.min, "min"), number(self.max, "max")
        if not low < high:
            raise ValueError(f"min is {low:g}, it must be below max, which is {high:g}")
        _check_step(self.step)
        check_length(self.unit, "unit")
        Control.__post_init__(self)

    @property
    def initial(self) -> float:
        """The value at first."""
        return self.min if self.value is None else float(self.value)

    def checked(self, value: Any) -> float:
        """See ``Control``."""
        return _within(value, self.min, self.max)


class NumberInput(Control, frozen=True, tag="number"):
    """A field for a number."""

    value: float | None = None
    min: float | None = None
    max: float | None = None
    step: float | None = None
    """Distance between the values that the arrow keys reach; None: 1."""
    unit: str = ""

    def __post_init__(self) -> None:
        low, high = self._limits
        if not low <= high:
            raise ValueError(f"min is {low:g}, it must not be above max, which is {high:g}")
        _check_step(self.step)
        check_length(self.unit, "unit")
        Control.__post_init__(self)

    @property
    def initial(self) -> float:
        """The value at first; by default 0, or the limit next to it."""
        low, high = self._limits
        return min(max(0.0, low), high) if self.value is None else float(self.value)

    @property
    def _limits(self) -> tuple[float, float]:
        low = -MAX_NUMBER if self.min is None else number(self.min, "min")
        return low, MAX_NUMBER if self.max is None else number(self.max, "max")

    def checked(self, value: Any) -> float:
        """See ``Control``."""
        return _within(value, *self._limits)


class TextInput(Control, frozen=True, tag="text"):
    """A field for a line of text."""

    value: str | None = None
    default = ""

    def checked(self, value: Any) -> str:
        """See ``Control``."""
        if not isinstance(value, str):
            raise ValueError(f"value must be a text, not {show(value)}")
        return check_length(value, "value", MAX_TEXT_CHARS)


class Checkbox(Control, frozen=True, tag="checkbox"):
    """A check box. Its value is true or false."""

    value: bool | None = None
    default = False

    def checked(self, value: Any) -> bool:
        """See ``Control``."""
        if not isinstance(value, bool):
            raise ValueError(f"value must be true or false, not {show(value)}")
        return value


class Dropdown(Control, frozen=True, tag="dropdown"):
    """A menu. Its value is one of the options."""

    options: tuple[str, ...]
    value: str | None = None
    """Default: the first option."""

    def __post_init__(self) -> None:
        _check_texts(self.options, "options", MAX_OPTIONS)
        if len(set(self.options)) < len(self.options):
            raise ValueError("options has a text twice")
        Control.__post_init__(self)

    @property
    def initial(self) -> str:
        """The value at first."""
        return self.options[0] if self.value is None else self.value

    def checked(self, value: Any) -> str:
        """See ``Control``."""
        if value not in self.options:
            raise ValueError(f"value is {show(value)}, it must be one of the {len(self.options)} options")
        return str(value)


class ColorInput(Control, frozen=True, tag="color"):
    """A colour: red, green and blue, sRGB from 0 to 1."""

    value: tuple[float, float, float] | None = None
    default = (1.0, 1.0, 1.0)

    def checked(self, value: Any) -> tuple[float, float, float]:
        """See ``Control``."""
        if not isinstance(value, (list, tuple)) or len(value) != 3:
            raise ValueError(f"value must be 3 numbers from 0 to 1, not {show(value)}")
        red, green, blue = (_within(channel, 0.0, 1.0) for channel in value)
        return red, green, blue


class Plot(Control, frozen=True, tag="plot"):
    """Curves of values over time. It has samples in place of a value."""

    series: tuple[str, ...]
    """Names of the curves."""
    seconds: float = 30.0
    """Length of the time axis."""
    unit: str = ""

    def __post_init__(self) -> None:
        _check_texts(self.series, "series", MAX_SERIES)
        if not 0.0 < number(self.seconds, "seconds") <= MAX_NUMBER:
            raise ValueError(f"seconds is {self.seconds:g}, it must be above 0 and at most {MAX_NUMBER:g}")
        check_length(self.unit, "unit")
        Control.__post_init__(self)

    def checked_samples(self, samples: NDArray[np.float64]) -> NDArray[np.float64]:
        """Return samples, (N, 1 + curves): time in seconds and a value for each curve. NaN makes a gap.

        Raises ValueError for a wrong shape, more than ``MAX_SAMPLES``, or a time that is not finite.
        """
        count = 1 + len(self.series)
        if samples.ndim != 2 or samples.shape[1] != count:
            raise ValueError(f"samples must be rows of a time and {count - 1} numbers, not of shape {samples.shape}")
        if len(samples) > MAX_SAMPLES:
            raise ValueError(f"samples has {len(samples)} rows, the limit is {MAX_SAMPLES}")
        for time in samples[~(np.abs(samples[:, 0]) <= MAX_NUMBER), 0][:1].tolist():
            raise ValueError(f"samples has the time {time:g}, the limit is {MAX_NUMBER:g} s")
        return np.where(np.abs(samples) <= MAX_NUMBER, samples, np.nan)


class Gizmo(Control, frozen=True, tag="gizmo"):
    """Handles in the view that move and turn a node. Its value is the node's pose after a drag; None before."""

    node: Path
    """Path of the node in the tree."""

    def __post_init__(self) -> None:
        _names(self.node, "node")
        if len(self.node) > MAX_NODE_DEPTH:
            raise ValueError(f"node has {len(self.node)} names, the limit is {MAX_NODE_DEPTH}")
        Control.__post_init__(self)

    def checked(self, value: Any) -> Pose:
        """See ``Control``."""
        try:
            pose = value if isinstance(value, Pose) else msgspec.convert(value, Pose)
        except msgspec.ValidationError:
            raise ValueError(f"value must be a translation and a quaternion, not {show(value)}") from None
        for each in (*pose.translation, *pose.quaternion):
            number(each, "value")
        if not any(pose.quaternion):
            raise ValueError("value has a quaternion of zeros")
        return pose


AnyControl: TypeAlias = Button | Slider | NumberInput | TextInput | Checkbox | Dropdown | ColorInput | Plot | Gizmo


def number(value: Any, name: str) -> float:
    """Return a number as float. Raises ValueError if it is no number, not finite or beyond ``MAX_NUMBER``."""
    if isinstance(value, bool) or not isinstance(value, (int, float)) or not abs(value) <= MAX_NUMBER:
        raise ValueError(f"{name} must be a number of at most {MAX_NUMBER:g}, not {show(value)}")
    return float(value)


def check_length(text: str, name: str, limit: int = MAX_NAME_CHARS) -> str:
    """Return a text. Raises ValueError if it is none, longer than the limit, or no valid Unicode."""
    if not isinstance(text, str):
        raise ValueError(f"{name} must be a text, not {show(text)}")
    if len(text) > limit:
        raise ValueError(f"{name} has {len(text)} characters in {show(text)}, the limit is {limit}")
    try:
        text.encode()
    except UnicodeEncodeError:
        raise ValueError(f"{name} is not Unicode text: {ascii(text)[:60]}") from None
    return text


def _within(value: Any, low: float, high: float) -> float:
    result = number(value, "value")
    if not low <= result <= high:
        raise ValueError(f"value is {result:g}, it must be from {low:g} to {high:g}")
    return result


def _names(path: Path, field: str) -> Path:
    """Return a path. Raises ValueError if a name in it is no text and no integer."""
    for name in path:
        if isinstance(name, bool) or not isinstance(name, (str, int)):
            raise ValueError(f"{field} has the name {show(name)}; names are texts or integers")
    return path


def _check_texts(texts: tuple[str, ...], name: str, limit: int) -> None:
    if not isinstance(texts, tuple):
        raise ValueError(f"{name} must be a list of texts, not {show(texts)}")
    if not 1 <= len(texts) <= limit:
        raise ValueError(f"{name} has {len(texts)} texts, it must have 1 to {limit}")
    for text in texts:
        check_length(text, name)


def _check_step(step: float | None) -> None:
    if step is not None and not 0.0 < number(step, "step") <= MAX_NUMBER:
        raise ValueError(f"step is {step:g}, it must be above 0 and at most {MAX_NUMBER:g}")
