"""Container engines that answer on this machine, with a compose command that drives them."""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import uuid
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path

from tests.support.ports import free_ports

ROOT = Path(__file__).parents[2]
BASE = "python:3.11-slim-bookworm"
"""Base image of both of our images, without its digest."""
DOCKERFILES = ("deploy/Dockerfile", "tests/compose/Dockerfile")
COMPOSE = "docker-compose.yml"
MOUNTED = ("deploy", "examples")
"""Folders that docker-compose.yml mounts."""
BUILD_SECONDS = 1800.0
PORTS = ("HTTP_PORT", "TCPQ_PORT", "GRPC_PORT", "SCALE_PORT", "PROMETHEUS_PORT", "GRAFANA_PORT")
"""Port variables of docker-compose.yml."""


@dataclass(frozen=True, slots=True)
class Engine:
    """A container engine."""

    name: str
    """``docker`` or ``podman``."""
    compose: tuple[str, ...]
    """Command that reads docker-compose.yml."""
    files: Path = ROOT
    """Folder of the files that name images: docker-compose.yml and the Dockerfiles."""

    def by_tags(self, folder: Path) -> Engine:
        """Return this engine with copies of the files that name images by their tags, without digests.

        For machines without a registry, where images of one's own have the names of the official ones.

        Args:
            folder: an empty folder, which gets the copies.
        """
        for name in MOUNTED:
            shutil.copytree(ROOT / name, folder / name)
        for name in (COMPOSE, *DOCKERFILES):
            copy = folder / name
            copy.parent.mkdir(parents=True, exist_ok=True)
            copy.write_text(re.sub(r"@sha256:[0-9a-f]{64}", "", (self.files / name).read_text()))
        return replace(self, files=folder)

    def build(self, tag: str, dockerfile: str) -> subprocess.CompletedProcess[str]:
        """Builds an image of this repository. SSL_CERT_FILE, where it is set, is what a build trusts, too."""
        command = [self.name, "build", "-t", tag, "-f", str(self.files / dockerfile)]
        authority = os.environ.get("SSL_CERT_FILE")
        if authority:
            command += ["--secret", f"id=ca,src={authority}"]
        return _run(*command, ".", env={"DOCKER_BUILDKIT": "1"}, seconds=BUILD_SECONDS)

    def has(self, image: str) -> bool:
        """Return True if the image is present or can be pulled."""
        return (
            not _run(self.name, "image", "inspect", image).returncode or not _run(self.name, "pull", image).returncode
        )

    def has_for(self, service: str) -> bool:
        """Return True if the service's image in docker-compose.yml is present or can be pulled."""
        text = (self.files / COMPOSE).read_text()
        named = re.search(rf"^  {service}:\n(?:    .*\n)*?    image: (\S+)$", text, re.MULTILINE)
        assert named is not None, f"docker-compose.yml names no image for {service}"
        return self.has(named[1])

    def has_base(self) -> bool:
        """Return True if the base image of the Dockerfile is present or can be pulled."""
        named = re.search(r"^FROM (\S+)", (self.files / "deploy" / "Dockerfile").read_text(), re.MULTILINE)
        assert named is not None
        return self.has(named[1])

    def run(self, *arguments: str) -> str:
        """Run the engine's command and return its output."""
        ran = _run(self.name, *arguments)
        assert ran.returncode == 0, f"{self.name} {' '.join(arguments)}: {ran.stderr[-4000:]}"
        return ran.stdout

    @contextmanager
    def project(self) -> Iterator[Project]:
        """A compose project of its own, on free ports; its containers, network and volumes go at the end."""
        ports = dict(zip(PORTS, free_ports(len(PORTS)), strict=True))
        made = Project(self, f"scenegate{uuid.uuid4().hex[:8]}", ports)
        try:
            yield made
        finally:
            ended = made.compose(*(f"--profile={name}" for name in made.profiles), "down", "-t", "15", "-v")
            if left := made.containers():  # podman-compose 1.6 forgets all replicas but the first
                self.run("rm", "-f", *left)
        assert ended.returncode == 0, ended.stderr[-4000:]


class Project:
    """docker-compose.yml under a name and on ports of its own."""

    def __init__(self, engine: Engine, name: str, ports: Mapping[str, int]) -> None:
        self.engine, self.name, self.ports = engine, name, ports
        self.profiles: dict[str, None] = {}

    def compose(self, *arguments: str) -> subprocess.CompletedProcess[str]:
        """The compose command with these arguments, to its end."""
        env = {name: str(port) for name, port in self.ports.items()}
        return _run(
            *self.engine.compose,
            "-f",
            str(self.engine.files / COMPOSE),
            "-p",
            self.name,
            *arguments,
            env=env,
            seconds=BUILD_SECONDS,
        )

    def up(self, profile: str, *arguments: str) -> None:
        """Starts a profile (empty: what has none) in the background, of images that are there."""
        self.profiles |= {profile: None} if profile else {}
        ran = self.compose(*([f"--profile={profile}"] if profile else []), "up", "-d", "--no-build", *arguments)
        assert ran.returncode == 0, ran.stdout[-4000:] + ran.stderr[-4000:]

    def containers(self, service: str = "") -> list[str]:
        """The ids of a service's containers, or of all; ended ones, too."""
        of = [f"label=com.docker.compose.project={self.name}"]
        of += [f"label=com.docker.compose.service={service}"] if service else []
        return self.engine.run("ps", "-a", "-q", *(f"--filter={each}" for each in of)).split()

    def url(self, port: str) -> str:
        """The base URL of a published port."""
        return f"http://127.0.0.1:{self.ports[port]}"


def engines() -> tuple[dict[str, Engine], dict[str, str]]:
    """Those that answer, by name, and for the others the reason why not."""
    found: dict[str, Engine] = {}
    missing: dict[str, str] = {}
    beside = str(Path(sys.executable).parent)
    path = os.pathsep.join((os.environ.get("PATH", os.defpath), beside))
    podman_compose = shutil.which("podman-compose", path=path)
    commands: dict[str, list[tuple[str, ...]]] = {
        "docker": [("docker", "compose"), ("docker-compose",)],
        "podman": [(podman_compose,)] if podman_compose else [],
    }
    for name, composes in commands.items():
        if shutil.which(name) is None:
            missing[name] = f"{name} is not installed"
        elif _run(name, "info", seconds=30).returncode:
            missing[name] = f"{name} is installed, but no engine answers"
        elif (usable := [c for c in composes if shutil.which(c[0]) and not _run(*c, "version").returncode]) == []:
            missing[name] = f"{name} answers, but there is no compose command for it"
        else:
            found[name] = Engine(name, usable[0])
    return found, missing


def _run(*command: str, env: dict[str, str] | None = None, seconds: float = 300.0) -> subprocess.CompletedProcess[str]:
    return subprocess.run(
        command,
        cwd=ROOT,
        env={**os.environ, **(env or {})},
        capture_output=True,
        text=True,
        timeout=seconds,
        check=False,
        stdin=subprocess.DEVNULL,
    )
