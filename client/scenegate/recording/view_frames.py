"""Frames of the gateway's view, ``/view/ws``, and the joints in them.

A frame is a JSON header and arrays; ``gateway.adapters.viewer.frames`` writes it. The joints of robots are sliders of
the page (``ControlFolder.add_joint_sliders``), which are in frames of controls.
"""

import struct
from collections import Counter
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import DTypeLike, NDArray

MAGIC: Final = 0x31564753
"""The bytes "SGV1" as a little-endian integer."""
JOINT_UNITS: Final = ("rad", "m")
"""Units of the sliders of joints."""
_PREFIX: Final = struct.Struct("<II")


class ViewFrameError(ValueError):
    """A frame is invalid; the message is one sentence."""


class ViewFrame:
    """A frame that was received."""

    def __init__(self, data: bytes) -> None:
        """Raises ViewFrameError if there is no valid prefix or header, or the frame ends within its header."""
        magic, header_bytes = _PREFIX.unpack_from(data) if len(data) >= _PREFIX.size else (None, 0)
        if magic != MAGIC:
            raise ViewFrameError("not a frame of Scenegate's view: it does not start with SGV1")
        end = _PREFIX.size + header_bytes
        if end > len(data):
            raise ViewFrameError(f"a frame of {len(data)} bytes ends within its header of {header_bytes} bytes")
        try:
            self.header: dict[str, Any] = msgspec.json.decode(data[_PREFIX.size : end], type=dict[str, Any])
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise ViewFrameError(f"a frame's header is not a JSON object: {error}") from None
        self._body = memoryview(data)[end:]

    def array(self, reference: Any, dtype: DTypeLike) -> NDArray[Any]:
        """Return an array of the body, (N,), read-only. Raises ViewFrameError if it is not within the body.

        ``reference``: ``[offset, count]`` of the header: bytes from the start of the body, number of values.
        """
        try:
            offset, count = (int(number) for number in reference)
            return np.frombuffer(self._body, dtype, count, offset)
        except (TypeError, ValueError):
            raise ViewFrameError(f"a frame of {len(self._body)} bytes has no array at {reference!r}") from None


class Joints:
    """Joints of the page: the sliders in radians or metres, which have the joints' names.

    Joints of several robots that have the same name get those of their folders: ``left/elbow``, ``right/elbow``.
    """

    def __init__(self) -> None:
        self._names: dict[int, str] = {}
        """Names of joints by the ids of their sliders."""
        self._values: dict[int, float] = {}

    @property
    def values(self) -> dict[str, float]:
        """Values of all joints by name."""
        return {name: self._values[slider] for slider, name in self._names.items()}

    def apply(self, header: dict[str, Any]) -> bool:
        """Apply a header of controls; return True if it changes joints. Raises KeyError, TypeError or ValueError."""
        controls = header.get("controls")
        if controls is not None:
            sliders = [each for each in controls if each["type"] == "slider" and each.get("unit") in JOINT_UNITS]
            self._names = _joint_names({each["id"]: tuple(map(str, each["path"])) for each in sliders})
            self._values = {each["id"]: float(each["value"]) for each in sliders}
        changed = {slider: float(value) for slider, value in header["values"] if slider in self._names}
        self._values.update(changed)
        return bool(changed) or controls is not None


def _joint_names(paths: dict[int, tuple[str, ...]]) -> dict[int, str]:
    """Return the names of joints: the last element of a slider's path, or the whole path where that is not unique."""
    counts = Counter(path[-1] for path in paths.values())
    return {slider: path[-1] if counts[path[-1]] == 1 else "/".join(path) for slider, path in paths.items()}
