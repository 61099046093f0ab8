"""The generated page of limits: numbers, escapes, and which texts belong to which names."""

import ast

import pytest

from tools.docs_pages.limits_page import _docstrings, _number, _row


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0, "0"),
        (1023, "1,023"),
        (1024, "1 Ki"),
        (1025, "1,025"),
        (3 << 20, "3 Mi"),
        (1 << 30, "1 Gi"),
        ((1 << 30) + 1024, "1048577 Ki"),
        (10_000_000, "10,000,000"),
        (0.5, "0.5"),
        (30.0, "30"),
    ],
)
def test_numbers_as_text(value: float, text: str) -> None:
    assert _number(value) == text


def test_a_bar_in_a_text_is_escaped() -> None:
    assert _row("name", "1", "a | b") == "| `name` | 1 | a \\| b |"


def test_a_text_need_not_say_maximum() -> None:
    assert _row("name", "1", "Maximum number of links, and of joints.") == "| `name` | 1 | Links, and joints. |"
    assert _row("name", "1", "Maximum size.") == "| `name` | 1 | Size. |"


def test_docstrings_of_assignments_by_name() -> None:
    source = '''
A = 1
"""One ``unit``,
on two lines."""
B: int = 2
"""Two."""
C = 3
D.e = 4
"""Not a name."""
def f(): ...
"""Not an assignment."""
'''
    assert _docstrings(ast.parse(source).body) == {"A": "One `unit`, on two lines.", "B": "Two."}
