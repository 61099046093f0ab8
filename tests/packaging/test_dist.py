"""Wheels and sdists of client and server: those in SCENEGATE_DIST (`make dist-test`), or built here."""

import os
import random
import re
import subprocess
import sys
import tarfile
import zipfile
from email.message import Message
from email.parser import Parser
from pathlib import Path

import pytest

from gateway import __version__
from tests.support import clients
from tests.support.gateway_process import gateway_process
from tests.support.waiting import SECONDS, wait_until

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
UV = Path(sys.executable).with_name("uv")


def run(*command: str | Path, cwd: Path = ROOT) -> str:
    """Run a command and return its output."""
    ran = subprocess.run(command, cwd=cwd, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert ran.returncode == 0, ran.stdout[-4000:] + ran.stderr[-4000:]
    return ran.stdout


def build(source: Path, into: Path, *what: str) -> None:
    run(UV, "build", "--quiet", "--no-build-isolation", "--python", sys.executable, "-o", into, *what, source)


@pytest.fixture(scope="module")
def dist(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The folder of wheels and sdists."""
    if given := os.environ.get("SCENEGATE_DIST"):
        return Path(given).absolute()
    made = tmp_path_factory.mktemp("dist")
    build(ROOT / "client", made)
    build(ROOT, made)
    return made


@pytest.fixture(scope="module")
def wheel(dist: Path) -> Path:
    (found,) = dist.glob("scenegate-*.whl")
    return found


@pytest.fixture(scope="module")
def sdist(dist: Path) -> Path:
    (found,) = dist.glob("scenegate-*.tar.gz")
    return found


@pytest.fixture(scope="module")
def client_wheel(dist: Path) -> Path:
    (found,) = dist.glob("scenegate_client-*.whl")
    return found


def metadata(wheel: Path) -> Message:
    with zipfile.ZipFile(wheel) as archive:
        return Parser().parsestr(archive.read(f"scenegate-{__version__}.dist-info/METADATA").decode())


def test_wheel_has_every_file_of_the_packages(wheel: Path) -> None:
    files = {file for package in ("gateway", "renderers") for file in (ROOT / package).rglob("*") if file.is_file()}
    expected = {
        file.relative_to(ROOT).as_posix()
        for file in files
        if "__pycache__" not in file.parts and ROOT / "gateway/adapters/viewer/web" not in file.parents
    }
    with zipfile.ZipFile(wheel) as archive:
        names = set(archive.namelist())
    assert {name for name in names if ".dist-info/" not in name} == expected
    assert f"scenegate-{__version__}.dist-info/licenses/LICENSE" in names


def test_sdist_builds_the_same_wheel(sdist: Path, wheel: Path, tmp_path: Path) -> None:
    with tarfile.open(sdist) as archive:
        archive.extractall(tmp_path, filter="data")
    build(tmp_path / sdist.name.removesuffix(".tar.gz"), tmp_path / "dist", "--wheel")
    (again,) = (tmp_path / "dist").glob("scenegate-*.whl")
    with zipfile.ZipFile(again) as one, zipfile.ZipFile(wheel) as other:
        assert {each.filename: each.CRC for each in one.infolist()} == {
            each.filename: each.CRC for each in other.infolist()
        }


def test_metadata(wheel: Path) -> None:
    described = metadata(wheel)
    assert described["Name"] == "scenegate"
    assert described["Version"] == __version__
    assert described["License-Expression"] == "Apache-2.0"
    assert described["Description-Content-Type"] == "text/markdown"
    text = described.get_payload()
    assert isinstance(text, str)
    assert text.startswith("# Scenegate")
    if "Repository" in str(described.get_all("Project-URL")):
        assert re.findall(r"\]\((?!https?:|#)[^)]*", text) == []


def test_client_wheel_is_small_and_holds_nothing_of_the_server(client_wheel: Path) -> None:
    files = [file for file in (ROOT / "client/scenegate").rglob("*") if file.is_file()]
    with zipfile.ZipFile(client_wheel) as archive:
        names = {name for name in archive.namelist() if ".dist-info/" not in name}
        metadata = archive.read(f"scenegate_client-{__version__}.dist-info/METADATA").decode()
    assert names == {file.relative_to(ROOT / "client").as_posix() for file in files if "__pycache__" not in file.parts}
    assert "scenegate/py.typed" in names
    assert client_wheel.stat().st_size < 300_000
    required = [line for line in metadata.splitlines() if line.startswith("Requires-Dist:") and "extra" not in line]
    assert [re.split(r"[ >=]+", line)[1] for line in required] == ["msgspec", "numpy"]


def test_server_needs_the_client_of_its_version(wheel: Path) -> None:
    required = metadata(wheel).get_all("Requires-Dist")
    assert f"scenegate-client[camera,images]=={__version__}" in (required or [])


def test_installed_wheel_serves_the_demo(wheel: Path, client_wheel: Path, tmp_path: Path) -> None:
    python = tmp_path / "environment" / "bin" / "python"
    run(UV, "venv", "--quiet", "--python", sys.executable, tmp_path / "environment")
    install: list[str | Path] = [UV, "pip", "install", "--quiet", "--python", python]
    try:
        run(*install, "--require-hashes", "-r", ROOT / "tools" / "locks" / "requirements.lock", cwd=tmp_path)
    except AssertionError as error:
        pytest.skip(f"the dependencies cannot be installed: {str(error)[-200:]}")
    run(*install, "--offline", "--find-links", wheel.parent, "scenegate", cwd=tmp_path)  # finds the client there
    script = python.with_name("scenegate")
    where = "import gateway, renderers; print(gateway.__file__, renderers.__file__)"
    assert str(ROOT) not in run(python, "-c", where, cwd=tmp_path)
    network = f"udpm://239.255.76.67:{random.randrange(20000, 60000)}?ttl=0"
    ports = ("--grpc-port", "0", "--tcpq-port", "0", "--lcm-url", network)
    with gateway_process("--demo", *ports, "--stereo-profile", "rgbd", command=[script]) as (process, url):
        with clients.Client(base_url=url) as http:
            page = http.get("/view")
            assets = re.findall(r'(?:src|href)="([^"]+/assets/[^"]+)"', page.text)
            assert len(assets) >= 2
            for asset in assets:
                assert http.get(asset).status_code == 200, asset
            assert http.get("/docs").status_code == 200
            # 503 while its kernels are still being compiled.
            drawn = wait_until(lambda: got if (got := http.get("/scene/render")).status_code != 503 else None)
            assert drawn.headers["content-type"] == "image/png", drawn.text
            states = {name: each["state"] for name, each in http.get("/healthz").json()["interfaces"].items()}
        assert set(states.values()) == {"ready"}, states
        assert process.stop() == 0
