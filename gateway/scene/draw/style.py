"""Shading of images of a scene, as settings, commands and requests choose it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Final, Literal

from renderers.interface import Look, LookName
from renderers.light_rig import STUDIO, LightChange, Rig

LookChoice = Literal["auto", LookName]
"""Name of a look, or ``auto``: the scene decides."""
STUDIO_SAMPLES: Final = 4
"""Default number of samples per pixel of the look ``studio``. The others have one."""


@dataclass(frozen=True, slots=True)
class Style:
    """Shading of colour images, and what is cut out of the others."""

    look: LookChoice = "auto"
    background: tuple[int, int, int] = Look().background
    """RGB background, 0 .. 255; the default is that of Drake's engines."""
    antialias: Literal["fxaa", "none"] = "fxaa"
    """Antialiasing of images with one sample per pixel. RenderEngineVtk uses FXAA: with FXAA 0.0 to 0.5 % of the values
    differ from VTK's images, without FXAA 0.2 to 3.4 %. RenderEngineGl has no antialiasing."""
    samples: Literal[0, 1, 4, 8] = 0
    """Samples per pixel (MSAA); 0: ``STUDIO_SAMPLES`` for the look ``studio``, 1 for the others."""
    rig: Rig = STUDIO
    """Lights and environment of the look ``studio``."""
    alpha_threshold: float = 0.0
    """Alpha below which blended surfaces are cut out; see ``Look``."""

    def for_image(self, background: tuple[int, int, int] | None, light: LightChange) -> Style:
        """Return the style of an image with a background, None for the same, and changed light."""
        return replace(self, background=background or self.background, rig=light.applied_to(self.rig))

    def look_for(self, scene_look: LookName, requested: LookChoice | None = None) -> Look:
        """Return the look of an image: that of its request, or ``look``, for which ``auto`` is the scene's."""
        choice = requested or self.look
        name = scene_look if choice == "auto" else choice
        samples = self.samples or (STUDIO_SAMPLES if name == "studio" else 1)
        return Look(
            name, background=self.background, samples=samples, rig=self.rig, alpha_threshold=self.alpha_threshold
        )

    def applies_fxaa(self, look: Look) -> bool:
        """Return True if colour images with a look of this style are smoothed by FXAA."""
        return self.antialias == "fxaa" and look.samples == 1
