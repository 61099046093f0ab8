"""What a publisher in another process or container sees: its messages are answered, its scene can be pictured."""

from __future__ import annotations

import os
import random
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import cv2
import httpx2
import numpy as np
import pytest

from tests.support.gateway_process import gateway_process

pytestmark = [pytest.mark.compose, pytest.mark.lcm]

PUBLISHER = Path(__file__).parents[2] / "examples" / "publish_tree.py"


@pytest.fixture(scope="module")
def base() -> Iterator[str]:
    """Base URL of a gateway with a tree viewer, on an LCM network of its own when it is started here."""
    given = os.environ.get("SCENEGATE_URL")
    if given:
        yield given.rstrip("/")
        return
    network = f"udpm://239.255.76.67:{random.randrange(20000, 60000)}?ttl=0"
    with gateway_process("--only", "scene,treeviewer", "--tcpq-port", "0", "--lcm-url", network) as (_, started):
        yield started


def networks(base: str) -> dict[str, Any]:
    """What the gateway says of its two ways in."""
    found: dict[str, Any] = httpx2.get(f"{base}/healthz").json()["interfaces"]["treeviewer"]
    return found


def publish(network: str, base: str, picture: Path) -> np.ndarray:
    """Runs the publisher as a process of its own; the picture that it took in the end, (H, W, 3) RGB."""
    command = [sys.executable, str(PUBLISHER), network, base, str(picture)]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr
    bgr = cv2.imread(str(picture))
    assert bgr is not None
    return bgr[..., ::-1].astype(int)


def check(base: str, picture: np.ndarray) -> None:
    """The orange arm and the blue-grey base are to be seen and listed, the arm where the last message put it."""
    red, green, blue = (picture[..., i] for i in range(3))
    arm = (red > 150) & (green > 80) & (blue < 80)
    foot = (blue > red) & (blue < 120) & (red > 10)
    assert arm.sum() > 500
    assert foot.sum() > 500
    assert np.nonzero(arm)[0].mean() < np.nonzero(foot)[0].mean(), "the arm stands on the base"
    nodes = {tuple(node["path"]): node for node in httpx2.get(f"{base}/scene").json()["nodes"]}
    assert ("robot", "base") in nodes
    assert ("robot", "shoulder", "arm") in nodes


def test_over_tcpq(base: str, tmp_path: Path) -> None:
    pytest.importorskip("lcm", reason="LCM cannot be imported: it needs libglib-2.0.so.0", exc_type=ImportError)
    port = urlsplit(networks(base)["tcpq"]["url"]).port
    picture = publish(f"tcpq://{urlsplit(base).hostname}:{port}", base, tmp_path / "robot.png")
    check(base, picture)


def test_over_multicast(base: str, tmp_path: Path) -> None:
    lcm = pytest.importorskip("lcm", reason="LCM cannot be imported: it needs libglib-2.0.so.0", exc_type=ImportError)
    state = networks(base)["lcm"]
    if "problem" in state:
        pytest.skip(f"the gateway has no multicast: {state['problem']}")
    try:
        lcm.LCM(state["url"])
    except RuntimeError:
        pytest.skip(f"LCM cannot join {state['url']}: there is no route for multicast")
    picture = publish(state["url"], base, tmp_path / "robot.png")
    check(base, picture)
