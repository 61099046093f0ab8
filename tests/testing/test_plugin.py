"""The plugin in a pytest process of its own, with the example of its documentation page."""

import re
import subprocess
import sys
from pathlib import Path

import pytest

from renderers.compiler import cache_folder
from tests.support.waiting import SECONDS

pytest_plugins = ["pytester"]

PAGE = Path(__file__).parents[2] / "docs" / "testing.md"
PATIENT = ("-o", f"scenegate_seconds={SECONDS:g}")
ARGUMENTS = ("-p", "scenegate.testing", "-W", "error", "-p", "no:cacheprovider", "-p", "no:asyncio", *PATIENT)


@pytest.fixture(autouse=True)
def _kernels_of_this_user(monkeypatch: pytest.MonkeyPatch) -> None:
    """``pytester`` has a home of its own, in which each test would compile the kernels."""
    monkeypatch.setenv("NUMBA_CACHE_DIR", str(cache_folder.root()))


def example() -> str:
    found = re.search(r"```python\n(.*?)```", PAGE.read_text("utf-8"), re.DOTALL)
    return found[1]


@pytest.mark.slow
def test_example_of_the_documentation(pytester: pytest.Pytester, monkeypatch: pytest.MonkeyPatch) -> None:
    """Also where HTTP goes through a proxy, which is out of reach here."""
    monkeypatch.setenv("http_proxy", "http://127.0.0.1:9")
    pytester.makepyfile(test_cell=example())
    pytester.runpytest_subprocess(*ARGUMENTS, timeout=SECONDS).assert_outcomes(passed=3)


@pytest.mark.slow
def test_a_project_may_have_a_gateway_of_its_own(tmp_path: Path) -> None:
    for name in ("gateway", "renderers"):
        (tmp_path / f"{name}.py").write_text("VALVE = 1\n")
    test = "import gateway, renderers\ndef test_it(scenegate):\n    assert gateway.VALVE and scenegate.health()\n"
    (tmp_path / "test_project.py").write_text(test)
    command = (sys.executable, "-m", "pytest", "-q", *ARGUMENTS)
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert done.returncode == 0, done.stdout


@pytest.mark.slow
def test_scenes_flags_and_failure_reports(pytester: pytest.Pytester) -> None:
    box = '{"setgeometry": [{"path": ["from the file"], "geometry": {"type": "box", "lengths": [1, 1, 1]}}]}'
    pytester.makefile(".json", scene=box, other=box.replace("file", "marker"))
    pytester.makefile(".obj", mesh="v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n")
    pytester.makeini("[pytest]\nscenegate_scene = scene.json\nscenegate_flags = --only scene,treeviewer\n")
    pytester.makepyfile(
        """
        import json, os, pytest

        seen = {}

        def paths(scenegate):
            return json.dumps(scenegate.scene())

        def test_scene_of_the_project(scenegate):
            seen["first"] = scenegate.process.pid
            assert "from the file" in paths(scenegate)
            scenegate.publish({"delete": [{"path": []}]})

        @pytest.mark.scenegate(scene="other.json")
        def test_scene_of_the_test(scenegate):
            assert scenegate.process.pid == seen["first"]
            assert "from the marker" in paths(scenegate)
            assert "from the file" not in paths(scenegate)

        @pytest.mark.scenegate(scene="mesh.obj", fresh=True)
        def test_mesh(scenegate):
            assert scenegate.process.pid != seen["first"]
            assert '"scene"' in paths(scenegate)
            assert "stereo" not in scenegate.health()["interfaces"]

        def test_that_fails(scenegate):
            scenegate.get("/scene?never")
            assert False, "on purpose"

        @pytest.mark.scenegate(scene="nowhere.json")
        def test_without_its_scene(scenegate):
            pass

        @pytest.mark.scenegate(sceen="other.json")
        def test_with_a_typing_error(scenegate):
            pass

        def test_that_kills_it(scenegate):
            scenegate.process.kill()
            scenegate.process.wait()

        def test_after_it_was_killed(scenegate):
            assert scenegate.process.pid != seen["first"]

        @pytest.mark.scenegate("--no-such-flag")
        def test_that_cannot_start(scenegate):
            pass
        """
    )
    result = pytester.runpytest_subprocess(*ARGUMENTS, timeout=SECONDS)
    result.assert_outcomes(passed=5, failed=1, errors=3)
    result.stdout.fnmatch_lines(["*scenegate log*", '*"path": "/scene"*'])
    result.stdout.fnmatch_lines(["*the scene *nowhere.json does not exist*"])
    result.stdout.fnmatch_lines(["*the marker scenegate has no argument sceen*"])
    result.stdout.fnmatch_lines(["*the gateway ended with exit code 2*"])


def test_plugin_imports_nothing_but_pytest() -> None:
    code = "import sys; before = set(sys.modules); import pytest; known = set(sys.modules)\n"
    code += "import scenegate.testing\nprint(*sorted(set(sys.modules) - known))"
    result = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert result.stdout.split() == ["scenegate", "scenegate.testing"]
