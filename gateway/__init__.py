"""Scenegate: a sensor stack without camera, GPU or display, on one scene and one CPU rasterizer."""

from scenegate import __version__ as __version__
