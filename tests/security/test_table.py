"""README.md of this folder names tests; they must exist."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]
ROWS = [
    line.split(" | ")
    for line in Path(__file__).with_name("README.md").read_text("utf-8").splitlines()
    if line.startswith("| ") and not line.startswith(("| input", "| ---"))
]


def test_table_exists() -> None:
    assert len(ROWS) > 20


@pytest.mark.parametrize("row", ROWS, ids=[row[0][2:40] for row in ROWS])
def test_every_named_test_exists(row: list[str]) -> None:
    named = re.findall(r"`(tests/\S+\.py)::(\w+)`", row[-1])
    assert named
    assert row[-1].count("`") == 2 * len(named)
    for path, test in named:
        tree = ast.parse((ROOT / path).read_text("utf-8"))
        known = {node.name for node in tree.body if isinstance(node, (ast.FunctionDef, ast.AsyncFunctionDef))}
        assert test in known, f"{path} has no {test}"
