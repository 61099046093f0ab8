"""Read the fields of commands: path and transform. ``scenegate.messages.field_kinds`` reads those of geometries.

Irregular values that known clients of Director send are accepted.
"""

from collections.abc import Mapping, Set
from typing import Any, Final, cast

import numpy as np
from numpy.typing import NDArray

from gateway.adapters.treeviewer.context import ReadContext
from gateway.scene.tree.nodes import Path, PathElement, Pose
from gateway.scene.tree.transforms import IDENTITY, from_pose
from scenegate.messages.field_kinds import MAX_DISTANCE, CommandError, NothingToDraw, numbers, show
from scenegate.warning_text import NOTHING_DRAWN

ZERO_TRANSLATION: Final = (0.0, 0.0, 0.0)
IDENTITY_QUATERNION: Final = (1.0, 0.0, 0.0, 0.0)
_POSE_NAMES: Final = frozenset(("translation", "quaternion"))
_INT64: Final = 2**63
_IDENTITY_POSE: Final = (*ZERO_TRANSLATION, *IDENTITY_QUATERNION)


def check_names(value: Mapping[Any, Any], known: Set[Any], name: str, warnings: list[str]) -> None:
    """Add a warning if an object of this name has fields that are not known."""
    if not value.keys() <= known:
        unknown = ", ".join(show(key) for key in value if key not in known)
        warnings.append(f"{name} has the unknown fields {unknown[:200]}; they are ignored")


def pose(value: Any, warnings: list[str], name: str = "transform") -> Pose:
    """Return the pose of a transform. Translation and quaternion are optional, and may be NaN or infinite."""
    if not isinstance(value, Mapping):
        raise CommandError(f"{name} must be an object with translation and quaternion, not {show(value)}")
    check_names(value, _POSE_NAMES, name, warnings)
    translation, quaternion = value.get("translation"), value.get("quaternion")
    xyz = ZERO_TRANSLATION if translation is None else numbers(translation, f"{name}.translation", 3)
    wxyz = IDENTITY_QUATERNION if quaternion is None else numbers(quaternion, f"{name}.quaternion", 4)
    return cast("Pose", xyz + wxyz)


def local_transform(params: Mapping[str, Any], warnings: list[str]) -> NDArray[np.float64]:
    """Return the transform from a geometry's frame to its path's, as ``matrix_of`` does."""
    value = params.get("transform")
    if value is None:
        return IDENTITY
    X_path_geometry = pose(value, warnings)
    if not all(abs(number) <= MAX_DISTANCE for number in X_path_geometry):
        raise NothingToDraw(f"transform is not finite, {NOTHING_DRAWN}")
    return matrix_of(X_path_geometry)


def matrix_of(X: Pose) -> NDArray[np.float64]:
    """Return a pose as a matrix, (4, 4); the object ``IDENTITY`` for the identity."""
    return IDENTITY if X == _IDENTITY_POSE else from_pose(X[:3], X[3:])


def is_unicode(text: str) -> bool:
    """Return False for text with a lone surrogate, as in the JSON ``"\\ud800"``: nothing that has it can be encoded."""
    try:
        text.encode()
    except UnicodeEncodeError:
        return False
    return True


def path(command: Mapping[str, Any], context: ReadContext) -> Path:
    """Return the command's path: a list of names, or a string that is split at slashes."""
    limits = context.limits
    if "path" not in command:
        raise CommandError("path is missing")
    value = command["path"]
    if isinstance(value, str):
        value = [name for name in value.split("/") if name]
    if not isinstance(value, list):
        raise CommandError(f"path must be a list of strings, not {show(value)}")
    if len(value) > limits.path_elements:
        raise CommandError(f"path has {len(value)} elements, the limit is {limits.path_elements}")
    return tuple(_path_element(element, index, limits.element_chars) for index, element in enumerate(value))


def _path_element(value: Any, index: int, max_chars: int) -> PathElement:
    """Return element ``index`` of a path: a string or an integer."""
    if isinstance(value, str):
        if len(value) > max_chars:
            raise CommandError(f"path[{index}] has {len(value)} characters, the limit is {max_chars}")
        if not is_unicode(value):
            raise CommandError(f"path[{index}] is not Unicode text: {show(value)}")
        return value
    if isinstance(value, int) and not isinstance(value, bool):
        if not -_INT64 <= value < 2 * _INT64:
            raise CommandError(f"path[{index}] is a number of more than 64 bits")
        return value
    raise CommandError(f"path[{index}] must be a string or an integer, not {show(value)}")
