"""Image encoders: PNG, TIFF and JPEG."""

from renderers.encode.jpeg import jpeg_rgb
from renderers.encode.png import png_gray8, png_gray16, png_label, png_pixels, png_rgb, png_rgba
from renderers.encode.tiff import tiff_float32, tiff_gray16

__all__ = [
    "jpeg_rgb",
    "png_gray8",
    "png_gray16",
    "png_label",
    "png_pixels",
    "png_rgb",
    "png_rgba",
    "tiff_float32",
    "tiff_gray16",
]
