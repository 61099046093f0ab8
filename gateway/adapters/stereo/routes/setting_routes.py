"""The device's routes for its settings: backup, UI lock, time and reboot, and what the computer decides here."""

import time
from calendar import timegm
from collections.abc import Sequence
from functools import partial
from typing import Annotated, Any, Final

import msgspec
from fastapi import APIRouter, Query, Request
from fastapi.responses import Response

from gateway.adapters.stereo.device.parameter_specs import NODES
from gateway.adapters.stereo.device.parameters import ParameterError, UnknownParameterError, check_value
from gateway.adapters.stereo.routes import device_content as device
from gateway.adapters.stereo.routes.node_routes import MAX_BODY, decode, wait_until_stored
from gateway.adapters.stereo.routes.rest_common import RestError, error_response, error_responses, read_body
from gateway.adapters.stereo.service import StereoService
from gateway.runtime.http.openapi import example, json_example

TIME_FORMAT: Final = "%Y-%m-%d %H:%M:%S"
_UTC: Final = {"utc": "2026-01-31 12:00:00"}
_RETURN_CODE: Final = {"return_code": {"value": 0, "message": ""}}
_NO_DATABASES: Final[dict[str, list[Any]]] = {"load_carriers": [], "regions_of_interest": [], "grippers": []}
"""Parts of a backup that belong to modules which this camera does not have."""
_BACKUP: Final = {
    "pipelines": {"0": {"type": "rc_visard", "nodes": {"rc_camera": {"parameters": {"fps": 25.0}}}}},
    **_NO_DATABASES,
}
_REFUSED: Final = {
    ("PUT", "dns"): (403, "the DNS servers are those of the computer"),
    ("PUT", "ntp"): (403, "the computer keeps its own time; PUT …/system/time sets the camera's"),
    ("PUT", "network/settings"): (403, "the network settings are those of the computer"),
    ("PUT", "rollback"): (400, "there is no other firmware image to go back to"),
    ("POST", "license"): (400, "not a valid license: none is needed"),
    ("POST", "update"): (400, "not a valid artifact: a new version is installed with pip"),
}
"""Changes that are refused: status and sentence, by method and path."""
Wanted = Annotated[bool, Query(openapi_examples=example(True))]


class _NodeBackup(msgspec.Struct):
    parameters: dict[str, Any] = {}


class _PipelineBackup(msgspec.Struct):
    nodes: dict[str, _NodeBackup] = {}


class _Backup(msgspec.Struct):
    """Parts of a backup that can be restored."""

    pipelines: dict[str, _PipelineBackup] = {}


class UILock:
    """Password of the device's web page, as a hash. Nothing here is locked by it."""

    def __init__(self) -> None:
        self.hash = ""
        """Empty: there is no lock."""


def add_setting_routes(routes: APIRouter, base: str, services: Sequence[StereoService], lock: UILock) -> None:
    """Add the routes below ``base``, the path of the system."""
    _add_computer_routes(routes, base, services, lock)
    _add_lock_routes(routes, base, lock)
    _add_time_routes(routes, base, services)
    _add_backup_routes(routes, base, services)


def _add_computer_routes(routes: APIRouter, base: str, services: Sequence[StereoService], lock: UILock) -> None:
    """Add the routes that show and refuse to change what the computer decides."""
    info = partial(device.system_info, services)
    shown: dict[str, Any] = {
        "dns": lambda: {"dns": info()["dns"]},
        "ntp": lambda: {"ntp": info()["ntp"]},
        "network": lambda: info()["network"],
        "network/settings": lambda: info()["network"]["settings"],
        "rollback": lambda: info()["firmware"],
        "update": lambda: info()["firmware"],
        "license": lambda: {"components": device.COMPONENTS, "valid": True},
        "ui_lock": lambda: {"enabled": bool(lock.hash)},
    }

    async def show(name: str) -> Any:
        return shown[name]()

    async def refuse(method: str, name: str) -> Response:
        return error_response(*_REFUSED[method, name])

    for name in shown:
        routes.get(f"{base}/{name}", summary=f"System: {name}", description="", responses=json_example(shown[name]()))(
            partial(show, name)
        )
    for (method, name), (status, sentence) in _REFUSED.items():
        routes.api_route(
            f"{base}/{name}",
            methods=[method],
            response_class=Response,
            summary=f"Refused: {sentence}",
            description="",
            responses=error_responses({status: f"Always: {sentence}."}),
        )(partial(refuse, method, name))


def _add_lock_routes(routes: APIRouter, base: str, lock: UILock) -> None:
    @routes.post(
        f"{base}/ui_lock", summary="Verify or set the UI lock", responses=json_example({"enabled": True, "valid": True})
    )
    async def set_lock(
        # The device's name of the parameter.
        hash: Annotated[str, Query(max_length=200, openapi_examples=example("5f4dcc3b5aa765d6"))],  # noqa: A002
        set: Annotated[bool, Query(openapi_examples=example(True))] = False,  # noqa: A002 - the device's names
    ) -> Any:
        lock.hash = hash if set else lock.hash
        return {"enabled": bool(lock.hash), "valid": bool(hash) and hash == lock.hash}

    @routes.delete(
        f"{base}/ui_lock", summary="Remove the UI lock", responses=json_example({"enabled": False, "valid": False})
    )
    async def remove_lock() -> Any:
        lock.hash = ""
        return {"enabled": False, "valid": False}


def _add_time_routes(routes: APIRouter, base: str, services: Sequence[StereoService]) -> None:
    """Add time and reboot."""

    @routes.get(f"{base}/time", summary="System time in UTC", responses=json_example(_UTC))
    async def system_time() -> Any:
        return {"utc": time.strftime(TIME_FORMAT, time.gmtime(services[0].time))}

    @routes.put(
        f"{base}/time",
        summary="Set the cameras' time, in UTC: timestamps have it from now on",
        responses=json_example(_UTC)
        | error_responses({400: "The time is not like the example.", 403: "The time is simulated (--clock)."}),
    )
    async def set_time(utc: Annotated[str, Query(openapi_examples=example(_UTC["utc"]))] = "") -> Any:
        if any(service.config.simulated_clock for service in services):
            raise RestError(403, "the time is simulated (--clock simulated)")
        try:
            seconds = timegm(time.strptime(utc, TIME_FORMAT))
        except (ValueError, OverflowError):
            seconds = -1
        if seconds < 0:
            raise RestError(400, f"utc: {utc[:40]!r} is not like {_UTC['utc']!r}, from 1970 on")
        for service in services:
            service.time = seconds
        return await system_time()

    @routes.put(f"{base}/reboot", summary="End all streams and begin anew", responses=json_example(_RETURN_CODE))
    async def reboot() -> Any:
        for service in services:
            service.reboot()
        return _RETURN_CODE


def _add_backup_routes(routes: APIRouter, base: str, services: Sequence[StereoService]) -> None:
    @routes.get(f"{base}/backup", summary="Parameters of all cameras", responses=json_example(_BACKUP))
    async def backup(
        pipelines: Wanted = True,
        load_carriers: Wanted = True,
        regions_of_interest: Wanted = True,
        grippers: Wanted = True,
    ) -> Any:
        wanted = {"load_carriers": load_carriers, "regions_of_interest": regions_of_interest, "grippers": grippers}
        content: dict[str, Any] = {name: [] for name in _NO_DATABASES if wanted[name]}
        if pipelines:
            content["pipelines"] = {str(number): _saved(service) for number, service in enumerate(services)}
        return content

    @routes.post(
        f"{base}/backup",
        summary="Restore parameters; what does not fit is left out, with a warning",
        responses=json_example({"return_code": {"value": 0, "message": "backup restored"}, "warnings": []})
        | error_responses({400: "The body is no backup.", 413: "The body is too large.", 507: "Not stored (--state)."}),
        openapi_extra={
            "requestBody": {
                "required": True,
                "content": {"application/json": {"schema": {"type": "object"}, "examples": example(_BACKUP)}},
            }
        },
    )
    async def restore(request: Request) -> Any:
        body = await read_body(request, MAX_BODY * len(services))
        content: _Backup = decode(_Backup, body, '{"pipelines": {"0": {"nodes": {}}}}')
        warnings = []
        for number, saved in content.pipelines.items():
            if number not in device.pipelines(services):
                warnings.append(f"there is no pipeline {number[:80]!r}")
                continue
            service = services[int(number)]
            for node, values in saved.nodes.items():
                warnings += _restore(service, node, values.parameters)
            await wait_until_stored(service)
        return {"return_code": {"value": 0, "message": "backup restored"}, "warnings": warnings}


def _saved(service: StereoService) -> dict[str, Any]:
    """Return the backup of a camera. ``exp_auto`` is an older name of ``exp_control`` and would overrule it."""
    nodes = {
        node: {
            "parameters": {name: value for name, value in service.parameters.values(node).items() if name != "exp_auto"}
        }
        for node in NODES
    }
    return {"type": "rc_visard", "nodes": nodes}


def _restore(service: StereoService, node: str, values: dict[str, Any]) -> list[str]:
    """Set those parameters of a node that can be set, and return a sentence about each other one."""
    good, warnings = [], []
    for name, value in values.items():
        try:
            good.append((name, check_value(service.parameters.spec(node, name), value)))
        except (UnknownParameterError, ParameterError) as error:
            warnings.append(str(error))
    names = {name for name, _ in good}
    service.set_parameters(node, [each for each in good if each[0] != "exp_auto" or "exp_control" not in names])
    return warnings
