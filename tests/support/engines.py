"""Container engines that answer on this machine, with a compose command that drives them."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

ROOT = Path(__file__).parents[2]
BASE = "python:3.11-slim-bookworm"
"""What both of our images start from."""
BUILD_SECONDS = 1800.0


@dataclass(frozen=True, slots=True)
class Engine:
    """How to speak to one."""

    name: str
    """``docker`` or ``podman``."""
    compose: tuple[str, ...]
    """Command that reads docker-compose.yml."""

    def build(self, tag: str, dockerfile: str) -> subprocess.CompletedProcess[str]:
        """Builds an image of this repository. SSL_CERT_FILE, where it is set, is what a build trusts, too."""
        command = [self.name, "build", "-t", tag, "-f", dockerfile]
        authority = os.environ.get("SSL_CERT_FILE")
        if authority:
            command += ["--secret", f"id=ca,src={authority}"]
        return _run(*command, ".", env={"DOCKER_BUILDKIT": "1"}, seconds=BUILD_SECONDS)

    def has(self, image: str) -> bool:
        """Whether the image is here, or can be pulled."""
        return (
            not _run(self.name, "image", "inspect", image).returncode or not _run(self.name, "pull", image).returncode
        )

    def run_compose(self, *arguments: str, env: dict[str, str]) -> subprocess.CompletedProcess[str]:
        """The compose command with these arguments, to its end."""
        return _run(*self.compose, *arguments, env=env, seconds=BUILD_SECONDS)


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
