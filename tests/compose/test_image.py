"""The tests' image without an engine: its command in a folder and an environment that hold what its Dockerfile puts in.

A module, file or package that the tests need and the image lacks fails here as it would in the container.
"""

import json
import os
import random
import re
import shutil
import subprocess
import sysconfig
import venv
from importlib.metadata import distributions
from pathlib import Path

import pytest

from tests.support.gateway_process import gateway_process
from tests.support.waiting import SECONDS

pytestmark = [
    pytest.mark.slow,
    pytest.mark.skipif("SCENEGATE_URL" in os.environ, reason="the tests in the container may be these"),
]

ROOT = Path(__file__).parents[2]
DOCKERFILE = Path(__file__).with_name("Dockerfile")


def instructions() -> list[tuple[str, str]]:
    """Name and arguments of each instruction of the Dockerfile, continued lines joined."""
    lines = [line for line in DOCKERFILE.read_text().splitlines() if line.strip() and not line.startswith("#")]
    joined = re.sub(r"\\\n", " ", "\n".join(lines))
    return [(name, arguments) for name, _, arguments in (line.partition(" ") for line in joined.splitlines())]


def copied(folder: Path) -> None:
    """Does what the COPY instructions do, into ``folder`` as the working directory of the image."""
    for name, arguments in instructions():
        if name != "COPY":
            continue
        *sources, target = arguments.split()
        assert not target.startswith("/"), f"COPY {arguments}: only paths below WORKDIR are understood here"
        for source in sources:
            assert not source.startswith("--"), f"COPY {arguments}: options are not understood here"
            into = folder / target
            if (ROOT / source).is_dir():
                shutil.copytree(ROOT / source, into, ignore=shutil.ignore_patterns("__pycache__"))
            else:
                shutil.copy2(ROOT / source, into / source if target.endswith("/") else into)


def installed(folder: Path) -> Path:
    """Makes an environment of the packages in the locks that the image installs; returns its interpreter.

    The packages are links to those of the interpreter that runs the tests, so that nothing is downloaded. Scenegate
    itself is in no lock, and so is not there.
    """
    runs = " ".join(arguments for name, arguments in instructions() if name == "RUN")
    (lock,) = re.findall(r"--python /opt/tests/bin/python --require-hashes -r (\S+)", runs)
    pinned = set(re.findall(r"^([\w.-]+)==", (ROOT / lock).read_text(), re.MULTILINE))
    venv.create(folder, symlinks=True, with_pip=False)
    site = Path(sysconfig.get_path("purelib", vars={"base": str(folder), "platbase": str(folder)}))
    for distribution in distributions():
        if re.sub(r"[-_.]+", "-", distribution.metadata["Name"]).lower() not in pinned:
            continue
        for top in {path.parts[0] for path in distribution.files or () if path.parts[0] not in ("..", "__pycache__")}:
            if not (site / top).exists():
                (site / top).symlink_to(str(distribution.locate_file(top)))
    return folder / "bin" / "python"


@pytest.mark.slow
def test_the_tests_of_the_image_pass_with_what_it_holds(tmp_path: Path) -> None:
    held = tmp_path / "tests"
    held.mkdir()
    copied(held)
    python = installed(tmp_path / "environment")
    (command,) = (json.loads(arguments) for name, arguments in instructions() if name == "CMD")
    assert command[0] == "python"
    network = f"udpm://239.255.76.67:{random.randrange(20000, 60000)}?ttl=0"
    with gateway_process("--demo", "--grpc-port", "0", "--tcpq-port", "0", "--lcm-url", network) as (_, url):
        environment = {"PATH": os.environ["PATH"], "HOME": str(tmp_path), "SCENEGATE_URL": url}
        command = [str(python), *command[1:], "--basetemp", str(tmp_path / "files")]
        ran = subprocess.run(
            command, cwd=held, env=environment, capture_output=True, text=True, timeout=SECONDS, check=False
        )
    assert ran.returncode == 0, ran.stdout[-8000:] + ran.stderr[-4000:]
    assert re.search(r"\b[1-9]\d* passed", ran.stdout), ran.stdout[-4000:]


def test_scenegate_is_not_in_the_image(tmp_path: Path) -> None:
    python = installed(tmp_path)
    found = "import importlib.util as u; print(*(u.find_spec(n) is not None for n in ('gateway', 'renderers', 'grpc')))"
    ran = subprocess.run([python, "-c", found], cwd=tmp_path, capture_output=True, text=True, check=True)
    assert ran.stdout.split() == ["False", "False", "True"]
