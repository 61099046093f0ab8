"""The Python and curl blocks of the documentation, run against a gateway with the demo scene.

Only addresses are replaced, because tests must not use the default ports, and the client's timeout.
"""

import os
import re
import shutil
import subprocess
import sys
import urllib.error
import urllib.request
from pathlib import Path

import cv2
import numpy as np
import pytest

from scenegate.camera.stream import StreamOptions, receive
from tests.conftest import DemoGateway
from tests.docs.pages import PAGES, Block, blocks, commands
from tests.support.liblcm import liblcm
from tests.support.waiting import SECONDS, wait_until

ONE_BY_ONE = [page for page in PAGES if page.parent.name != "tutorial"]
"""Pages whose blocks do not build on each other; ``test_tutorial`` runs the others."""
PYTHON = [block for page in ONE_BY_ONE for block in blocks(page) if block.language == "python"]
CURL = {
    block: [line for line in commands(block) if line.startswith("curl ")]
    for page in ONE_BY_ONE
    for block in blocks(page)
    if "notest" not in block.options and any(line.startswith("curl ") for line in commands(block))
}

EARLIEST_TIME = -2.5
"""The examples' earliest time, seconds from now."""


def get_status(url: str) -> int:
    """Return the status of a response."""
    try:
        with urllib.request.urlopen(url, timeout=SECONDS) as response:
            return int(response.status)
    except urllib.error.HTTPError as error:
        error.close()
        return error.code


@pytest.fixture(scope="module")
def addresses(demo_gateway: DemoGateway) -> dict[str, str]:
    """Return addresses of a gateway by the default address in the pages.

    It has run for as long as the examples go back in time.
    """
    wait_until(lambda: get_status(f"{demo_gateway.url}/scene?time={EARLIEST_TIME}") == 200)
    return {
        "http://127.0.0.1:8000": demo_gateway.url,
        "127.0.0.1:50051": demo_gateway.grpc,
        "127.0.0.1:7700": demo_gateway.tcpq,
    }


def placed(code: str, addresses: dict[str, str]) -> str:
    """Return the code with our addresses, and with our timeout, because the machine may be busy."""
    for theirs, ours in addresses.items():
        code = code.replace(theirs, ours)
    return re.sub(r'(TreeViewer\("[^"]*")', rf"\1, timeout={SECONDS}", code)


@pytest.mark.parametrize("block", [b for b in PYTHON if "notest" not in b.options], ids=str)
def test_python(block: Block, addresses: dict[str, str], tmp_path: Path) -> None:
    interpreter = sys.executable
    if "pydrake" in block.code:
        interpreter = os.environ.get("SCENEGATE_DRAKE_PYTHON", "")
        if not interpreter:
            pytest.skip("SCENEGATE_DRAKE_PYTHON names no interpreter with pydrake")
    elif "import lcm" in block.code:
        liblcm()
    script = tmp_path / "block.py"
    script.write_text(placed(block.code, addresses))
    done = subprocess.run(
        [interpreter, str(script)], cwd=tmp_path, capture_output=True, text=True, timeout=SECONDS, check=False
    )
    assert done.returncode == 0, f"{block}:\n{done.stdout[-1000:]}{done.stderr[-3000:]}"


@pytest.mark.parametrize("block", [b for b in PYTHON if "notest" in b.options], ids=str)
def test_python_that_is_not_run_is_python(block: Block) -> None:
    compile(block.code, str(block), "exec")


@pytest.mark.parametrize(("block", "lines"), CURL.items(), ids=map(str, CURL))
def test_curl(block: Block, lines: list[str], addresses: dict[str, str], tmp_path: Path) -> None:
    if shutil.which("curl") is None:
        pytest.skip("there is no curl on this machine")
    for side in ("left", "right"):
        cv2.imwrite(str(tmp_path / f"{side}.png"), np.full((480, 640), 128, np.uint8))
    for line in lines:
        if "/truth.npz?timestamp=" in line:
            continue  # needs the timestamp of a frame of its own
        if "/truth.npz" in line:  # of the newest frame: there are frames only while a client streams
            list(receive(StreamOptions(addresses["127.0.0.1:50051"], left=True, count=1)))
        command = placed(line, addresses).replace("curl ", "curl --max-time 120 ", 1)
        done = subprocess.run(["bash", "-c", command], cwd=tmp_path, capture_output=True, timeout=SECONDS, check=False)
        assert done.returncode == 0, f"{block}: {line}\n{done.stderr.decode()[-2000:]}"


def test_there_is_something_to_run() -> None:
    """Without code blocks, the tests above would pass."""
    run = [block for block in PYTHON if "notest" not in block.options]
    assert len(run) >= 3
    assert len(CURL) >= 4
