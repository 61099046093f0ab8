"""Fixtures of the stereo camera's tests."""

from tests.adapters.stereo.conftest import renderer

__all__ = ["renderer"]
