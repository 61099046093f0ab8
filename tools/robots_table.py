"""Read the robot files of packages, and write the table of docs/robots.md.

    python -m tools.robots_table FOLDER [--write docs/robots.md]

FOLDER has a folder for each package, as ``pip install --no-deps --target FOLDER/NAME NAME==VERSION`` makes it.
"""

import argparse
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from gateway.files.robots.reader import read_robot
from scenegate.robots.robot_errors import RobotFileError

PATTERNS: Final = ("*.urdf", "*.sdf")
START: Final = "<!-- robots: python -m tools.robots_table -->\n"
END: Final = "<!-- end of robots -->\n"


@dataclass(slots=True)
class Package:
    """Results of a package's robot files."""

    name: str
    counts: Counter[str] = field(default_factory=Counter)
    """Number of files by result: ``drawn``, ``warned`` and ``refused``."""
    refusals: dict[str, str] = field(default_factory=dict)
    """Reason by file name."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0] if __doc__ else None)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--write", type=Path, metavar="PAGE", help="page whose table is replaced")
    options = parser.parse_args()
    table = "".join(table_of([read_package(folder) for folder in sorted(options.folder.iterdir()) if folder.is_dir()]))
    print(table)
    if options.write is not None:
        before, _, rest = options.write.read_text().partition(START)
        options.write.write_text(f"{before}{START}\n{table}\n{END}{rest.partition(END)[2]}")


def read_package(folder: Path) -> Package:
    """Read all robot files of a package."""
    package = Package(folder.name)
    for path in sorted(path for pattern in PATTERNS for path in folder.rglob(pattern)):
        try:
            robot = read_robot(path)
        except RobotFileError as error:
            package.counts["refused"] += 1
            package.refusals[path.name] = str(error).rpartition(f"{path.name}: ")[2]
        else:
            package.counts["warned" if robot.warnings else "drawn"] += 1
    return package


def table_of(packages: list[Package]) -> Iterator[str]:
    """Yield the lines of a Markdown table."""
    yield "| package | files | drawn without warning | with warnings | refused |\n|---|---|---|---|---|\n"
    for package in packages:
        counts = package.counts
        refused = "; ".join(f"`{name}`: {reason}" for name, reason in package.refusals.items())
        cell = f"{counts['refused']}: {refused}" if refused else "0"
        yield f"| {package.name} | {counts.total()} | {counts['drawn']} | {counts['warned']} | {cell} |\n"


if __name__ == "__main__":
    main()
