"""Frames that are rendered at the same time are those that are rendered one after the other."""

import os
import subprocess
import sys

import pytest

from tests.support.waiting import SECONDS


@pytest.mark.slow
def test_concurrent_frames_are_equal_where_freed_memory_is_overwritten() -> None:
    """A kernel that reads memory of a finished frame gives wrong pixels, or ends the process."""
    environment = {**os.environ, "MALLOC_PERTURB_": "165", "PYTHONMALLOC": "malloc"}
    command = (sys.executable, "-m", "tests.renderers.concurrent_frames")
    done = subprocess.run(command, env=environment, capture_output=True, text=True, timeout=SECONDS, check=False)
    assert (done.returncode, done.stderr) == (0, "")
