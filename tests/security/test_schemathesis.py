"""The OpenAPI description against the responses of a gateway, errors included."""

import os
import re
import shutil
import subprocess
from pathlib import Path

import pytest

from tests.support.waiting import SECONDS

STARTER = os.environ.get("SCENEGATE_SCHEMATHESIS", "")
FOLDER = Path(__file__).parent


@pytest.mark.slow
@pytest.mark.skipif(not STARTER, reason="SCENEGATE_SCHEMATHESIS names no Schemathesis ('st')")
def test_every_response_is_as_described(gateway_url: str, tmp_path: Path) -> None:
    for name in ("schemathesis.toml", "schemathesis_hooks.py"):
        shutil.copy(FOLDER / name, tmp_path)
    command = [STARTER, "--config-file", "schemathesis.toml", "run", f"{gateway_url}/openapi.json", "--no-color"]
    command += ["--checks", "all", "--phases", "examples,coverage,fuzzing", "--max-examples", "10"]
    command += ["--request-timeout", str(int(SECONDS))]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert result.returncode == 0, result.stdout[-6000:] + result.stderr[-2000:]
    assert re.search(r"(\d+) generated, \1 passed", result.stdout), result.stdout[-2000:]
    untried = result.stdout.partition(" WARNINGS ")[2].partition(" SUMMARY ")[0]
    # The truth needs a frame, which exists if an earlier test had a client of the image stream.
    # Changes of what the computer decides are always refused.
    refused = re.compile(r"P\w+ /api/v[12]/system/(dns|ntp|network/settings|license|update|rollback)")
    names = {name for name in re.findall(r"^  - (.*)$", untried, re.MULTILINE) if not refused.fullmatch(name)}
    assert names <= {"GET /stereo/truth.npz"}, untried
