"""The tables of a scenario file, declared as msgspec structs. ``docs/scenarios.md`` explains each of them."""

from typing import Annotated, ClassVar, Final, Literal, TypeAlias, TypeVar

import msgspec
from msgspec import Meta

MAX_OBJECTS: Final = 1000
"""Maximum number of objects and distractors of a scene: each new one is tested against all others."""
MAX_VIEWS: Final = 100_000
"""Maximum number of cameras of a scene times its frames."""
MAX_METRES: Final = 1000
"""Maximum coordinate of positions, in both directions, and maximum length."""

Intensity = Annotated[float, Meta(ge=0, le=1e6)]
Blur = Annotated[float, Meta(ge=0, le=0.7)]
Gain = Annotated[float, Meta(ge=0, le=40)]
Metres = Annotated[float, Meta(ge=-MAX_METRES, le=MAX_METRES)]
Length = Annotated[float, Meta(gt=0, le=MAX_METRES)]
Degrees = Annotated[float, Meta(ge=-360, le=360)]
Elevation = Annotated[float, Meta(ge=-89, le=89)]
Fraction = Annotated[float, Meta(ge=0, le=1)]
Factor = Annotated[float, Meta(gt=0, le=1000)]
Fovy = Annotated[float, Meta(ge=1, le=170)]
Count = Annotated[int, Meta(ge=0, le=MAX_OBJECTS)]
JointValue = Annotated[float, Meta(ge=-1e6, le=1e6)]
Frames = Annotated[int, Meta(ge=1, le=MAX_VIEWS)]
Color = tuple[Fraction, Fraction, Fraction]
"""Red, green and blue, sRGB."""

_T = TypeVar("_T", float, int)
# msgspec 0.22 reads the constraints of `Annotated[float, …] | tuple[float, float]` from wrong addresses; a tuple of any
# length with limits on its length is safe.
Range: TypeAlias = _T | Annotated[tuple[_T, ...], Meta(min_length=2, max_length=2)]
"""A number, or [low, high], between which numbers are drawn uniformly."""
ColorRange = Annotated[tuple[Color, ...], Meta(min_length=1, max_length=2)]
"""One colour, or the two ends of a range of each channel."""


class ScenarioError(ValueError):
    """A scenario cannot be used. The message names the file, the key, its value and the limit."""


class Table(msgspec.Struct, frozen=True, forbid_unknown_fields=True, omit_defaults=True):
    """Base of the file's tables."""


class Materials(Table, frozen=True):
    """Materials that replace those of models, or that surfaces have."""

    share: Fraction = 1.0
    """Probability that an object gets a drawn material."""
    textures: str = ""
    """Images: a file, a folder or a pattern. Empty: none."""
    texture_size: Length = 0.3
    """Side of a texture on a model without texture coordinates and on surfaces, metres."""
    color: ColorRange = ((1.0, 1.0, 1.0),)
    """Colour; multiplies the texture."""
    metallic: Range[Fraction] = 0.0
    roughness: Range[Fraction] = 0.8


class Model(Table, frozen=True):
    """Models, and how objects are made of them."""

    path: str | Annotated[tuple[str, ...], Meta(min_length=1)]
    """A file, a folder or a pattern (``**`` for all folders), or a list of these: glTF, meshes, URDF, SDF or MJCF."""
    count: Range[Count] = 1
    """Number of objects; the model of each is drawn among the files."""
    scale: Range[Factor] = 1.0
    up: Literal["auto", "y", "z"] = "auto"
    """Up axis of glTF and mesh files."""
    roots: tuple[str, ...] = ()
    """Folders with the packages of robot files."""
    xacro_args: dict[str, str | float | bool] = {}
    """Values of the arguments of xacro files, by name."""
    on: str = ""
    """Name of the surface; empty: one is drawn for each object."""
    position: tuple[Range[Metres], Range[Metres], Range[Metres]] | None = None
    """Position in the world instead of a place on a surface."""
    rotation: tuple[Range[Degrees], Range[Degrees], Range[Degrees]] = (0.0, 0.0, (-180.0, 180.0))
    """Roll, pitch and yaw about the world's x, y and z axes, in this order."""
    joints: dict[str, Range[JointValue]] | Literal["limits"] = {}
    """Values of a robot's joints, radians or metres; ``limits``: drawn between the limits of its file."""
    animation: str | Annotated[int, Meta(ge=0)] | None = None
    """Animation of a glTF file, by name or index, that plays over the frames."""
    joint_track: str = ""
    """CSV file of a robot's joint values over time: ``time`` and columns named like the joints."""
    pose_track: str = ""
    """CSV file of poses in the world over time, in place of a place: ``time,x,y,z,qw,qx,qy,qz``."""


class Surface(Table, frozen=True):
    """A surface on which objects are placed."""

    kind: Literal["floor", "table"] = "floor"
    name: str = ""
    size: tuple[Length, Length] = (4.0, 4.0)
    """Along its x and y axes."""
    position: tuple[Range[Metres], Range[Metres]] = (0.0, 0.0)
    """Coordinates of its centre, metres."""
    height: Range[Metres] = 0.0
    """Height of its upper side, metres."""
    turn: Range[Degrees] = 0.0
    """Rotation about its centre, degrees."""
    area: tuple[Length, Length] | None = None
    """Size of the part in the middle where objects are placed; left out: all of it."""
    material: Materials = Materials()


class Placement(Table, frozen=True):
    """How objects find their places."""

    gap: Annotated[float, Meta(ge=0, le=10)] = 0.005
    """Minimum distance of objects, metres."""
    tries: Annotated[int, Meta(ge=1, le=10_000)] = 200
    """Number of places that are tried for an object before it is left out."""
    physics: Literal["none", "mujoco"] = "none"
    """``mujoco``: objects drop as convex hulls until they are at rest; needs ``scenegate[robots]``."""
    seconds: Annotated[float, Meta(gt=0, le=120)] = 10.0
    """Maximum simulated time."""


class Shell(Table, frozen=True, tag_field="kind", tag="shell"):
    """Cameras around the objects."""

    count: Annotated[int, Meta(ge=1, le=1000)] = 1
    distance: Range[Length] | None = None
    """Metres from what the camera looks at; left out: as far as needed to see all objects, times ``margin``."""
    margin: Range[Factor] = (1.0, 1.5)
    elevation: Range[Elevation] = (15.0, 75.0)
    azimuth: Range[Degrees] = (-180.0, 180.0)
    """Degrees counter-clockwise from +x."""
    roll: Range[Degrees] = 0.0
    look_at: Literal["objects", "object"] | tuple[Metres, Metres, Metres] = "objects"
    """The centre of all objects, of a drawn one, or a point."""
    fovy: Range[Fovy] = 45.0
    """Vertical field of view, degrees."""


class Handheld(Shell, frozen=True, tag_field="kind", tag="handheld"):
    """Cameras that move on smooth paths over the frames, through points that are drawn like those of a shell."""

    waypoints: Annotated[int, Meta(ge=2, le=100)] = 4
    sweep: Annotated[float, Meta(ge=0, le=360)] = 60.0
    """Range of the azimuth of further points around that of the first one, degrees."""
    shake: Annotated[float, Meta(ge=0, le=1)] = 0.003
    """Amplitude of the hand's shaking, metres."""


class Fixed(Table, frozen=True, tag_field="kind", tag="fixed"):
    """A camera at a place."""

    count: ClassVar[int] = 1
    eye: tuple[Metres, Metres, Metres]
    target: tuple[Metres, Metres, Metres]
    up: tuple[Metres, Metres, Metres] = (0.0, 0.0, 1.0)
    fovy: Range[Fovy] = 45.0


class Lamp(Table, frozen=True):
    """A directional light with shadows."""

    azimuth: Range[Degrees] = (-180.0, 180.0)
    """Azimuth of the place from which it shines, degrees."""
    elevation: Range[Elevation] = (30.0, 80.0)
    intensity: Range[Intensity] = 2.3
    color: ColorRange = ((1.0, 1.0, 1.0),)


class Lights(Table, frozen=True):
    """Lights of the look ``studio``."""

    rigs: str = ""
    """Rig files (TOML or .hdr): a file, a folder or a pattern. Empty: the built-in rig."""
    environments: str = ""
    """Environment maps (.hdr): a file, a folder or a pattern. They replace the surroundings of the rig."""
    turn: Range[Degrees] = 0.0
    """Rotation of the surroundings about z."""
    intensity: Range[Factor] = 1.0
    """Factor of all light."""
    lamps: Annotated[tuple[Lamp, ...], Meta(max_length=8)] = ()
    """Replace the lights of the rig, if there are any."""


class Backgrounds(Table, frozen=True):
    """Image or colour behind the scene."""

    images: str = ""
    """Images: a file, a folder or a pattern. Empty: a colour."""
    color: ColorRange | None = None
    """Left out: that of ``--background``."""


class Sensor(Table, frozen=True):
    """Lens and noise of the camera, as those of the stereo camera."""

    blur: Range[Blur] = 0.0
    """Standard deviation of the point spread, pixels."""
    vignetting: bool = False
    exposure: Range[Factor] = 1.0
    """Factor of the light."""
    gain: Range[Gain] = 0.0
    """Gain of the noise, dB; the brightness stays."""


class FrameRange(Table, frozen=True):
    """Frames of a moving scene: each camera renders each of them."""

    count: Frames
    rate: Factor = 10.0
    """Frames per second."""
    start: Annotated[float, Meta(ge=0, le=1e6)] = 0.0
    """Time of the first frame, seconds."""


class Scenario(Table, frozen=True):
    """Content of a scenario file."""

    seed: Annotated[int, Meta(ge=0, le=2**63 - 1)] = 0
    scenes: Annotated[int, Meta(ge=1, le=1_000_000)] = 1
    """Number of scenes."""
    models: tuple[Model, ...] = ()
    distractors: tuple[Model, ...] = ()
    """Models that are not annotated."""
    surfaces: tuple[Surface, ...] = (Surface(),)
    placement: Placement = Placement()
    cameras: tuple[Shell | Handheld | Fixed, ...] = (Shell(),)
    lights: Lights = Lights()
    materials: Materials | None = None
    """Materials of objects and distractors; left out: those of their files."""
    backgrounds: Backgrounds = Backgrounds()
    sensor: Sensor | None = None
    frames: FrameRange | None = None
    """Left out: scenes do not move."""

    @property
    def camera_count(self) -> int:
        """Number of cameras of each scene."""
        return sum(camera.count for camera in self.cameras)

    @property
    def frame_count(self) -> int | None:
        """Number of frames; None for scenes that do not move."""
        return None if self.frames is None else self.frames.count
