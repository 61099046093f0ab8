"""Files that publish: workflows, what they run, and what names the version."""

import re
import shutil
import subprocess
from pathlib import Path

import pytest
from ruamel.yaml import YAML

from tests.support.waiting import SECONDS
from tools import hatch_build

ROOT = Path(__file__).parents[2]
WORKFLOWS = sorted((ROOT / ".github" / "workflows").glob("*.yml"))


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.stem)
def test_actions_are_named_by_commit(workflow: Path) -> None:
    used = re.findall(r"uses: (.*)", workflow.read_text())
    assert [each for each in used if not re.fullmatch(r"[\w-]+/[\w-]+@[0-9a-f]{40} # v\d+\.\d+\.\d+", each)] == []


@pytest.mark.parametrize("workflow", WORKFLOWS, ids=lambda path: path.stem)
def test_steps_are_recipes(workflow: Path) -> None:
    """Beside preparations of the machine."""
    recipes = set(re.findall(r"^([a-z-]+):", (ROOT / "Makefile").read_text(), re.MULTILINE))
    jobs = YAML(typ="safe").load(workflow)["jobs"].values()
    for command in (step["run"] for job in jobs for step in job["steps"] if "run" in step):
        name, _, argument = command.partition(" ")
        assert name in ("make", ".ci/run", "apt-get", "docker", "git"), command
        assert name != "make" or argument.split()[0] in recipes, command


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("[a](docs/a.md#b)", "[a](https://h/o/r/blob/HEAD/docs/a.md#b)"),
        ("![a](docs/a.webp)", "![a](https://h/o/r/blob/HEAD/docs/a.webp?raw=true)"),
        ('<img src="docs/a.gif">', '<img src="https://h/o/r/blob/HEAD/docs/a.gif?raw=true">'),
        ("[![a](a.svg)](b.md)", "[![a](https://h/o/r/blob/HEAD/a.svg?raw=true)](https://h/o/r/blob/HEAD/b.md)"),
        ("[a](https://x/y) [b](#c)", "[a](https://x/y) [b](#c)"),
    ],
)
def test_links_of_the_readme_lead_to_the_repository(text: str, expected: str) -> None:
    assert hatch_build.with_absolute_links(text, "https://h/o/r/") == expected
    assert hatch_build.with_absolute_links(text, "") == text


def test_kustomization_can_be_built() -> None:
    if shutil.which("kubectl") is None:
        pytest.skip("there is no kubectl")
    command = ["kubectl", "kustomize", "deploy/kubernetes"]
    built = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert built.returncode == 0, built.stderr
    kinds = {each["kind"] for each in YAML(typ="safe").load_all(built.stdout)}
    assert kinds == {"Deployment", "Service", "HorizontalPodAutoscaler", "PodDisruptionBudget"}


def test_pods_run_the_render_role_without_privileges() -> None:
    pod = YAML(typ="safe").load(ROOT / "deploy/kubernetes/deployment.yaml")["spec"]["template"]["spec"]
    (container,) = pod["containers"]
    assert container["args"][:3] == ["serve", "--only", "render"]
    assert container["securityContext"] == {
        "allowPrivilegeEscalation": False,
        "readOnlyRootFilesystem": True,
        "capabilities": {"drop": ["ALL"]},
    }
    user = re.search(r"--uid (\d+) scenegate", (ROOT / "deploy" / "Dockerfile").read_text())
    assert pod["securityContext"]["runAsUser"] == int(user[1])
