"""The tree viewer from another process or container: messages get responses, the scene can be rendered."""

import socket
import subprocess
import sys
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import cv2
import numpy as np
import pytest

from tests.support import clients
from tests.support.liblcm import liblcm
from tests.support.waiting import SECONDS

pytestmark = [pytest.mark.compose, pytest.mark.lcm]

PUBLISHER = Path(__file__).parent / "publisher.py"


def publish(network: str, url: str, picture: Path) -> np.ndarray:
    """Runs the publisher as a process of its own; the picture that it took in the end, (H, W, 3) RGB."""
    command = [sys.executable, str(PUBLISHER), network, url, str(picture)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert done.returncode == 0, done.stderr
    bgr = cv2.imread(str(picture))
    assert bgr is not None
    return bgr[..., ::-1].astype(int)


def check(url: str, picture: np.ndarray) -> None:
    """The orange arm and the blue-grey base are to be seen and listed, the arm where the last message put it."""
    red, green, blue = (picture[..., i] for i in range(3))
    arm = (red > 150) & (green > 80) & (blue < 80)
    foot = (blue > red) & (blue < 120) & (red > 10)
    assert arm.sum() > 500
    assert foot.sum() > 500
    assert np.nonzero(arm)[0].mean() < np.nonzero(foot)[0].mean(), "the arm stands on the base"
    nodes = {tuple(node["path"]): node for node in clients.get(f"{url}/scene").json()["nodes"]}
    assert ("robot", "base") in nodes
    assert ("robot", "shoulder", "arm") in nodes


def test_over_tcpq(url: str, interfaces: dict[str, Any], tmp_path: Path) -> None:
    liblcm()
    port = urlsplit(interfaces["treeviewer"]["tcpq"]["url"]).port
    # liblcm does not resolve names: it says "Connection refused" for tcpq://gateway:7700.
    address = socket.gethostbyname(urlsplit(url).hostname or "")
    picture = publish(f"tcpq://{address}:{port}", url, tmp_path / "robot.png")
    check(url, picture)


def test_over_multicast(url: str, interfaces: dict[str, Any], tmp_path: Path) -> None:
    lcm = liblcm()
    state = interfaces["treeviewer"]["lcm"]
    if "problem" in state:
        pytest.skip(f"the gateway has no multicast: {state['problem']}")
    try:
        lcm.LCM(state["url"])
    except RuntimeError:
        pytest.skip(f"LCM cannot join {state['url']}: there is no route for multicast")
    picture = publish(state["url"], url, tmp_path / "robot.png")
    check(url, picture)
