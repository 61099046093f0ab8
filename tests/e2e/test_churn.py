"""Well-behaved, slow, half-open and vanishing clients of every interface: nothing of them is left.

The short form of ``python -m bench.soak --parts churn``.
"""

from __future__ import annotations

from pathlib import Path

import pytest

from bench import soak, soak_clients


async def test_nothing_is_left_of_a_hundred_clients(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(soak_clients, "HELD_SECONDS", 0.2)
    async with soak.gateway(tmp_path / "state") as running:
        for _ in range(2):  # what is made once, when it is first needed, may come late; a leak comes again
            counts, outcomes = await soak.churn(running, 100)
            left = {name: count for name, count in counts.items() if count > 0}
            if not left:
                break
    assert running.process.returncode == 0
    assert left == {}
    assert outcomes["well-behaved"] == outcomes["vanishing"] == 25, outcomes
