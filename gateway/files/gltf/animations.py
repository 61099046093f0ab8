"""Poses the nodes of a document as one of its animations does at a time: transforms and weights of morph targets."""

from dataclasses import dataclass
from typing import Any, Final

import msgspec
import numpy as np
from numpy.typing import NDArray

from gateway.files.gltf import schema
from gateway.files.gltf.accessors import Accessors
from gateway.files.gltf.gltf_errors import GltfError, as_warning, checked_item

_COMPONENTS: Final = {"translation": 3, "rotation": 4, "scale": 3, "weights": 0}
"""Number of components by the path of a channel; 0: as many as the accessor has for a key."""
_IGNORED: Final = "the channel is ignored"


@dataclass(frozen=True, slots=True)
class AnimationTime:
    """An animation, and a time in it."""

    animation: str | int
    """Name or index."""
    seconds: float
    """Time since the start of the animation, which is repeated after its end."""


def pose_nodes(document: schema.Document, accessors: Accessors, time: AnimationTime, warnings: list[str]) -> None:
    """Replace animated properties of nodes; invalid channels add a warning. Raises GltfError without animation."""
    index = _index_of(document, time.animation)
    animation = checked_item(document.animations, index, "animations", "animation")
    channels: list[tuple[int, str, schema.AnimationSampler, NDArray[np.float32], str]] = []
    for number, channel in enumerate(animation.channels or ()):
        path = f"animations[{index}].channels[{number}]"
        with as_warning(warnings, _IGNORED):
            target = None if channel is None else channel.target
            if channel is None or target is None or target.path is None or target.path not in _COMPONENTS:
                raise GltfError(f"{path}.target: it is not the {', '.join(_COMPONENTS)} of a node")
            if target.node is None:
                raise GltfError(f"{path}.target.node: missing")
            sampler = checked_item(animation.samplers, channel.sampler, "samplers", f"{path}.sampler")
            times = accessors.get(-1 if sampler.input is None else sampler.input, f"{path}.input").floats()[:, 0]
            if not len(times) or not np.isfinite(times).all() or (np.diff(times) < 0.0).any():
                raise GltfError(f"{path}: its times are not ascending numbers")
            channels.append((target.node, target.path, sampler, times, path))
    duration = max((float(times[-1]) for _, _, _, times, _ in channels), default=0.0)
    seconds = time.seconds % duration if time.seconds > duration > 0.0 else time.seconds
    nodes = document.nodes or []
    for node_index, name, sampler, times, path in channels:
        with as_warning(warnings, _IGNORED):
            posed: dict[str, Any] = {name: _sample(sampler, times, seconds, name, accessors, path).tolist()}
            if name != "weights":
                posed["matrix"] = None
            node = checked_item(nodes, node_index, "nodes", f"{path}.target.node")
            nodes[node_index] = msgspec.structs.replace(node, **posed)


def _index_of(document: schema.Document, animation: str | int) -> int:
    names = [getattr(each, "name", None) for each in document.animations or ()]
    if isinstance(animation, int) and animation < len(names):
        return animation
    if animation in names:
        return names.index(animation)
    known = ", ".join(str(index if name is None else name) for index, name in enumerate(names)) or "none"
    raise GltfError(f"animations: there is no {animation!r}; there are: {known}")


def _sample(
    sampler: schema.AnimationSampler,
    times: NDArray[np.float32],
    seconds: float,
    name: str,
    accessors: Accessors,
    path: str,
) -> NDArray[np.float64]:
    """Return the value of a channel, (components,) float64, by the interpolation of its sampler (glTF 2.0, appendix C).

    Raises GltfError if the output has the wrong size or numbers that are not finite.
    """
    output = accessors.get(-1 if sampler.output is None else sampler.output, f"{path}.output").floats()
    is_cubic = sampler.interpolation == "CUBICSPLINE"
    rows = len(times) * (3 if is_cubic else 1)
    components = _COMPONENTS[name] or output.size // rows
    if output.size != rows * components or not components or not np.isfinite(output).all():
        raise GltfError(f"{path}.output: it has not {rows} finite values of {components or 'some'} components")
    values = output.astype(np.float64).reshape(len(times), -1, components)  # one, or in-tangent, value, out-tangent
    first = int(np.clip(np.searchsorted(times, seconds, side="right") - 1, 0, max(len(times) - 2, 0)))
    last = min(first + 1, len(times) - 1)
    interval = float(times[last] - times[first])
    t = min(max((seconds - float(times[first])) / interval, 0.0), 1.0) if interval > 0.0 else 0.0
    column = 1 if is_cubic else 0
    begin: NDArray[np.float64] = values[first, column]
    end: NDArray[np.float64] = values[last, column]
    if sampler.interpolation == "STEP":
        return end if t == 1.0 else begin
    if is_cubic:
        out_tangent, in_tangent = interval * values[first, 2], interval * values[last, 0]
        result = (2 * t**3 - 3 * t**2 + 1) * begin + (t**3 - 2 * t**2 + t) * out_tangent
        result += (3 * t**2 - 2 * t**3) * end + (t**3 - t**2) * in_tangent
    else:
        result = slerp(begin, end, t) if name == "rotation" else begin + t * (end - begin)
    if name == "rotation" and result.any():
        result = result / np.linalg.norm(result)
    return np.asarray(result)


def slerp(begin: NDArray[np.float64], end: NDArray[np.float64], t: float) -> NDArray[np.float64]:
    """Return the quaternion at the share ``t`` of the shorter way between two unit quaternions."""
    cosine = float(begin @ end)
    if cosine < 0.0:
        end, cosine = -end, -cosine
    if cosine > 0.9995:  # a straight line differs by less than 1e-7
        return begin + t * (end - begin)
    angle = float(np.arccos(min(cosine, 1.0)))
    return np.asarray((np.sin((1.0 - t) * angle) * begin + np.sin(t * angle) * end) / np.sin(angle))
