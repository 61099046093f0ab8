"""LCM's own library, if it is installed."""

from typing import Any

import pytest


def liblcm() -> Any:
    """The module ``lcm``; skips the test where it cannot be imported."""
    return pytest.importorskip("lcm", reason="LCM cannot be imported: it needs libglib-2.0.so.0", exc_type=ImportError)
