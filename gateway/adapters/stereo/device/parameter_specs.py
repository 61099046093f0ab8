"""Parameters of the nodes of firmware 26.04.

Sources: the rc_visard's manual, and backups of real devices.
"""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from types import MappingProxyType
from typing import Final, Literal

from renderers.stereo.model import Quality

Value = float | int | bool | str
"""Value of a parameter."""
NO_EFFECT: Final = " (kept, but without effect on this synthetic camera)"
"""Suffix of the descriptions of parameters without effect."""


@dataclass(frozen=True, slots=True)
class Spec:
    """Specification of a parameter."""

    name: str
    type: Literal["float64", "int32", "bool", "string"]
    default: Value
    minimum: Value
    """Minimum; "" for strings, as on the device."""
    maximum: Value
    """Maximum; "" for strings."""
    description: str
    choices: tuple[str, ...] = ()
    """Allowed strings; empty: any."""
    aliases: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Other accepted spellings, and the choices that they mean."""


@dataclass(frozen=True, slots=True)
class DeviceLimits:
    """Limits and defaults of parameters that differ between camera models. Defaults are the rc_visard's."""

    fps: float = 25.0
    """Maximum rate of the camera images, Hz, and the default."""
    depth_range: tuple[float, float] = (0.1, 100.0)
    """Limits of ``mindepth`` and ``maxdepth``, and their defaults, metres."""
    quality: Quality = Quality.HIGH
    """Default of ``quality``."""
    out1_mode: str = "Low"
    """Default of ``out1_mode``."""
    depth_rates: Mapping[Quality, float] = field(
        default_factory=lambda: MappingProxyType({quality: quality.depth_rate for quality in Quality})
    )
    """Depth images per second, by quality."""


def _float(name: str, minimum: float, maximum: float, default: float, text: str) -> Spec:
    return Spec(name, "float64", float(default), float(minimum), float(maximum), text)


def _int(name: str, minimum: int, maximum: int, default: int, text: str) -> Spec:
    return Spec(name, "int32", default, minimum, maximum, text)


def _bool(name: str, default: bool, text: str) -> Spec:
    return Spec(name, "bool", default, False, True, text)


def _enum(
    name: str, choices: str, default: str, text: str, *, aliases: Mapping[str, str] = MappingProxyType({})
) -> Spec:
    """Return a specification of a string. ``choices`` are its allowed values, separated by ``|``."""
    names = tuple(choices.split("|"))
    return Spec(name, "string", default, "", "", f"{text}: {', '.join(names)}", names, aliases)


def _by_name(*specs: Spec) -> Mapping[str, Spec]:
    return MappingProxyType({spec.name: spec for spec in specs})


_OUT_MODES: Final = "Low|High|ExposureActive|ExposureAlternateActive"
_OUT_ALIASES: Final = MappingProxyType({"AlternateExposureActive": "ExposureAlternateActive"})
"""Spelling in the protocol document of the image stream, and the device's own spelling."""

NODES: Final[Mapping[str, Mapping[str, Spec]]] = MappingProxyType(
    {
        "rc_camera": _by_name(
            _float("fps", 1, 25, 25, "Frames per second of the camera images"),
            _enum("exp_control", "Auto|Manual|HDR", "Auto", "Exposure control"),
            _bool("exp_auto", True, "Automatic exposure (older name; false is exp_control Manual)"),
            _enum("exp_auto_mode", "Normal|Out1High|AdaptiveOut1", "Normal", "Automatic exposure mode"),
            _float("exp_max", 6.6e-5, 0.018, 0.018, "Longest exposure time of automatic exposure, seconds"),
            _float("exp_auto_average_max", 0, 1, 0.75, "Mean brightness that automatic exposure aims at"),
            _float(
                "exp_auto_average_min", 0, 1, 0.25, "Mean brightness that automatic exposure keeps despite saturation"
            ),
            _float("exp_value", 6.6e-5, 0.018, 0.005, "Exposure time in manual mode, seconds"),
            _float("gain_value", 0, 18, 0, "Gain in manual mode, decibel"),
            _float("gamma", 0.1, 10, 1, "Power of the light that images show: 1 is linear, lower values are brighter"),
            _int("exp_offset_x", 0, 8191, 0, "Left column of the region for automatic exposure"),
            _int("exp_offset_y", 0, 8191, 0, "Upper row of the region for automatic exposure"),
            _int("exp_width", 0, 8191, 0, "Width of the region for automatic exposure, 0 is all"),
            _int("exp_height", 0, 8191, 0, "Height of the region for automatic exposure, 0 is all"),
            _bool("wb_auto", True, "Automatic white balance"),
            _float("wb_ratio_red", 0.125, 8, 1.2, "Red to green ratio of the white balance"),
            _float("wb_ratio_blue", 0.125, 8, 2.4, "Blue to green ratio of the white balance"),
        ),
        "rc_stereomatching": _by_name(
            _enum("acquisition_mode", "Continuous|SingleFrame|SingleFrameOut1", "Continuous", "Depth acquisition"),
            _float("exposure_adapt_timeout", 0, 2, 0, "Longest wait for the exposure, seconds" + NO_EFFECT),
            _enum("quality", "Low|Medium|High|Full", "High", "Resolution of the depth images"),
            _bool("double_shot", False, "Fill holes from a second match"),
            _bool("static_scene", False, "Average eight images"),
            _int("seg", 0, 4000, 200, "Smallest segment that is kept, pixels at High"),
            _bool("smooth", True, "Smoothing of disparities" + NO_EFFECT),
            _int("fill", 0, 4, 3, "Largest disparity step on the border of holes that are filled, pixels"),
            _float("minconf", 0.5, 1, 0.5, "Smallest confidence that is kept"),
            _float("mindepth", 0.1, 100, 0.1, "Nearest depth, metres"),
            _float("maxdepth", 0.1, 100, 100, "Farthest depth, metres"),
            _float("maxdeptherr", 0.01, 100, 100, "Largest depth error that is kept, metres"),
            _int("roi_offset_x", 0, 8191, 0, "Left column of the depth region"),
            _int("roi_offset_y", 0, 8191, 0, "Upper row of the depth region"),
            _int("roi_width", 0, 8191, 0, "Width of the depth region, 0 is all"),
            _int("roi_height", 0, 8191, 0, "Height of the depth region, 0 is all"),
        ),
        "rc_iocontrol": _by_name(
            _enum(
                "out1_mode", _OUT_MODES, "Low", "Output 1, which the projector is connected to", aliases=_OUT_ALIASES
            ),
            _enum("out2_mode", _OUT_MODES, "Low", "Output 2", aliases=_OUT_ALIASES),
        ),
        "rc_measure": {},
    }
)
"""Specifications by node and name."""

NODE_ALIASES: Final[Mapping[str, str]] = MappingProxyType({"rc_stereocamera": "rc_camera"})
"""Names of nodes up to firmware 20, and their current names."""


def specs_of(limits: DeviceLimits) -> Mapping[str, Mapping[str, Spec]]:
    """Return ``NODES`` with the limits and defaults of a camera model."""
    nearest, farthest = limits.depth_range
    changes: Mapping[str, Mapping[str, Mapping[str, Value]]] = {
        "rc_camera": {"fps": {"maximum": limits.fps, "default": limits.fps}},
        "rc_stereomatching": {
            "quality": {"default": limits.quality.value},
            "mindepth": {"minimum": nearest, "maximum": farthest, "default": nearest},
            "maxdepth": {"minimum": nearest, "maximum": farthest, "default": farthest},
        },
        "rc_iocontrol": {"out1_mode": {"default": limits.out1_mode}},
    }
    # Keywords from a mapping have one type for all fields, so mypy cannot check them.
    return {
        node: {name: replace(spec, **changes.get(node, {}).get(name, {})) for name, spec in specs.items()}  # type: ignore[arg-type]
        for node, specs in NODES.items()
    }
