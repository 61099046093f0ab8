"""Shading that the settings choose."""

from gateway.files.assets.light_rig_file import rig_of
from gateway.runtime.settings import Settings
from gateway.scene.draw.style import Style


def style_of(settings: Settings) -> Style:
    """Return the style of the render endpoint; reads the file of ``--rig``."""
    return Style(
        settings.look,
        settings.background,
        samples=settings.samples,
        rig=rig_of(settings.rig),
        alpha_threshold=settings.alpha_threshold,
    )
