"""Checks of the installation and of this machine, for ``scenegate check``."""

from __future__ import annotations

import ctypes
import errno
import platform
import resource
import socket
from collections.abc import Collection, Iterator, Mapping
from dataclasses import dataclass
from enum import Enum
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path

from gateway import __version__
from gateway.runtime import kernel_cache, process_tuning
from gateway.runtime.instance_probe import RunningInstance, probe_instance
from renderers.compiler import cache_folder

LIBRARIES = ("numpy", "numba", "opencv-python-headless", "fastapi", "uvicorn", "grpcio", "protobuf", "lcm")
_LCM_ADDRESS = ("239.255.76.67", 7667)
"""LCM's default multicast group."""
_RECEIVE_BUFFER_BYTES = 4_000_000
"""Receive buffer in bytes for bursts of 1 MB messages; with Linux' default of 212 992 they are lost."""


class Verdict(Enum):
    OK = "ok"
    NOTE = "note"
    """Works with restrictions; the finding has a remedy."""
    BAD = "bad"


@dataclass(frozen=True, slots=True)
class Finding:
    """One row of the table."""

    subject: str
    verdict: Verdict
    detail: str


def findings(host: str, ports: Mapping[str, int], threads: int, kernel_parts: Collection[str]) -> Iterator[Finding]:
    """Run all checks.

    Args:
        host: address on which the interfaces would listen.
        ports: TCP ports by interface; 0 is any.
        threads: number of rendering threads.
        kernel_parts: names of all parts that the kernel cache should contain.
    """
    yield Finding("scenegate", Verdict.OK, __version__)
    yield Finding("Python", Verdict.OK, f"{platform.python_version()} on {platform.platform()}")
    for name in LIBRARIES:
        yield _library(name)
    yield _glib()
    yield Finding("threads", Verdict.OK, f"{threads} threads render")
    yield _open_files()
    yield _kernels(kernel_parts)
    instances: list[RunningInstance] = []
    for name, port in ports.items():
        yield _port(name, host, port, instances)
    yield _multicast()
    yield _receive_buffer()


def _library(name: str) -> Finding:
    try:
        return Finding(name, Verdict.OK, version(name))
    except PackageNotFoundError:
        return Finding(name, Verdict.BAD, "not installed")


def _glib() -> Finding:
    try:
        ctypes.CDLL("libglib-2.0.so.0")
    except OSError:
        remedy = "apt install libglib2.0-0"
        return Finding("glib", Verdict.NOTE, f"missing, LCM's own library does not work without: {remedy}")
    return Finding("glib", Verdict.OK, "libglib-2.0.so.0")


def _open_files() -> Finding:
    soft, hard = resource.getrlimit(resource.RLIMIT_NOFILE)
    verdict = Verdict.OK if hard == resource.RLIM_INFINITY or hard >= 4096 else Verdict.NOTE
    return Finding("open files", verdict, f"{soft} now, up to {hard}")


def _kernels(parts: Collection[str]) -> Finding:
    folder = kernel_cache.configure()
    if not (reason := cache_folder.missing(parts=parts)):
        return Finding("kernels", Verdict.OK, f"{cache_folder.count()} compiled, in {folder}")
    return Finding("kernels", Verdict.NOTE, f"{reason}; the next start compiles them: scenegate warmup ({folder})")


def _port(name: str, host: str, port: int, instances: list[RunningInstance]) -> Finding:
    """Check a port.

    Args:
        instances: running gateways found so far; extended here.
    """
    try:
        process_tuning.listen(host, port).close()
    except OSError as error:
        owner = next((instance for instance in instances if port in instance.ports), None)
        if owner is None and error.errno == errno.EADDRINUSE and (owner := probe_instance(host, port)) is not None:
            instances.append(owner)
        if owner is not None:
            detail = f"{name}: taken by a running gateway, Scenegate {owner.version}, {owner.status}"
            return Finding(f"port {port}", Verdict.NOTE, detail)
        return Finding(f"port {port}", Verdict.BAD, f"{name}: {process_tuning.listen_error(error, host, port)}")
    return Finding(f"port {port}", Verdict.OK, f"{name}: free")


def _multicast() -> Finding:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        try:
            sock.connect(_LCM_ADDRESS)
        except OSError as error:
            remedy = "sudo ip link set lo multicast on; sudo ip route add 224.0.0.0/4 dev lo"
            return Finding("multicast", Verdict.NOTE, f"no route, {error.strerror}, for LCM: {remedy}")
        return Finding("multicast", Verdict.OK, f"leaves by {sock.getsockname()[0]}")


def _receive_buffer() -> Finding:
    try:
        limit = int(Path("/proc/sys/net/core/rmem_max").read_text())
    except (OSError, ValueError):
        return Finding("receive buffer", Verdict.NOTE, "the system's limit is not known")
    if limit >= _RECEIVE_BUFFER_BYTES:
        return Finding("receive buffer", Verdict.OK, f"up to {limit} bytes")
    remedy = f"sudo sysctl -w net.core.rmem_max={_RECEIVE_BUFFER_BYTES}"
    return Finding("receive buffer", Verdict.NOTE, f"up to {limit} bytes, large LCM messages get lost: {remedy}")
