"""Rasterization with several samples per pixel: coverage, storage of samples, edge pixels and their resolve."""
