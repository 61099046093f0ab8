"""Nothing is compiled in a serving process: that would stop every interface for seconds."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from gateway.runtime.kernels import parts
from tests.support.waiting import SECONDS

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
LOAD_ALL = """
parts.load_needed()
with pending.announced({name: part.has_kernel for name, part in parts.BACKGROUND.items()}):
    for part in parts.BACKGROUND:
        parts.load_background(part)
"""
PROGRAM = """
import json, sys
from renderers.compiler import pending
from gateway.runtime.kernels import cache, parts

parts.ensure_compiled()
from numba.core import event

compiled = []

class Note(event.Listener):
    def on_start(self, event):
        compiled.append(str(event.data["dispatcher"]))

    def on_end(self, event):
        pass

event.register("numba:compile", Note())
LOAD_ALL
from fastapi.testclient import TestClient
from gateway.app import create_app
from gateway.runtime.settings import Settings
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


def said_by(program: str, *arguments: str | Path, folder: Path | None = None) -> dict[str, Any]:
    environment = {name: value for name, value in os.environ.items() if name != "PYTEST_CURRENT_TEST"}
    command = [sys.executable, "-c", program.replace("LOAD_ALL", LOAD_ALL), *map(str, arguments)]
    result = subprocess.run(
        command, cwd=folder, env=environment, capture_output=True, text=True, timeout=SECONDS, check=False
    )
    assert result.returncode == 0, result.stderr
    said: dict[str, Any] = json.loads(result.stdout.splitlines()[-1])
    return said


def test_serving_compiles_nothing() -> None:
    said = said_by(PROGRAM)
    assert said["answers"] == [200] * 12
    assert said["compiled"] == []


ELSEWHERE = """
import json
import gateway
from renderers.compiler import pending
from gateway.runtime.kernels import cache, parts

cached = cache.are_cached()
LOAD_ALL
from renderers.compiler import cache_folder as kernel_cache
from renderers.compiler.cache_locator import CACHED_KERNELS, folder_of
from renderers.compiler.jit import KERNELS

manifest = json.loads((kernel_cache.folder() / "complete.json").read_bytes())
listed = [name.split("/")[0] for part in manifest.values() for name in part if name.endswith(".nbi")]

total = lambda name: sum(sum(getattr(kernel.stats, name).values()) for kernel in CACHED_KERNELS)
print(json.dumps({
    "where": gateway.__file__,
    "cached": cached,
    "hits": total("cache_hits"),
    "misses": total("cache_misses"),
    "parts": list(manifest),
    "listed": sorted(listed),
    "defined": sorted(folder_of(kernel).name for kernel in CACHED_KERNELS),
    "loaded": [len(kernel.stats.cache_hits) for kernel in KERNELS],
}))
"""


def test_a_copy_of_the_sources_at_another_place_loads_the_same_kernels(tmp_path: Path) -> None:
    """A second clone, wheel or container layer: other paths, other times, the same contents."""
    filled = subprocess.run([sys.executable, "-m", "scenegate", "warmup"], capture_output=True, text=True, check=False)
    assert filled.returncode == 0, filled.stderr
    for package in ("gateway", "renderers"):
        ignored = shutil.ignore_patterns("__pycache__", "node_modules")
        shutil.copytree(ROOT / package, tmp_path / package, ignore=ignored, copy_function=shutil.copyfile)
    said = said_by(ELSEWHERE, folder=tmp_path)
    assert said["where"] == str(tmp_path / "gateway" / "__init__.py")
    assert said["cached"]
    assert said["misses"] == 0
    assert said["hits"] >= len(said["loaded"]) > 0
    assert set(said["loaded"]) == {1}
    assert sorted(said["parts"]) == sorted(parts.PARTS)
    assert said["listed"] == said["defined"]  # every kernel, each by one part


def test_a_cache_that_lost_a_kernel_is_not_complete_and_the_server_does_not_compile_it(tmp_path: Path) -> None:
    """The manifest is left in place, as by a copy that failed: only loading shows that the index has other entries."""
    program = """
import json, shutil, sys
from pathlib import Path
from gateway.runtime.kernels import cache, parts
from renderers.compiler import cache_folder as kernel_cache

parts.ensure_compiled()
here = kernel_cache.folder()
copy = Path(sys.argv[1])
shutil.copytree(here, copy / here.name)
kernel_cache.root.cache_clear()
import os
os.environ["NUMBA_CACHE_DIR"] = str(copy)
lost = next((copy / here.name).glob("renderers.raster.setup.*"))
for file in lost.iterdir():
    file.unlink()
before = kernel_cache.missing()
kernel_cache.missing = lambda path=None: ""  # as if nobody had looked
try:
    parts.load_needed()
    error = ""
except cache.KernelError as failure:
    error = str(failure)
manifest = (copy / here.name / "complete.json").exists()
print(json.dumps({"before": before, "error": error, "lost": lost.name, "manifest": manifest}))
"""
    said = said_by(program, tmp_path)
    assert "files are missing or changed" in said["before"]
    assert f"the kernel {said['lost']} could not be loaded from" in said["error"]
    assert not said["manifest"]
