from __future__ import annotations

import copy
import dataclasses
import inspect
import pickle
import typing
import weakref
from dataclasses import dataclass, field

import numpy as np
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
    with pytest.raises(AttributeError):
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

    @dataclass(frozen=True, slots=True)
    class Base:
        first: int

    @dataclass(frozen=True, slots=True)
    class More(Base):
        third: float = 3.0

    for kind in (Made, Open, Checked, Given, More):
        with pytest.raises(TypeError, match=kind.__name__):
            quick(kind)


def test_what_is_made_is_frozen_hashed_and_held_weakly_as_its_dataclass_says() -> None:
    value = Value(1)
    for change in (lambda: setattr(value, "first", 2), lambda: delattr(value, "first")):
        with pytest.raises(AttributeError):
            change()
    assert not hasattr(value, "__dict__")
    assert {value, Value(1), Value(2)} == {Value(1), Value(2)}
    assert pickle.loads(pickle.dumps(Material(metallic=0.5))) == Material(metallic=0.5)
    assert copy.copy(Material(metallic=0.5)).metallic == 0.5
    mesh = Mesh(np.zeros((3, 3), np.float32), np.zeros((1, 3), np.uint32))
    handle = weakref.ref(mesh)
    assert handle() is mesh
    del mesh
    assert handle() is None
    with pytest.raises(TypeError):
        weakref.ref(Material())


def test_a_class_without_fields() -> None:
    @quick
    @dataclass(frozen=True, slots=True)
    class Empty:
        pass

    assert Empty() == Empty()
    assert typing.get_type_hints(Mesh)["positions"]


def test_members_are_kept() -> None:
    mesh = Mesh(np.zeros((3, 3), np.float32), np.zeros((1, 3), np.uint32))
    assert mesh.nbytes == 48
    assert dataclasses.is_dataclass(mesh)
    assert Mesh.__doc__
    assert "Vertices" in Mesh.__doc__
