"""Imports Pillow, which only reading images and writing JPEG files need."""

from types import ModuleType


def pillow() -> ModuleType:
    """Return the module ``PIL.Image``; raises ImportError with a remedy if Pillow is not installed."""
    try:
        from PIL import Image
    except ImportError as error:
        raise ImportError(f"{error}: pip install 'scenegate-client[images]'") from None
    return Image
