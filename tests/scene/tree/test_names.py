import json

import pytest

from gateway.scene.tree.nodes import json_element

LARGEST = (1 << 63) - 1


@pytest.mark.parametrize("element", [0, 7, -7, LARGEST, -LARGEST, "", "robot", "a/b", "größe"])
def test_ordinary_elements_stay_as_they_are(element: str | int) -> None:
    assert json_element(element) == element
    assert type(json_element(element)) is type(element)


@pytest.mark.parametrize(
    ("element", "text"),
    [(LARGEST + 1, "0x8000000000000000"), (-LARGEST - 1, "-0x8000000000000000"), ("a\ud800ü", "a\\ud800ü")],
)
def test_elements_that_json_readers_cannot_hold_become_text(element: str | int, text: str) -> None:
    assert json_element(element) == text
    assert json.loads(json.dumps(json_element(element)).encode()) == text
