"""docker-compose.yml and what it mounts, read by every program for them that is on this machine."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from tests.support.waiting import SECONDS

ROOT = Path(__file__).parents[2]
DIGEST = re.compile(r"@sha256:[0-9a-f]{64}$")
PROFILES = ("demo", "test", "scale", "observe")
SERVICES = {"gateway", "publisher", "recorder", "test", "render", "haproxy", "prometheus", "grafana"}


def run(*command: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=SECONDS, check=False)


@pytest.mark.parametrize("compose", ["docker compose", "docker-compose", "podman-compose"])
@pytest.mark.slow
def test_compose_reads_every_profile(compose: str) -> None:
    command = compose.split()
    if shutil.which(command[0]) is None or run(*command, "version").returncode:
        pytest.skip(f"there is no {compose}")
    profiles = [argument for profile in PROFILES for argument in ("--profile", profile)]
    read = run(*command, *profiles, "config", "--services")
    assert read.returncode == 0, read.stderr
    assert {line.strip() for line in read.stdout.splitlines()} >= SERVICES


def test_only_services_that_serve_have_the_image_s_health_check() -> None:
    services = YAML(typ="safe").load(ROOT / "docker-compose.yml")["services"]
    assert set(services) == SERVICES
    assert "HEALTHCHECK" in (ROOT / "deploy" / "Dockerfile").read_text()
    for name, service in services.items():
        serves = "entrypoint" not in service and service.get("command", ["serve"])[0] == "serve"
        check = service.get("healthcheck", {})
        if service.get("image") == "scenegate" and not serves:
            assert check.get("disable") is True or "test" in check, f"{name} has no gateway to be asked for its health"
        else:
            assert not check.get("disable"), name


def test_services_cannot_change_their_image() -> None:
    for name, service in YAML(typ="safe").load(ROOT / "docker-compose.yml")["services"].items():
        if name == "test":  # Chromium writes to its home
            continue
        assert service["read_only"] is True, name
        assert service["cap_drop"] == ["ALL"], name
        assert service["security_opt"] == ["no-new-privileges:true"], name


def test_images_of_others_are_named_by_digest() -> None:
    services = YAML(typ="safe").load(ROOT / "docker-compose.yml")["services"].values()
    pinned = [service["image"] for service in services if not service["image"].startswith("scenegate")]
    files = (ROOT / "deploy" / "Dockerfile", ROOT / "tests/compose/Dockerfile")
    bases = [base for file in files for base in re.findall(r"^FROM (\S+:\S+)", file.read_text(), re.MULTILINE)]
    assert len(set(bases)) == 1, "both of our images have one base"
    assert [image for image in (*pinned, *bases) if not DIGEST.search(image)] == []
