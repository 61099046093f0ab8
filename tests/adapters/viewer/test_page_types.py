"""The page's types are written from the structs of messages."""

from typing import Annotated, Literal

import msgspec
import pytest

from gateway.adapters.viewer import messages
from tools.page_types import Writer, page_types


class Inner(messages.Fields):
    wide_line: int


class Outer(messages.ViewMessage, tag="outer"):
    a: float
    b: str | None
    c: str | None = None
    d: bool | msgspec.UnsetType | None = msgspec.UNSET
    e: Literal["w", "x"] = "w"
    f: list[Inner | str] = msgspec.field(default_factory=list)
    g: tuple[int, float] | None = None
    h: dict[str, tuple[int, ...]] = msgspec.field(default_factory=dict)
    i: messages.Floats | None = None


OUTER = """export interface Outer {
  kind: "outer";
  a: number;
  b: string | null;
  c?: string;
  d?: boolean | null;
  e?: "w" | "x";
  f?: (Inner | string)[];
  g?: [number, number];
  h?: Record<string, number[]>;
  i?: Float32Array;
}"""


def test_a_struct_becomes_an_interface() -> None:
    writer = Writer()
    assert writer.text(msgspec.inspect.type_info(Outer)) == "Outer"
    assert writer.declarations["Inner"] == "export interface Inner {\n  wideLine: number;\n}"
    assert writer.declarations["Outer"] == OUTER


def test_a_type_without_a_rule_is_an_error() -> None:
    class Odd(messages.Fields):
        when: Annotated[bytes, "bytes are not JSON"]

    with pytest.raises(TypeError, match="BytesType"):
        Writer().text(msgspec.inspect.type_info(Odd))


def test_every_message_is_in_the_module() -> None:
    module = page_types()
    for message in messages.MESSAGES:
        assert f'export interface {message.__name__} {{\n  kind: "{message.__struct_config__.tag}";\n' in module
    assert "  min?: number;\n" in module, "of the controls that have it"
