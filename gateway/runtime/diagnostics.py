"""Checks of this machine for ``scenegate doctor``: address space, kernels, ports, multicast."""

import errno
import platform
import resource
import socket
from collections.abc import Iterator, Mapping

from gateway.runtime.installation import Finding, Verdict
from gateway.runtime.instance_probe import RunningInstance, probe_instance
from gateway.runtime.kernels import cache, parts
from gateway.runtime.workers import process_tuning
from renderers.compiler import cache_folder
from scenegate.lcm import udpm_socket

_LCM_ADDRESS = ("239.255.76.67", 7667)
"""LCM's default multicast group."""
_LOOPBACK_SECONDS = 2.0
"""Maximum time for a connection to this machine itself."""
_SUFFICIENT_ADDRESSES = 4 << 30
"""Bytes of address space that suffice for most uses."""


def findings(host: str, ports: Mapping[str, tuple[str, int]]) -> Iterator[Finding]:
    """Run all checks of the machine: of the host on which interfaces would listen, and of their ports.

    ``ports``: interface and TCP port by the flag that chooses the port; 0 is any.
    """
    yield Finding("Python", Verdict.OK, f"{platform.python_version()} on {platform.platform()}")
    yield _check_address_space()
    yield _check_kernels()
    instances: list[RunningInstance] = []
    for flag, (name, port) in ports.items():
        yield _check_port(name, host, port, flag, instances)
    yield _check_loopback()
    yield _check_multicast()


def _check_address_space() -> Finding:
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit == resource.RLIM_INFINITY:
        return Finding("address space", Verdict.OK, "not limited")
    detail = f"limited to {limit >> 20} MB"
    if limit >= _SUFFICIENT_ADDRESSES:
        return Finding("address space", Verdict.OK, detail)
    if problem := process_tuning.address_space_problem():
        return Finding("address space", Verdict.ERROR, detail, "Scenegate does not start.", problem)
    meaning = "The libraries reserve 1.5 GB: Scenegate may end without a message, or requests fail for lack of memory."
    return Finding("address space", Verdict.NOTE, detail, meaning, "ulimit -v unlimited, or systemd's MemoryMax")


def _check_kernels() -> Finding:
    folder = cache.configure()
    if not (reason := cache_folder.missing(parts=parts.PARTS)):
        return Finding("kernels", Verdict.OK, f"{cache_folder.count()} compiled, in {folder}")
    detail, duration = f"{reason}, in {folder}", "half a minute on two cores"
    if unusable := cache_folder.unusable(folder):  # of NUMBA_CACHE_DIR, or no temporary folder can replace it
        remedy = "NUMBA_CACHE_DIR=FOLDER, one that can be written and has room"
        return Finding("kernels", Verdict.ERROR, f"{detail}, {unusable}", "Nothing is rendered.", remedy)
    if cache_folder.is_private_root():
        detail = f"{reason}, and the cache folder cannot be written or is full"
        remedy = "SCENEGATE_CACHE_DIR=FOLDER, one that can be written and has room"
        return Finding("kernels", Verdict.NOTE, detail, f"Each start compiles them: {duration}.", remedy)
    return Finding("kernels", Verdict.NOTE, detail, f"The next start compiles them: {duration}.", "scenegate warmup")


def _check_port(name: str, host: str, port: int, flag: str, instances: list[RunningInstance]) -> Finding:
    """Check a port, for which a flag chooses another. ``instances``: gateways found so far; extended here."""
    try:
        process_tuning.listen(host, port).close()
    except OSError as error:
        owner = next((instance for instance in instances if port in instance.ports), None)
        if owner is None and error.errno == errno.EADDRINUSE and (owner := probe_instance(host, port)) is not None:
            instances.append(owner)
        if owner is not None:
            detail = f"{name}: taken by a running gateway, Scenegate {owner.version}, {owner.status}"
            meaning = "A second gateway needs other ports."
            return Finding(f"port {port}", Verdict.NOTE, detail, meaning, f"stop that one, or {flag} PORT")
        detail = f"{name}: {process_tuning.listen_error(error, host, port)}"
        meaning = f"{name} cannot start."
        remedies = {errno.EADDRINUSE: f"stop that program, or {flag} PORT", errno.EACCES: f"{flag} PORT, above 1023"}
        remedy = remedies.get(error.errno or 0, "--host ADDRESS, one of this machine")
        return Finding(f"port {port}", Verdict.ERROR, detail, meaning, remedy)
    return Finding(f"port {port}", Verdict.OK, f"{name}: free")


def _check_loopback() -> Finding:
    try:
        with socket.create_server(("127.0.0.1", 0)) as server:
            socket.create_connection(server.getsockname(), _LOOPBACK_SECONDS).close()
    except OSError as error:
        meaning = "No program of this machine reaches Scenegate at 127.0.0.1."
        return Finding("loopback", Verdict.ERROR, f"127.0.0.1: {error.strerror or error}", meaning, "ip link set lo up")
    return Finding("loopback", Verdict.OK, "127.0.0.1 accepts connections")


def _check_multicast() -> Finding:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        try:
            sock.connect(_LCM_ADDRESS)
        except OSError as error:
            meaning = "LCM messages over UDP neither arrive nor leave; TCPQ works."
            remedy = f"{udpm_socket.ROUTE_COMMANDS}; or, without root, {udpm_socket.HUB_OPTION}"
            return Finding("multicast", Verdict.NOTE, f"no route, {error.strerror}", meaning, remedy)
        return Finding("multicast", Verdict.OK, f"leaves by {sock.getsockname()[0]}")
