"""The CPU rasterizer: visibility by exact fixed-point edge functions, then resolve and shading of what is visible."""
