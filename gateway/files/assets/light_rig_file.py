"""Reads light rigs of the look ``studio`` from TOML files.

Missing values have the defaults of ``renderers.light_rig``. Positions and directions are in the world frame, metres,
Z up; angles are in degrees. ``docs/scene-api.md`` has an example.
"""

import functools
import hashlib
import math
import reprlib
import tomllib
from pathlib import Path
from typing import Annotated, Final, Literal

import structlog
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from renderers.drawlist import Light, LightKind
from renderers.light_rig import MAX_LIGHTS, STUDIO, Hemisphere, Rig, Softbox, Surroundings, ToneName
from scenegate.regular_files import read_regular, read_text

_log = structlog.get_logger("gateway")

MAX_INTENSITY: Final = 1e9
"""Maximum exposure, intensity and colour, about the radiance of the sun: products of these fit into float32."""
NonNegative = Annotated[float, Field(ge=0, le=MAX_INTENSITY, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Color = tuple[NonNegative, NonNegative, NonNegative]
Vector = tuple[Finite, Finite, Finite]


_MAX_FILE_BYTES: Final = 1 << 20
"""Maximum size of a rig file; the image of its surroundings has its own."""


class RigFileError(ValueError):
    """A rig file cannot be used. The message names the file, the value and the reason."""


class _Table(BaseModel):
    """Base of the tables of the file, whose fields ``renderers.light_rig`` explains."""

    model_config = ConfigDict(extra="forbid", frozen=True)


class _Softbox(_Table):
    direction: Vector
    radiance: Color
    width: float = Field(gt=0, lt=89)
    height: float = Field(gt=0, lt=89)
    softness: float = Field(0.3, gt=0, le=2)


class _Surroundings(_Table):
    sky: Color = Hemisphere().sky
    ground: Color = Hemisphere().ground
    softboxes: tuple[_Softbox, ...] = Field((), max_length=MAX_LIGHTS)
    image: Path | None = None
    intensity: NonNegative = 1.0
    turn: Finite = 0.0


class _Light(_Table):
    kind: Literal["directional", "point", "spot"]
    color: Color = (1.0, 1.0, 1.0)
    intensity: NonNegative = 1.0
    position: Vector = (0.0, 0.0, 0.0)
    direction: Vector = (0.0, 0.0, -1.0)
    range: float | None = Field(None, gt=0, allow_inf_nan=False)
    inner_cone: float = Field(0.0, ge=0, lt=90)
    outer_cone: float = Field(45.0, gt=0, le=90)
    casts_shadow: bool = True


class _Rig(_Table):
    exposure: NonNegative = 1.0
    tone: ToneName = Rig().tone
    shadow_size: int = Rig().shadow_size
    shadow_radius: int = Rig().shadow_radius
    scene_lights: bool = True
    surroundings: _Surroundings | None = None
    lights: tuple[_Light, ...] = ()


@functools.cache
def rig_of(path: Path | None) -> Rig:
    """Return the rig of a file; the default rig for None. Log a warning if it has no light. Raises as ``read_rig``."""
    rig = STUDIO if path is None else read_rig(path)
    if rig.is_dark:
        reason = "the rig has neither [[lights]] nor [surroundings]"
        _log.warning("Scenes without lights of their own are black in the look studio", rig=str(path), reason=reason)
    return rig


def rig_digest(path: Path) -> str:
    """Return the SHA-256 of a rig file followed by the image of its surroundings, if any. Raises as ``read_rig``."""
    rig = read_rig(path)
    image = (rig.surroundings.image if rig.surroundings is not None else None) or b""
    text = b"" if _is_image(path) else read_regular(path, _MAX_FILE_BYTES)
    return hashlib.sha256(text + image).hexdigest()


def _is_image(path: Path) -> bool:
    return path.suffix.lower() == ".hdr"


def read_rig(path: Path) -> Rig:
    """Return the rig of a TOML file, in which paths are relative to its folder, or of a Radiance image (.hdr).

    The image lights the scene alone, as the environment map of Drake's RenderEngineVtk does. Raises RigFileError.
    """
    try:
        if _is_image(path):
            return Rig(surroundings=Surroundings(image=_radiance_image(path)))
        table = _Rig.model_validate(tomllib.loads(read_text(path, _MAX_FILE_BYTES)))
        changed = {
            "lights": tuple(_light(light, f"lights.{number}") for number, light in enumerate(table.lights)),
            "surroundings": table.surroundings and _surroundings(table.surroundings, path.parent),
            "auto_exposure": "exposure" not in table.model_fields_set,
        }
        return Rig(**{**dict(table), **changed})
    except OSError as error:
        owner = f" (the surroundings of {path})" if error.filename not in (None, str(path)) else ""
        raise RigFileError(f"{error.filename or path} cannot be read: {error.strerror}{owner}") from None
    except ValidationError as error:
        raise RigFileError(f"{path}: {_first_error(error)}") from None
    except UnicodeDecodeError:
        raise RigFileError(f"{path}: it is neither a TOML file nor a Radiance image (.hdr)") from None
    except ValueError as error:  # including tomllib.TOMLDecodeError
        raise RigFileError(f"{path}: {error}") from None


cached_rig: Final = functools.lru_cache(16)(read_rig)
"""``read_rig`` for a run over many samples, whose files do not change meanwhile. An environment map has megabytes."""


def _radiance_image(path: Path) -> bytes:
    from renderers.shading.studio.environment_image import read_hdr

    image = read_regular(path)
    read_hdr(image)  # raises an error for a damaged file now instead of when the first frame is rendered
    return image


def _surroundings(table: _Surroundings, folder: Path) -> Surroundings:
    return Surroundings(
        hemisphere=Hemisphere(table.sky, table.ground),
        softboxes=tuple(
            Softbox(
                _unit_vector(box.direction, f"surroundings.softboxes.{number}"),
                box.radiance,
                math.radians(box.width),
                math.radians(box.height),
                box.softness,
            )
            for number, box in enumerate(table.softboxes)
        ),
        image=_radiance_image(folder / table.image) if table.image is not None else None,
        intensity=table.intensity,
        turn=math.radians(table.turn),
    )


def _light(table: _Light, table_name: str) -> Light:
    if table.kind == "spot" and table.inner_cone >= table.outer_cone:
        raise ValueError(
            f"{table_name}: inner_cone = {table.inner_cone:g} must be less than outer_cone = {table.outer_cone:g}"
        )
    changed = {
        "kind": LightKind(table.kind),
        "direction": _unit_vector(table.direction, table_name),
        "inner_cone": math.radians(table.inner_cone),
        "outer_cone": math.radians(table.outer_cone),
    }
    return Light(**{**dict(table), **changed})


def _unit_vector(direction: Vector, table_name: str) -> Vector:
    x, y, z = direction
    length = math.hypot(x, y, z)
    if not 1e-9 < length < 1e9:
        raise ValueError(f"{table_name}: direction = {list(direction)} has no direction")
    return x / length, y / length, z / length


def _first_error(error: ValidationError) -> str:
    """Return the first error as a sentence with the field, the reason and, unless the field is missing, its value."""
    details = error.errors(include_url=False)[0]
    field = ".".join(map(str, details["loc"]))
    sentence = f"{field}: {details['msg'][:1].lower()}{details['msg'][1:]}"
    return sentence if details["type"] == "missing" else f"{sentence}, not {reprlib.repr(details['input'])}"
