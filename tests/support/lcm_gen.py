"""LCM's generator of classes, ``lcm-gen``."""

import subprocess
import sys
from pathlib import Path

import pytest

LCM_TYPES = Path(__file__).parents[2] / "lcmtypes"


def generate(folder: Path, pattern: str) -> None:
    """Write the Python classes of our definitions into a folder; skip the calling test where that is impossible."""
    generator = Path(sys.executable).with_name("lcm-gen")
    if not generator.exists():
        pytest.skip("lcm-gen is not beside this Python")
    command: list[str | Path] = [generator, "-p", "--ppath", folder, *sorted(LCM_TYPES.glob(pattern))]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if "error while loading shared libraries" in done.stderr:
        pytest.skip("lcm-gen needs libglib-2.0.so.0")
    assert done.returncode == 0, done.stderr
