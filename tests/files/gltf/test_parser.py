"""The first documents of a process, read by several threads at once."""

import subprocess
import sys
from pathlib import Path

import pytest

from tests.files.gltf.builder import Builder
from tests.support.waiting import SECONDS

PROGRAM = """
import sys, threading
from gateway.files.gltf import read_gltf
sys.setswitchinterval(1e-6)
data = open(sys.argv[1], "rb").read()
barrier = threading.Barrier(8)
def read():
    barrier.wait()
    assert len(read_gltf(data).lights) == 1
threads = [threading.Thread(target=read) for _ in range(8)]
for thread in threads: thread.start()
for thread in threads: thread.join()
"""


@pytest.mark.slow
def test_first_documents_may_be_read_at_the_same_time(tmp_path: Path) -> None:
    """msgspec crashed in two of three processes while threads made the same decoder."""
    b = Builder()
    b.json["extensions"] = {"KHR_lights_punctual": {"lights": [{"type": "point"}]}}
    b.node(mesh=b.triangle(), extensions={"KHR_lights_punctual": {"light": 0}})
    path = tmp_path / "scene.gltf"
    path.write_bytes(b.text())
    for _ in range(5):
        subprocess.run([sys.executable, "-c", PROGRAM, path], check=True, timeout=SECONDS)
