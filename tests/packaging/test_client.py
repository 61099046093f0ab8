"""The client alone, installed in an environment of its own, against a gateway of this environment."""

import os
import re
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest

from tests.files.robots.files import ARM, TRIANGLE, write
from tests.support import clients
from tests.support.gateway_process import gateway_process
from tests.support.waiting import SECONDS

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
UV = Path(sys.executable).with_name("uv")
MAX_BYTES = 80 << 20
"""Maximum size of an environment in which programs publish."""
VERSIONS = ("3.10", f"{sys.version_info.major}.{sys.version_info.minor}", "3.13")


def run(*command: str | Path, cwd: Path = ROOT) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name not in ("PYTHONPATH", "VIRTUAL_ENV")}
    return subprocess.run(
        command, cwd=cwd, env=environment, capture_output=True, text=True, timeout=SECONDS, check=False
    )


def python_of(version: str) -> str:
    """Return the path of an interpreter; skip where there is none."""
    root = Path(os.environ.get("PYENV_ROOT", Path.home() / ".pyenv"))
    candidates = [f"python{version}", *map(str, root.glob(f"versions/{version}.*/bin/python"))]
    for candidate in candidates:
        path = shutil.which(candidate)  # pyenv's commands for versions that are not selected fail
        if path is not None and run(path, "-c", "").returncode == 0:
            return path
    pytest.skip(f"there is no Python {version}")


@pytest.fixture(scope="module", params=VERSIONS)
def python(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The interpreter of an environment with the client and what it needs."""
    folder = tmp_path_factory.mktemp("client")
    made = run(UV, "venv", "--quiet", "--python", python_of(request.param), folder / "environment")
    assert made.returncode == 0, made.stderr
    python = folder / "environment" / "bin" / "python"
    installed = run(UV, "pip", "install", "--quiet", "--no-compile-bytecode", "--python", python, ROOT / "client")
    if installed.returncode:
        pytest.skip(f"NumPy and msgspec cannot be installed: {installed.stderr[-200:]}")
    return python


@pytest.fixture(scope="module")
def camera_python(python: Path) -> Path:
    """The same with the extras for the camera and for images."""
    extras = f"{ROOT / 'client'}[camera,images]"
    installed = run(UV, "pip", "install", "--quiet", "--python", python, extras)
    if installed.returncode:
        pytest.skip(f"the extras cannot be installed: {installed.stderr[-200:]}")
    return python


@pytest.fixture(scope="module")
def gateway() -> Iterator[str]:
    """The URL of a gateway with the demo scene."""
    ports = ("--grpc-port", "0", "--tcpq-port", "0", "--lcm-url", "off")
    with gateway_process("--demo", *ports, "--stereo-rate", "max") as (_, url):
        yield url


def interface(url: str, name: str) -> dict[str, object]:
    found: dict[str, object] = clients.get(f"{url}/healthz").json()["interfaces"][name]
    return found


def hub_of(url: str) -> str:
    return str(interface(url, "treeviewer")["tcpq"]["url"])  # type: ignore[index]  # JSON


def test_environment_is_small(python: Path) -> None:
    folder = next((python.parents[1] / "lib").glob("python3*")) / "site-packages"
    sizes = {each: sum(file.stat().st_size for file in each.rglob("*") if file.is_file()) for each in folder.iterdir()}
    assert sum(sizes.values()) < MAX_BYTES, sizes
    others = {path.name.partition("-")[0] for path in sizes} & {"grpc", "PIL", "lcm", "gateway", "renderers"}
    assert not others


def test_publishes_a_robot_with_meshes(python: Path, gateway: str, tmp_path: Path) -> None:
    write(tmp_path, TRIANGLE, "meshes/part.obj")
    mesh = '<visual><geometry><mesh filename="meshes/part.obj"/></geometry></visual>'
    robot = write(tmp_path, ARM.replace('<link name="tool"/>', f'<link name="tool">{mesh}</link>'))
    command = (
        python.with_name("scenegate"),
        "publish",
        robot,
        "--no-sliders",
        "--path",
        "cell/arm",
        "--lcm-url",
        hub_of(gateway),
    )
    published = run(*command, cwd=tmp_path)
    assert published.returncode == 0, published.stderr
    assert published.stderr == ""
    assert "set: cell/arm/base, cell/arm/upper, cell/arm/hand, cell/arm/finger, cell/arm/tool" in published.stdout
    paths = {tuple(node["path"]) for node in clients.get(f"{gateway}/scene").json()["nodes"]}
    assert ("cell", "arm", "tool") in paths


def test_commands_of_the_server_say_what_to_install(python: Path, tmp_path: Path) -> None:
    served = run(python.with_name("scenegate"), "serve", "--demo", cwd=tmp_path)
    assert (served.returncode, served.stdout) == (1, "")
    assert "needs the server, which is not installed: pip install scenegate" in served.stderr


def test_streams_the_camera(camera_python: Path, gateway: str, tmp_path: Path) -> None:
    target = f"127.0.0.1:{interface(gateway, 'stereo')['port']}"
    command = (camera_python.with_name("scenegate"), "stream", target, "--left", "--disparity", "--count", "2")
    streamed = run(*command, "-o", "out", "--preview", "newest.jpg", cwd=tmp_path)
    assert streamed.returncode == 0, streamed.stderr
    assert len(list((tmp_path / "out").glob("*_left.png"))) == 2
    assert (tmp_path / "newest.jpg").read_bytes().startswith(b"\xff\xd8")


def test_examples_of_the_readme(camera_python: Path, gateway: str, tmp_path: Path) -> None:
    found = re.findall(r"```python[^\n]*\n(.*?)```", (ROOT / "README.md").read_text("utf-8"), re.DOTALL)
    examples = [code for code in found if "from scenegate" in code]
    assert examples
    for code in examples:
        replaced = code.replace("127.0.0.1:50051", f"127.0.0.1:{interface(gateway, 'stereo')['port']}")
        replaced = replaced.replace("tcpq://127.0.0.1:7700", hub_of(gateway))
        ran = run(camera_python, "-c", replaced, cwd=tmp_path)
        assert ran.returncode == 0, ran.stderr + replaced


def test_mcap_files_name_their_extra(camera_python: Path, tmp_path: Path) -> None:
    recorded = run(camera_python, "-m", "scenegate", "record", "--mcap", tmp_path / "a.mcap", cwd=tmp_path)
    assert recorded.returncode == 1
    assert "MCAP files need pip install 'scenegate-client[mcap]'" in recorded.stderr
    assert not (tmp_path / "a.mcap").exists()
