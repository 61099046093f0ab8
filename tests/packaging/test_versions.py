"""The lowest versions of all libraries that pyproject.toml allows, and the newest Python, in environments of their own.

A selection of tests that needs no compiled kernels, which take a minute for each version of NumPy. ``make test-lowest``
runs all fast tests.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

from tests.support.waiting import SECONDS

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
UV = Path(sys.executable).with_name("uv")
SELECTION = (
    "tests/files/assets/mesh_files/test_formats.py",
    "tests/cli/test_serve.py",
    "tests/adapters/render/test_form.py",
    "tests/runtime/http/test_request_bodies.py",
    "tests/runtime/http/test_websocket_protocol.py",
    "tests/runtime/lcm/test_tcpq_hub.py",
    "tests/runtime/settings",
    "tests/runtime/state/test_database.py",
    "tests/adapters/stereo/stream/test_image_messages.py",
)


def run(*command: str | Path) -> subprocess.CompletedProcess[str]:
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONPATH"}
    return subprocess.run(
        command, cwd=ROOT, env=environment, capture_output=True, text=True, timeout=SECONDS, check=False
    )


def newest_python() -> str:
    """Return the path of Python 3.14; skip where there is none."""
    if found := shutil.which("python3.14"):
        return found
    searched = run(UV, "python", "find", "--no-python-downloads", "3.14")
    if searched.returncode:
        pytest.skip("there is no Python 3.14")
    return searched.stdout.strip()


@pytest.mark.parametrize("resolution", ["lowest-direct", "highest"])
def test_other_versions(tmp_path: Path, resolution: str) -> None:
    python = sys.executable if resolution == "lowest-direct" else newest_python()
    environment = tmp_path / "environment" / "bin" / "python"
    made = run(UV, "venv", "--quiet", "--python", python, tmp_path / "environment")
    assert made.returncode == 0, made.stderr
    into = ("pip", "install", "--quiet", "--python", environment)
    libraries = run(UV, *into, "--resolution", resolution, "--editable", ".[robots]")
    tools = run(UV, *into, "pytest", "pytest-asyncio", "hypothesis", "httpx2", "ruamel.yaml", "tifffile")
    if libraries.returncode or tools.returncode:
        pytest.skip(f"the libraries cannot be installed: {(libraries.stderr + tools.stderr)[-200:]}")
    # Old libraries use what newer ones, which they do not limit, deprecate.
    ignored = ("-W", "ignore::DeprecationWarning")
    tested = run(environment, "-m", "pytest", "-q", *ignored, "-m", "not slow", "-p", "no:cacheprovider", *SELECTION)
    assert tested.returncode == 0, tested.stdout[-4000:] + tested.stderr[-1000:]
