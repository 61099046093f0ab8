"""Parts of a realistic camera image, which can be enabled one by one, and the parser of lists of their names."""

from typing import Final, Literal, get_args

RealismPart = Literal["shadows", "lens-blur", "vignetting", "fixed-pattern", "motion-blur", "projector"]
"""Name of a part:

- ``shadows``: a key light with soft shadows, in place of the lamp at the camera.
- ``lens-blur``: point spread of lens and pixel.
- ``vignetting``: less light towards the corners.
- ``fixed-pattern``: offset and gain that differ between the sensor's pixels and columns.
- ``motion-blur``: blur of objects that move in the image during the exposure.
- ``projector``: round dots with soft edges and speckle.
"""
REALISM_PARTS: Final[tuple[RealismPart, ...]] = get_args(RealismPart)
"""All parts."""


def parse_realism(text: str) -> tuple[RealismPart, ...]:
    """Return the parts for ``off``, ``all`` or names separated by commas, without duplicates.

    Raises:
        ValueError: unknown name, of which the message lists the known ones, or ``off`` or ``all`` with others.
    """
    if text == "off":
        return ()
    if text == "all":
        return REALISM_PARTS
    names = [name.strip() for name in text.split(",")]
    if len(names) > 1 and (alone := {"off", "all"}.intersection(names)):
        raise ValueError(f"{min(alone)!r} cannot be combined with other names")
    if unknown := [name for name in names if name not in REALISM_PARTS]:
        raise ValueError(f"{unknown[0]!r} is not a part; use 'off', 'all' or some of {', '.join(REALISM_PARTS)}")
    return tuple(part for part in REALISM_PARTS if part in names)
