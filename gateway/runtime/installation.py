"""Checks of the installation for ``scenegate doctor``: our own files, and the libraries, which are imported.

This module needs only the standard library, so that it works where libraries do not.
"""

from __future__ import annotations

import base64
import hashlib
import operator
import re
from collections.abc import Iterator
from dataclasses import dataclass
from enum import Enum
from importlib import import_module
from importlib.metadata import PackageNotFoundError, distribution, packages_distributions, requires, version
from importlib.util import find_spec
from pathlib import Path
from textwrap import shorten
from typing import Final

import gateway

OWN_PACKAGES: Final = ("gateway", "renderers")
"""Packages of this distribution; other distributions may use the same names."""
IMPORTS: Final = {
    "DracoPy": "DracoPy.decode",
    "fastapi": "fastapi.FastAPI",
    "fastapi-offline": "fastapi_offline.FastAPIOffline",
    "grpcio": "grpc.aio.server",
    "grpcio-health-checking": "grpc_health.v1.health.HealthServicer",
    "grpcio-reflection": "grpc_reflection.v1alpha.reflection.SERVICE_NAME",
    "httptools": "httptools.HttpRequestParser",
    "isal": "isal.isal_zlib.compress",
    "lcm": "lcm.EventLog",
    "msgspec": "msgspec.json.decode",
    "numba": "numba.njit",
    "numpy": "numpy.ndarray",
    "opencv-python-headless": "cv2.imdecode",
    "opentelemetry-api": "opentelemetry.trace.get_tracer",
    "pillow": "PIL.Image.open",
    "prometheus-client": "prometheus_client.CollectorRegistry",
    "protobuf": "google.protobuf.message.Message",
    "pybase64": "pybase64.b64decode",
    "pycollada": "collada.Collada",
    "pydantic-settings": "pydantic_settings.BaseSettings",
    "python-multipart": "python_multipart.MultipartParser",
    "rich": "rich.console.Console",
    "scenegate-client": "scenegate.TreeViewer",
    "structlog": "structlog.get_logger",
    "trimesh": "trimesh.Trimesh",
    "typer": "typer.Typer",
    "uvicorn": "uvicorn.Server",
    "uvloop": "uvloop.new_event_loop",
    "websockets": "websockets.connect",
    # Extras: checked where they are installed.
    "foxglove-sdk": "foxglove.start_server",
    "mujoco": "mujoco.MjSpec",
    "opentelemetry-exporter-otlp-proto-http": "opentelemetry.exporter.otlp.proto.http.trace_exporter.OTLPSpanExporter",
    "opentelemetry-sdk": "opentelemetry.sdk.trace.TracerProvider",
    "ray": "ray.init",
    "rerun-sdk": "rerun.init",
}
"""A name that Scenegate imports from each required library."""
_GENERATED: Final = "scenegate.camera.image_interface_pb2.DESCRIPTOR"
"""Protobuf classes: generated code needs a protobuf that is at least as new."""
_REQUIREMENT: Final = re.compile(r"(?P<name>[\w.-]+)(\[[^]]*\])?(?P<limits>[^;]*)(;(?P<marker>.*))?")
_LIMIT: Final = re.compile(r"\s*(?P<operator>==|>=|<)\s*(?P<version>\d.*)")
_OPERATORS: Final = {"==": operator.eq, ">=": operator.ge, "<": operator.lt}
_NONE_WORKS: Final = "Scenegate does not start, or some of its interfaces fail."
_REINSTALL: Final = "pip install --force-reinstall"


class Verdict(Enum):
    OK = "ok"
    NOTE = "note"
    """Works with restrictions."""
    ERROR = "error"
    """Scenegate, or one of its interfaces, does not work."""


@dataclass(frozen=True, slots=True)
class Finding:
    """One row of the table."""

    subject: str
    verdict: Verdict
    detail: str
    """Sentence that states the finding."""
    meaning: str = ""
    """Sentence that states its effect; empty if all is well."""
    remedy: str = ""
    """Remedy, such as a command."""


def installation_findings() -> Iterator[Finding]:
    """Check our own packages and every library that they require."""
    yield Finding("scenegate", Verdict.OK, gateway.__version__)
    yield from _own_packages()
    yield from _changed_files()
    try:
        requirements = distribution("scenegate").requires or []
    except PackageNotFoundError:
        meaning = "The versions of the libraries are not compared with what Scenegate requires."
        yield Finding("scenegate", Verdict.NOTE, "used without being installed", meaning, "pip install scenegate")
        requirements = list(IMPORTS)
    for requirement in requirements:
        if not (requirement.startswith("scenegate-client[") and "extra ==" in requirement):  # it is required anyway
            yield from _library(requirement)
    if fault := _import_fault(_GENERATED):
        remedy = "pip install --upgrade protobuf"
        yield Finding("messages", Verdict.ERROR, fault, "The stereo camera's image stream fails.", remedy)
    else:
        yield Finding("messages", Verdict.OK, "the stereo camera's messages can be loaded")


def _own_packages() -> Iterator[Finding]:
    """Find foreign packages with our names: those imported instead of ours, and those in the working directory."""
    home = Path(gateway.__file__).resolve().parents[1]
    for name in OWN_PACKAGES:
        spec = find_spec(name)
        found = Path((spec.submodule_search_locations or [str(spec.origin)])[0]).resolve() if spec else None
        if found != home / name:
            owners = f" (of {' and '.join(others)})" if (others := _others_with(name)) else ""
            detail = f"{found or 'nothing'}{owners} is imported instead of {home / name}"
            remedy = "remove it, or install Scenegate into a virtual environment of its own"
            yield Finding(name, Verdict.ERROR, detail, _NONE_WORKS, remedy)
        elif others := _others_with(name):
            detail = f"{' and '.join(others)} has a package of this name, too"
            meaning = "Both have one folder: installing or removing one of them changes files of the other."
            yield Finding(name, Verdict.NOTE, detail, meaning, "keep them in different virtual environments")
    for name in OWN_PACKAGES:
        for path in (Path.cwd() / f"{name}.py", Path.cwd() / name):
            if path.exists() and path.resolve() not in (home / name, home / f"{name}.py"):
                meaning = "Python programs that run in this folder import it instead of Scenegate's."
                yield Finding(name, Verdict.NOTE, f"{path} has the name of our package", meaning, "rename it")


def _others_with(package: str) -> list[str]:
    """Return the other distributions that have a package of this name."""
    return sorted(set(packages_distributions().get(package, ())) - {"scenegate"})


def _changed_files() -> Iterator[Finding]:
    """Compare our files with the digests that the installer has recorded: another package may have replaced some."""
    try:
        files = distribution("scenegate").files or []
    except PackageNotFoundError:
        return
    changed = []
    for file in files:
        if file.hash is None or file.parts[0] not in OWN_PACKAGES:
            continue
        try:
            digest = hashlib.new(file.hash.mode, file.read_binary()).digest()
        except OSError:
            digest = b""
        if base64.urlsafe_b64encode(digest).rstrip(b"=").decode() != file.hash.value:
            changed.append(str(file))
    if changed:
        others = sorted({other for package in OWN_PACKAGES for other in _others_with(package)})
        detail = f"files of the installation are missing or changed: {changed[0]}"
        detail += f" and {len(changed) - 1} others" if len(changed) > 1 else ""
        detail += f"; {' and '.join(others)} has a package of that name" if others else ""
        remove = f"pip uninstall {' '.join(others)}; " if others else ""
        yield Finding("scenegate", Verdict.ERROR, detail, _NONE_WORKS, f"{remove}{_REINSTALL} --no-deps scenegate")


def _library(requirement: str) -> Iterator[Finding]:
    """Import a library, and compare its version with a requirement such as ``numba<0.70,>=0.68``."""
    parsed = _REQUIREMENT.fullmatch(requirement)
    assert parsed is not None
    name, limits, marker = parsed["name"], parsed["limits"].strip(), parsed["marker"] or ""
    optional = "extra" in marker
    try:
        installed = version(name)
    except PackageNotFoundError:
        installed = ""
    if optional and not installed:
        return
    remedy = f"pip install '{name}{limits}'"
    fault = _import_fault(_import_of(name))
    if fault and not installed:
        yield Finding(name, Verdict.ERROR, "not installed", _NONE_WORKS, remedy)
    elif fault:
        twins = _twins(name)
        also = f"; the same package is also in {' and '.join(twins)}" if twins else ""
        again = f"pip uninstall {' '.join(twins)}; " if twins else ""
        detail = f"{installed} cannot be used: {fault}{also}"
        yield Finding(name, Verdict.ERROR, detail, _NONE_WORKS, f"{again}{_REINSTALL} --no-deps '{name}{limits}'")
    elif not installed:
        others = " and ".join(_twins(name)) or "files of no distribution"
        meaning = "It works; its version is not checked."
        yield Finding(name, Verdict.NOTE, f"provided by {others}", meaning, remedy)
    elif not _is_within(installed, limits):
        detail = f"{installed}, but Scenegate needs {limits}"
        yield Finding(name, Verdict.ERROR, detail, _NONE_WORKS, remedy)
    elif twins := _twins(name):
        meaning = "Both have the same files: removing one, or another version of it, breaks the other."
        yield Finding(name, Verdict.NOTE, f"{installed}, beside {' and '.join(twins)}", meaning, "keep one of them")
    else:
        yield Finding(name, Verdict.OK, installed)


def _import_of(name: str) -> str:
    """Return the name that ``IMPORTS`` has for a library; metadata may spell the library differently."""
    return next((path for each, path in IMPORTS.items() if _plain(each) == _plain(name)), name)


def _import_fault(path: str) -> str:
    """Import a name in a module; return why it failed, or ""."""
    module, _, attribute = path.rpartition(".")
    try:
        getattr(import_module(module or path), attribute if module else "__name__")
    except Exception as error:  # noqa: BLE001 - broken libraries raise anything
        return f"{type(error).__name__}: {shorten(str(error), 200, placeholder=' …')}"
    return ""


def _twins(name: str) -> list[str]:
    """Return the other distributions that install the same modules as a library."""
    package = _import_of(name).partition(".")[0]
    own = _files(name)
    known = {_plain(name)}
    if own:  # its own parts, which it requires, share the folder
        known |= {_plain(each["name"]) for each in map(_REQUIREMENT.match, requires(name) or []) if each}
    others = {_plain(each) for each in packages_distributions().get(package, ())} - known
    return sorted(each for each in others if not own or own & _files(each))


def _files(name: str) -> set[str]:
    """Return the modules of a distribution; empty if it is not installed."""
    try:
        files = distribution(name).files or []
    except PackageNotFoundError:
        return set()
    return {str(file) for file in files if file.suffix in (".py", ".so")}


def _plain(name: str) -> str:
    """Return the normalized name of a distribution (PEP 503)."""
    return re.sub(r"[-_.]+", "-", name).lower()


def _is_within(installed: str, limits: str) -> bool:
    """Return True if a version is within limits such as ``<0.70,>=0.68`` or ``==1.2``; other operators are ignored."""
    return all(
        _OPERATORS[limit["operator"]](_numbers(installed), _numbers(limit["version"]))
        for limit in map(_LIMIT.fullmatch, limits.split(","))
        if limit
    )


def _numbers(text: str) -> list[int]:
    """Return the release of a version, without zeros at its end: 1.10.0rc1 is [1, 10]."""
    release = re.match(r"\d+(\.\d+)*", text)
    numbers = [int(each) for each in release[0].split(".")] if release else []
    while numbers and numbers[-1] == 0:
        numbers.pop()
    return numbers
