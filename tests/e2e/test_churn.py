"""Well-behaved, slow, half-open and vanishing clients of every interface leave no resources behind.

The short form of ``python -m tests.soak --parts churn``.
"""

from pathlib import Path

import pytest

from tests.soak import __main__ as soak
from tests.soak import clients as soak_clients


@pytest.mark.slow
async def test_nothing_is_left_of_a_hundred_clients(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(soak_clients, "HELD_SECONDS", 0.2)
    async with soak.gateway(tmp_path / "state") as running:
        left, outcomes = await soak.churn(running, 100)
    assert running.process.returncode == 0
    assert {name: count for name, count in left.items() if count > 0} == {}
    assert outcomes["well-behaved"] == outcomes["vanishing"] == 25, outcomes
