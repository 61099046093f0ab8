"""Successive lines of OBJ files are read at once where they are regular, with the same result as line by line."""

from typing import Any

from hypothesis import given
from hypothesis import strategies as st

from gateway.files.parsers.mesh import read_mesh

OPTIONS = dict.fromkeys(("max_vertices", "max_elements", "max_instances", "max_drawn_elements"), 1000)
LINES = (
    *(
        "v 0 0 0",
        "v 1 0 0 1",
        "v 1 1 0 1 0 0.5",
        "v  0 1\t0",
        "v 1 0 0 1 0 0",
        "vt 0 1",
        "vt 0.5",
        "vn 0 0 1",
        "vn 1 0",
    ),
    *("f 1 2 3", "f 1/1 2/2 3/1", "f 1//1 2//1 3//1", "f 1 2 3 4", "f -1 -2 -3", "f 1 2", "f 1 2 9", "f 1 x 3"),
    *("usemtl red", "g one", "g two", "", "v 0 0 \\\n 2", "s 1", "l 1 2"),
)
CORNERS = ("v 0 0 0", "v 1 0 0", "v 1 1 0", "v 0 1 0")


def read(lines: list[str], submesh: str, end: str) -> Any:
    data = "".join(line + end for line in (*CORNERS, *lines)).encode()
    return read_mesh(lambda _: b"", data, "obj", {**OPTIONS, "max_node_depth": 10, "submesh": submesh})


def comparable(result: Any) -> Any:
    """Return all but the text of a left out face."""
    return result.partition("such as")[0] if isinstance(result, str) else (result.shapes, len(result.warnings))


@given(
    st.lists(st.tuples(st.sampled_from(LINES), st.integers(1, 4)).map(lambda each: [each[0]] * each[1]), max_size=12),
    st.sampled_from(("", "two")),
)
def test_runs_of_lines_are_read_as_single_lines_are(runs: list[list[str]], submesh: str) -> None:
    lines = [line for run in runs for line in run]
    assert comparable(read(lines, submesh, "\n")) == comparable(read(lines, submesh, " # by itself\n"))


def test_faces_of_a_run_keep_their_lines() -> None:
    result = read(["f 1 2 3", "f 1 2 3", "f 1 2 9", "f 1 2 3"], "", "\n")
    assert "line 7" in result.warnings[0]
