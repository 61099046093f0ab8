"""The OpenAPI description against the gateway: what it promises is what is answered, errors included."""

from __future__ import annotations

import os
import subprocess
from pathlib import Path

import pytest

from tests.support.waiting import SECONDS

STARTER = os.environ.get("SCENEGATE_SCHEMATHESIS", "")
CONFIG = Path(__file__).with_name("schemathesis.toml")


@pytest.mark.slow
@pytest.mark.skipif(not STARTER, reason="SCENEGATE_SCHEMATHESIS names no Schemathesis ('st')")
def test_every_answer_is_as_described(gateway_url: str, tmp_path: Path) -> None:
    command = [STARTER, "--config-file", str(CONFIG), "run", f"{gateway_url}/openapi.json", "--no-color"]
    command += ["--phases", "examples,coverage,fuzzing", "--max-examples", "10", "--warnings", "off"]
    command += ["--request-timeout", str(int(SECONDS))]
    result = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert result.returncode == 0, result.stdout[-6000:] + result.stderr[-2000:]
    assert "No issues found" in result.stdout or "passed" in result.stdout
