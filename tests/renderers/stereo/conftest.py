"""Fixtures of the stereo camera's tests."""

from tests.stereo.conftest import renderer

__all__ = ["renderer"]
