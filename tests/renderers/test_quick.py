from __future__ import annotations

import dataclasses
import inspect
import typing
from dataclasses import dataclass, field

import pytest

from renderers.drawlist import Image, Material, Mesh, Sampler, Texture
from renderers.quick import quick


@quick
@dataclass(frozen=True, slots=True)
class Value:
    """Of two fields."""

    first: int
    second: str = "two"


def test_a_quick_value_is_as_any_other() -> None:
    assert Value(1) == Value(1, "two") == Value(second="two", first=1)
    assert hash(Value(1)) == hash(Value(1, "two"))
    assert repr(Value(3, "x")) == "Value(first=3, second='x')"
    assert dataclasses.replace(Value(1), second="three") == Value(1, "three")
    with pytest.raises(dataclasses.FrozenInstanceError):
        Value(1).first = 2  # type: ignore[misc]  # that it is refused is tested
    with pytest.raises(TypeError, match="first"):
        Value()  # type: ignore[call-arg]
    with pytest.raises(TypeError, match="third"):
        Value(1, third=3)  # type: ignore[call-arg]


@pytest.mark.parametrize("kind", [Mesh, Image, Sampler, Texture, Material])
def test_names_and_defaults_are_those_of_the_fields(kind: type) -> None:
    parameters = [*inspect.signature(kind).parameters.values()]
    fields = dataclasses.fields(kind)
    assert [p.name for p in parameters] == [f.name for f in fields]
    for parameter, of in zip(parameters, fields, strict=True):
        missing = of.default is dataclasses.MISSING
        assert parameter.default is (inspect.Parameter.empty if missing else of.default)


def test_only_what_is_only_set_can_be_quick() -> None:
    @dataclass(frozen=True, slots=True)
    class Made:
        items: list[int] = field(default_factory=list)

    @dataclass(frozen=True)
    class Open:
        item: int = 0

    @dataclass(frozen=True, slots=True)
    class Checked:
        item: int = 0

        def __post_init__(self) -> None:
            pass

    @dataclass(frozen=True, slots=True)
    class Given:
        item: int
        more: dataclasses.InitVar[int] = 0

    for kind in (Made, Open, Checked, Given):
        with pytest.raises(TypeError, match=kind.__name__):
            quick(kind)


def test_fields_of_a_base_are_set_too() -> None:
    @quick
    @dataclass(frozen=True, slots=True)
    class More(Value):
        third: float = 3.0

    @quick
    @dataclass(frozen=True, slots=True)
    class Empty:
        pass

    assert (More(1).first, More(1).second, More(1, third=2.0).third) == (1, "two", 2.0)
    assert Empty() == Empty()
    assert typing.get_type_hints(Mesh.__init__)["positions"]
