"""splitmix64 (Steele, Lea and Flood 2014), for kernels: hashes, and random numbers from a key and a counter."""

from typing import Final

from renderers.compiler.device_function import inlined
from renderers.compiler.kernel_types import U64, u64

GAMMA: Final = u64(0x9E3779B97F4A7C15)
"""Difference of successive states: 2^64 divided by the golden ratio."""


@inlined
def mix(state: U64) -> U64:
    """Return the hash of a state. Different states have different ones."""
    state = (state ^ (state >> u64(30))) * u64(0xBF58476D1CE4E5B9)
    state = (state ^ (state >> u64(27))) * u64(0x94D049BB133111EB)
    return state ^ (state >> u64(31))
