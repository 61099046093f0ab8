"""Content of the device's REST interface as plain values: nodes, status values, services and system information."""

import time
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import msgspec

from gateway.adapters.stereo.device.parameter_specs import NODES
from gateway.adapters.stereo.device.timestamps import NANOSECONDS_PER_SECOND, timestamp_text
from gateway.adapters.stereo.imaging.depth_measurement import MeasureArguments
from gateway.adapters.stereo.imaging.recorded_pairs import PairImaging
from gateway.adapters.stereo.service import StereoService
from gateway.adapters.stereo.stream.image_messages import INPUT_MASK, OUTPUT_MASK

IMAGE_VERSION: Final = "26.04.0"
"""Emulated firmware version. Clients parse its three components."""
SERVICES: Final[Mapping[str, Mapping[str, str]]] = {
    "rc_camera": {"reset_defaults": "Restores the default values of the parameters"},
    "rc_stereomatching": {
        "acquisition_trigger": "Takes one depth image in acquisition mode SingleFrame or SingleFrameOut1",
        "reset_defaults": "Restores the default values of the parameters",
    },
    "rc_iocontrol": {
        "get_io_values": "Values of the general purpose inputs and outputs",
        "reset_defaults": "Restores the default values of the parameters",
    },
    "rc_measure": {"measure_depth": "Measures mean, minimum and maximum depth in a region and its cells"},
}
"""Descriptions of services, by node and name."""

COMPONENTS: Final = {"hand_eye_calibration": False, "rectification": True, "stereo": True}
"""Modules of the license: those that there are."""
_POINT: Final = dict.fromkeys("xyz", "float64")
MEASURE_ARGUMENTS: Final[Mapping[str, Any]] = {
    "cell_count": {"x": "uint32", "y": "uint32"},
    "data_acquisition_mode": "string",
    "pose_frame": "string",
    "region_of_interest_2d": dict.fromkeys(("height", "offset_x", "offset_y", "width"), "uint32"),
    "region_of_interest_2d_id": "string",
    "robot_pose": {"orientation": {"w": "float64", **_POINT}, "position": _POINT},
}
"""Types of the arguments of ``measure_depth``, as the device describes them."""


def node_info(node: str) -> dict[str, Any]:
    """Return the device's NodeInfo."""
    return {"name": node, "parameters": list(NODES[node]), "services": list(SERVICES[node]), "status": "running"}


def service_info(node: str, name: str) -> dict[str, Any]:
    """Return the device's description of a service."""
    arguments = MEASURE_ARGUMENTS if name == "measure_depth" else {}
    return {"name": name, "description": SERVICES[node][name], "args": arguments, "response": {}}


def node_status(service: StereoService, node: str) -> dict[str, Any]:
    """Return the device's NodeStatus. All values are strings."""
    read_values = {
        "rc_camera": _camera_status,
        "rc_stereomatching": _matching_status,
        "rc_iocontrol": _io_status,
        "rc_measure": _measure_status,
    }[node]
    values = {
        name: f"{value:.9g}" if isinstance(value, float) else str(value) for name, value in read_values(service).items()
    }
    return {"status": "running", "timestamp": service.time, "values": values}


async def call_service(service: StereoService, node: str, name: str, arguments: dict[str, Any]) -> dict[str, Any]:
    """Call a service and return the device's response. Raises QueueFull."""
    if name == "measure_depth":
        return {"name": name, "response": await _measure(service, arguments)}
    actions: dict[str, Callable[[], dict[str, Any]]] = {
        "reset_defaults": lambda: _reset(service, node),
        "acquisition_trigger": lambda: {"return_code": _return_code(*service.fire_trigger())},
        "get_io_values": lambda: _io_values(service),
    }
    return {"name": name, "response": actions[name]()}


def system_info(services: Sequence[StereoService]) -> dict[str, Any]:
    """Return the device's SysInfo. Values that exist only once are those of the first pipeline."""
    service = services[0]
    config = service.config
    address = config.host if config.host not in ("0.0.0.0", "::") else "127.0.0.1"  # noqa: S104 - a comparison
    version = {"image_version": IMAGE_VERSION}
    return {
        "ready": service.ready,
        "time": service.time,
        "uptime": time.time() - service.started,
        "serial": config.serial,
        "hostname": config.hostname,
        "mac": "00:14:2d:00:00:00",
        "model_name": config.model.name,
        "firmware": {
            "active_image": version,
            "inactive_image": version,
            "fallback_booted": False,
            "next_boot_image": "active_image",
        },
        "link_speed": 1000,
        "dns": {"dns_servers": [], "manual_dns_servers": []},
        "network": {
            "current_method": "DHCP",
            "default_gateway": "",
            "ip_address": address,
            "settings": {
                "dhcp_enabled": True,
                "persistent_default_gateway": "",
                "persistent_ip_address": "",
                "persistent_ip_enabled": False,
                "persistent_subnet_mask": "",
            },
            "subnet_mask": "255.0.0.0",
        },
        "ntp": {
            "enabled": False,
            "manual_ntp_servers": [],
            "offset": 0.0,
            "selected_ntp_servers": [],
            "synchronized": False,
        },
        "ntp_status": {"accuracy": "", "synchronized": False},
        "ptp_status": {"master_ip": "", "offset": 0.0, "offset_dev": 0.0, "offset_mean": 0.0, "state": "off"},
        "ui_lock": {"enabled": False},
        "pipelines": {
            "config": {"max_pipelines": len(services), "pending_changes": False, "pipelines": pipelines(services)}
        },
    }


def pipelines(services: Sequence[StereoService]) -> dict[str, Any]:
    """Return all pipelines by number."""
    return {str(number): _pipeline(service) for number, service in enumerate(services)}


def _pipeline(service: StereoService) -> dict[str, Any]:
    return {"type": "rc_visard", "model_name": service.config.model.name, "ready": service.ready}


def _camera_status(service: StereoService) -> dict[str, object]:
    model, settings, metered = service.config.model, service.settings, service.last_metered
    return {
        "exp": metered.exposure.time,
        "gain": metered.exposure.gain,
        "gamma": metered.exposure.gamma,
        "brightness": round(metered.brightness, 2),
        "noise": metered.exposure.mid_grey_noise * service.config.noise_factor,
        "out1_reduction": metered.out1_reduction,
        "fps": settings.camera_rate if len(service.hub) else 0.0,
        "time": service.counts.camera_seconds,
        "width": model.width,
        "height": model.height,
        "focal": round(model.focal_factor, 6),
        "baseline": round(model.baseline, 6),
        "color": int(service.config.color),
        "temp_left": 35.0,
        "temp_right": 35.0,
        "test": int(isinstance(service.imaging, PairImaging)),
        "params_override_active": 0,
        "selfcalib_counter": 0,
        "selfcalib_offset": 0.0,
    }


def _matching_status(service: StereoService) -> dict[str, object]:
    settings, model, counts = service.settings, service.config.model, service.counts
    divisor, filters = settings.quality.divisor, settings.filters
    intrinsics = model.intrinsics(divisor)
    subscribed = any(kind.has_depth for kind in service.hub.kinds)
    return {
        "fps": settings.depth_rate if subscribed and not settings.single_frame else 0.0,
        "latency": counts.depth_seconds,
        "time_matching": counts.depth_seconds,
        "time_postprocessing": 0.0,
        "width": intrinsics.width,
        "height": intrinsics.height,
        "mindepth": model.nearest_depth(filters.mindepth, filters.maxdepth, divisor),
        "maxdepth": filters.maxdepth,
        "reduced_depth_range": int(model.has_reduced_range(filters.mindepth, filters.maxdepth, divisor)),
    }


def _io_status(service: StereoService) -> dict[str, object]:
    gpio = service.settings.camera_gpio
    return {"out1": gpio & 1, "out2": gpio >> 1 & 1, "in1": 0, "in2": 0}


def _measure_status(service: StereoService) -> dict[str, object]:
    measured = service.measured
    return {
        "data_acquisition_time": measured.acquisition_seconds if measured is not None else 0.0,
        "last_timestamp_processed": timestamp_text(measured.timestamp) if measured is not None else "0",
        "processing_time": measured.processing_seconds if measured is not None else 0.0,
    }


async def _measure(service: StereoService, arguments: dict[str, Any]) -> dict[str, Any]:
    try:
        response = await service.measure_depth(msgspec.convert(arguments, MeasureArguments))
    except ValueError as error:  # msgspec's, too
        return {"return_code": _return_code(-1, str(error).replace("`$.", "`"))}
    return {**response, "return_code": _return_code(0, "")}


def _io_values(service: StereoService) -> dict[str, Any]:
    sec, nsec = divmod(round(service.time * NANOSECONDS_PER_SECOND), NANOSECONDS_PER_SECOND)
    return {
        "timestamp": {"sec": sec, "nsec": nsec},
        "values": service.settings.camera_gpio,
        "input_mask": INPUT_MASK,
        "output_mask": OUTPUT_MASK,
        "inverter_mask": 0,
        "ratio_mask": 0,
        "return_code": _return_code(0, ""),
    }


def _reset(service: StereoService, node: str) -> dict[str, Any]:
    service.parameters.reset(node)
    return {"return_code": _return_code(0, "")}


def _return_code(value: int, message: str) -> dict[str, Any]:
    return {"value": value, "message": message}
