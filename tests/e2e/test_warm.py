"""Nothing is compiled in a serving process: that would stop every interface for seconds."""

from __future__ import annotations

import json
import os
import subprocess
import sys

from tests.support.waiting import SECONDS

PROGRAM = """
import asyncio, json, sys
from gateway import warmup
from gateway.ops import kernels

if not kernels.are_cached():
    asyncio.run(kernels.compile_in_children(warmup.PARTS))
kernels.configure()
from numba.core import event

compiled = []

class Note(event.Listener):
    def on_start(self, event):
        compiled.append(str(event.data["dispatcher"]))

    def on_end(self, event):
        pass

event.register("numba:compile", Note())
warmup.run()
from fastapi.testclient import TestClient
from gateway.app import create_app
from gateway.settings import Settings
from tests.support import forms

settings = Settings(only=("render", "scene", "treeviewer"), demo=True, lcm_url="off", tcpq_port=0, host="127.0.0.1")
answers = []
with TestClient(create_app(settings)) as client:
    for generator in ("VTK", "somebody"):
        for image_type in ("color", "depth", "label"):
            body = forms.body(forms.gltf(generator=generator), forms.drake_fields(image_type))
            answers.append(client.post("/render", content=body, headers={"Content-Type": forms.CONTENT_TYPE}))
            answers.append(client.get("/scene/render", params={"type": image_type}))
print(json.dumps({"compiled": compiled, "answers": [answer.status_code for answer in answers]}))
"""


def test_serving_compiles_nothing() -> None:
    environment = {name: value for name, value in os.environ.items() if name != "PYTEST_CURRENT_TEST"}
    result = subprocess.run(
        [sys.executable, "-c", PROGRAM], env=environment, capture_output=True, text=True, timeout=SECONDS, check=False
    )
    assert result.returncode == 0, result.stderr
    said = json.loads(result.stdout.splitlines()[-1])
    assert said["answers"] == [200] * 12
    assert said["compiled"] == []
