"""The plan of ``gateway/``: few rooms, on few floors, with few imports between them.

``python -m tests.rules.test_rooms`` prints the rooms and the arrows between them.
"""

import ast
import tomllib
from collections.abc import Iterator
from pathlib import Path

ROOT = Path(__file__).parents[2]
MAX_ROOMS = 10
MAX_FLOORS = 8
MAX_ARROWS = 38


def imported_modules(path: Path) -> Iterator[str]:
    """Yield the full names of what a file imports, also inside functions."""
    for node in ast.walk(ast.parse(path.read_text())):
        if isinstance(node, ast.ImportFrom) and node.module:
            yield from (f"{node.module}.{alias.name}" for alias in node.names)
        elif isinstance(node, ast.Import):
            yield from (alias.name for alias in node.names)


def arrows() -> set[tuple[str, str]]:
    """Return the pairs (room, room that it imports) of ``gateway/``, where ``app.py`` is a room, too."""
    found = set()
    rooms = {path.stem for path in (ROOT / "gateway").iterdir() if not path.name.startswith("_")}
    for path in (ROOT / "gateway").rglob("*.py"):
        room = path.relative_to(ROOT / "gateway").parts[0].removesuffix(".py")
        for module in imported_modules(path):
            package, _, rest = module.partition(".")
            target = rest.partition(".")[0]
            if package == "gateway" and target in rooms - {room}:
                found.add((room, target))
    return found


def test_gateway_has_few_rooms_floors_and_arrows() -> None:
    contracts = tomllib.loads((ROOT / "pyproject.toml").read_text())["tool"]["importlinter"]["contracts"]
    floors = [floor for floor in contracts[0]["layers"] if "gateway." in floor]
    rooms = [path for path in (ROOT / "gateway").iterdir() if (path / "__init__.py").exists()]
    assert len(rooms) <= MAX_ROOMS
    assert len(floors) <= MAX_FLOORS
    assert len(arrows()) <= MAX_ARROWS


if __name__ == "__main__":
    for source, target in sorted(arrows()):
        print(f"{source} -> {target}")
    print(len(arrows()), "arrows")
