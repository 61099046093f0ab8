"""Kernels have the types of their annotations, and take no others."""

from typing import Any, Generic, NamedTuple, TypeVar

import numpy as np
import pytest
from numba import types

from renderers.compiler import simd as vec
from renderers.compiler.device_function import inlined
from renderers.compiler.jit import KERNELS, kernel, read_only
from renderers.compiler.kernel_types import (
    F32,
    F64,
    I32,
    I64,
    U8,
    Address,
    Array1,
    Array2,
    KernelSignature,
    Number,
    Pointer,
    ReadOnly2,
    i64,
    numba_type,
)
from renderers.compiler.simd import F32x8, Mask8
from renderers.compiler.structs import Struct, inline


class Sphere(Struct):
    radius: F64
    center: Pointer[F64] = inline(3)


class Ends(NamedTuple, Generic[Number]):
    first: Number
    last: Number


@pytest.mark.parametrize(
    ("annotation", "expected"),
    [
        (I64, types.int64),
        (Address, types.int64),
        (U8, types.uint8),
        (bool, types.boolean),
        (None, types.none),
        (Pointer[F32], types.CPointer(types.float32)),
        (Array2[np.float32], types.Array(types.float32, 2, "C")),
        (ReadOnly2[np.uint8], types.Array(types.uint8, 2, "C", readonly=True)),
        (tuple[I64, F32], types.Tuple((types.int64, types.float32))),
        (Ends[F32], types.NamedUniTuple(types.float32, 2, Ends)),
        (F32x8, vec.F32x8.numba_type),
        (Mask8, vec.Mask8.numba_type),
        (Sphere, Sphere.numba_type),
        (Pointer[Sphere], types.CPointer(Sphere.numba_type)),
    ],
)
def test_annotations_name_types(annotation: Any, expected: Any) -> None:
    assert numba_type(annotation) == expected


@pytest.mark.parametrize("annotation", [str, list[int], dict])
def test_other_annotations_are_refused(annotation: Any) -> None:
    with pytest.raises(TypeError, match="is no type of kernels"):
        numba_type(annotation)


def test_structs_lie_in_memory_as_in_c() -> None:
    assert (Sphere.nbytes, Sphere.offset_of("center")) == (32, 8)
    spheres = np.zeros(1, Sphere.dtype)
    spheres[0] = Sphere.record(center=(1, 2, 3))
    assert spheres["center"].tolist() == [[1, 2, 3]]
    with pytest.raises(TypeError, match="colour"):
        Sphere.record(colour=1)


@inlined
def half(value: Number) -> Number:
    return value // 2


@inlined
def halves(count: I64) -> I64:
    return half(count)


@inlined
def _truncated(value: F64) -> I64:
    return i64(value)


@kernel
def count(values: Array1[np.float32], first: I64, scale: F64) -> I64:
    return len(values) + halves(first) + _truncated(scale)


KERNELS.remove(count)
VALUES = np.zeros(3, np.float32)


def test_kernels_compile_one_signature() -> None:
    assert count(VALUES, 4, 1.5) == 6
    assert count.overloads.keys() == {(types.Array(types.float32, 1, "C"), types.int64, types.float64)}


@pytest.mark.parametrize(
    ("arguments", "parameter", "given"),
    [
        ((VALUES.astype(np.float64), 4, 1.5), "values", "Array1[np.float64]"),
        ((VALUES[None], 4, 1.5), "values", "Array2[np.float32]"),
        ((read_only(VALUES), 4, 1.5), "values", "ReadOnly1[np.float32]"),
        ((np.zeros(6, np.float32)[::2], 4, 1.5), "values", "Array1[np.float32], not C-contiguous"),
        ((VALUES, 4.0, 1.5), "first", "F64"),
        ((VALUES, 4, "1"), "scale", "unicode_type"),
    ],
)
def test_arguments_of_other_types_are_refused(arguments: tuple[Any, ...], parameter: str, given: str) -> None:
    with pytest.raises(TypeError) as caught:
        count(*arguments)
    assert f"count: {parameter} is {given}" in str(caught.value)
    assert len(count.overloads) == 1


def test_arrays_are_compared_without_the_check(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("renderers.compiler.jit._CHECKS_ARGUMENTS", False)
    with pytest.raises(TypeError, match="values is"):
        count(VALUES.astype(np.float64), 4, 1.5)


T = TypeVar("T", bound=Struct)


def test_arguments_of_device_functions_are_compared_while_they_are_typed() -> None:
    def takes(values: Pointer[F32], index: I64, scale: F64) -> None: ...

    def pair(a: Number, b: Number) -> None: ...

    def any_struct(a: T) -> None: ...

    signature = KernelSignature(takes)
    pointer = types.CPointer(types.float32)
    narrow = (pointer, types.int32, types.float32)
    assert signature.accept(narrow) == (pointer, types.int64, types.float64)  # numbers are widened
    with pytest.raises(TypeError, match=r"values is Pointer\[F64\], wanted Pointer\[F32\]"):
        signature.accept((types.CPointer(types.float64), types.int64, types.float64))
    with pytest.raises(TypeError, match="index is F64, wanted I64"):
        signature.accept((pointer, types.float64, types.float64))
    with pytest.raises(TypeError, match="index is U64, wanted I64"):
        signature.accept((pointer, types.uint64, types.float64))
    with pytest.raises(TypeError, match="b is F32, wanted I64"):
        KernelSignature(pair).accept((types.int64, types.float32))
    assert KernelSignature(any_struct).accept((Sphere.numba_type,)) == (Sphere.numba_type,)


def test_results_are_compared() -> None:
    def returns(a: I32) -> F32: ...

    with pytest.raises(TypeError, match="returns I64, not F32"):
        KernelSignature(returns).check_result((types.int32,), types.int64)


def test_all_parameters_are_annotated() -> None:
    def bare(a, b: I64) -> None: ...  # type: ignore[no-untyped-def]  # what the rule must find

    with pytest.raises(TypeError, match="no annotation of 'a'"):
        KernelSignature(bare).accept((types.int64, types.int64))
