"""Messages between the gateway and the page, in one definition: ``tools.page_types`` writes the page's types from it.

A message of the gateway is the JSON header of a frame (``frames``); ``kind`` is its type. Fields with their default are
left out. To add a message: a class here, its name in ``MESSAGES``, and its handler in ``web/src/main.ts``.
"""

from typing import Annotated, Any, Final, Literal, TypeAlias, get_args

from msgspec import UNSET, Meta, Struct, UnsetType, field

from gateway.scene.tree.nodes import Path, PathElement
from scenegate.messages.clicks import Button
from scenegate.messages.controls import Value

Vector: TypeAlias = tuple[float, float, float]
Span: TypeAlias = tuple[int, int]
"""An array in the frame's body: offset in bytes, number of values. The page replaces it by a typed array."""
Bytes = Annotated[Span, Meta(extra_json_schema={"typescript": "Uint8Array<ArrayBuffer>"})]
Words = Annotated[Span, Meta(extra_json_schema={"typescript": "Uint32Array"})]
Floats = Annotated[Span, Meta(extra_json_schema={"typescript": "Float32Array"})]
Doubles = Annotated[Span, Meta(extra_json_schema={"typescript": "Float64Array"})]

ImageName = Literal["left", "right", "disparity", "confidence"]
IMAGE_NAMES: Final[tuple[ImageName, ...]] = get_args(ImageName)


class Fields(Struct, omit_defaults=True, rename="camel", kw_only=True):
    """Base class of parts of messages."""


class ViewMessage(Fields, tag_field="kind"):
    """Base class of messages from the gateway."""


class TextureUse(Fields):
    """A texture of a material."""

    image: int
    """Id of the image."""
    wrap: tuple[int, int]
    """Wrap modes of glTF."""
    linear: bool
    set: int | UnsetType = UNSET
    """Texture coordinate set of the mesh; default 0."""
    transform: tuple[float, float, float, float, float, float] | None = None
    """a, b, c, d, e, f: u' = a u + b v + c, v' = d u + e v + f."""


class PageMaterial(Fields):
    """A material. Colours are in sRGB."""

    color: tuple[float, float, float, float]
    alpha: Literal["mask", "blend"] | None = None
    cutoff: float = 0.5
    """Alpha cutoff of a mask."""
    metallic: float = 0.0
    roughness: float = 1.0
    emissive: Vector = (0.0, 0.0, 0.0)
    double_sided: bool = False
    unlit: bool = False
    point_size: float = 1.0
    line_width: float = 1.0
    casts_shadow: bool = True
    texture: TextureUse | None = None
    metallic_roughness_texture: TextureUse | None = None
    """Green: roughness, blue: metallic."""
    normal_texture: TextureUse | None = None
    normal_scale: float = 1.0
    occlusion_texture: TextureUse | None = None
    """Red: occlusion."""
    occlusion_strength: float = 1.0
    emissive_texture: TextureUse | None = None
    emissive_strength: float = 1.0


class Draw(Fields):
    """A mesh with a material."""

    mesh: int
    material: PageMaterial
    matrix: list[float] | UnsetType | None = UNSET
    """Column-major transform from mesh to node; default identity. None: it is not finite, so the mesh is not drawn."""


class PagePart(Fields):
    """A part of a node's geometry."""

    kind: str
    draws: list[Draw]
    points: int | UnsetType = UNSET
    """Number of points of a point cloud."""
    channels: dict[str, int] | None = None
    """Number of columns of each channel of a point cloud, by name."""
    source: str = ""
    faces_camera: bool = False
    """True: the part is turned about its origin so that it is always seen from the front."""


class NodeUpdate(Fields):
    """A node that was added, or the properties of it that have changed."""

    id: int
    parent: int | UnsetType = UNSET
    name: PathElement | UnsetType = UNSET
    visible: bool | UnsetType = UNSET
    opacity: float | UnsetType = UNSET
    parts: list[PagePart] | UnsetType | None = UNSET


class Poses(Fields):
    """x, y, z, qw, qx, qy, qz of each node."""

    ids: Words
    values: Floats


class Matrices(Fields):
    """4x4 column-major transform of each node."""

    ids: Words
    values: Doubles


class SceneUpdate(ViewMessage, tag="update"):
    """The differences between two revisions of the scene."""

    from_: int = field(name="from")
    revision: int
    timestamp: int
    """Time from which the revision is valid, nanoseconds since the epoch: for recordings."""
    removed: list[int] = []
    nodes: list[NodeUpdate] = []
    """Encoded one by one, by ``FrameBuilder.add_node``."""
    poses: Poses | None = None
    matrices: Matrices | None = None


class MeshPayload(ViewMessage, tag="mesh"):
    """A mesh."""

    id: int
    topology: Literal[1, 2, 3]
    position: Floats
    box: tuple[Vector, Vector] | None = None
    """Bounds of the positions: minimum and maximum."""
    normal: Floats | None = None
    color: Bytes | None = None
    uv: Floats | None = None
    uv1: Floats | None = None
    index: Words | None = None


class Forget(ViewMessage, tag="forget"):
    """Meshes that no longer exist."""

    meshes: list[int]


class InterfaceState(Fields):
    """State of an interface of the gateway."""

    state: str
    title: str
    documentation: str
    problem: str = ""
    """Reason of a failure."""
    warnings: list[str] = []


class Fact(Fields):
    """A value in the status bar."""

    name: str
    value: str | int
    warn: bool = False


class Status(ViewMessage, tag="status"):
    """The content of the status bar."""

    interfaces: dict[str, InterfaceState] = {}
    facts: list[Fact] = []
    renders: int = 0
    """Number of render requests so far."""


class PlacedRig(ViewMessage, tag="rig"):
    """The stereo camera in the scene; its images' size, focal lengths and principal point in pixels."""

    pose: list[float]
    """Column-major X_world_left: pose of the left camera's optical frame."""
    width: int
    height: int
    fx: float
    fy: float
    cx: float
    cy: float
    baseline: float
    """Distance from the left to the right camera in metres, along +X of the left camera."""


class NoRig(ViewMessage, tag="rig"):
    """The stereo camera is not in this scene."""

    pose: None


class Home(Fields):
    """Camera of the home view."""

    eye: Vector
    target: Vector
    up: Vector


class PageSettings(ViewMessage, tag="page"):
    """View settings that clients have set. None: the page's own setting."""

    background: Vector | None
    """Red, green, blue: sRGB from 0 to 1."""
    grid: bool | None
    home: Home | None
    clickable: list[Path]
    """Paths at and below which clients receive clicks on geometry."""


class PageLight(Fields):
    """A punctual light, as ``renderers.drawlist.Light``."""

    type: Literal["directional", "point", "spot"]
    color: Vector
    """Linear RGB times the intensity, lux or candela."""
    position: Vector
    direction: Vector
    range: float
    """0: no limit."""
    inner_cone: float
    outer_cone: float
    casts_shadow: bool


class PageLighting(ViewMessage, tag="light"):
    """The light of the gateway's images: ``renderers.light_rig.Rig``."""

    lights: list[PageLight]
    ambient: list[float]
    """Nine spherical harmonics of the environment's radiance, RGB each, in three.js' order."""
    environment: Floats
    """Equirectangular image of the environment's radiance, RGB, top row first, world frame, Z up."""
    size: tuple[int, int]
    """Height and width of the environment."""
    exposure: float
    tone: Literal["neutral", "aces", "none"]


class PageControls(ViewMessage, tag="controls"):
    """Changes of the controls of programs."""

    controls: Annotated[list[dict[str, Any]], Meta(extra_json_schema={"typescript": "ControlDefinition[]"})] | None
    """All controls, ``scenegate.messages.controls.AnyControl`` with ``id``. None: as before."""
    values: list[tuple[int, Value]]
    """New values by the ids of their controls."""
    samples: list[tuple[int, Doubles]]
    """New samples by the ids of their plots: rows of time and values."""


class Received(ViewMessage, tag="received"):
    """The gateway has executed a change of a control of this page: values that follow are not older."""

    number: int


class TimeState(ViewMessage, tag="time", omit_defaults=False):
    """The time that the page shows. Times are seconds since the epoch."""

    mode: Literal["live", "playing", "paused"]
    live: bool
    """True if the end of the span is the live scene; False: a log."""
    rate: float
    """Seconds of the scene in a second."""
    loop: bool
    working: bool
    """True while the gateway looks for a state."""
    problem: str
    """Why there is no state; empty: there is."""
    simulation: float | None
    """Time of the simulation in a log, seconds; None: none is known."""
    position: float
    first: float
    last: float


class RecordedImage(ViewMessage, tag="image"):
    """A texture in a recording."""

    id: int
    """Id of the image."""
    data: Bytes
    """PNG or JPEG file."""


class RecordedChannel(ViewMessage, tag="channel"):
    """A channel of a point cloud in a recording."""

    id: int
    """Id of the mesh."""
    name: str
    data: Bytes
    """float32 values."""


class RecordingEnd(ViewMessage, tag="end"):
    """The last message of a recording: its time is that until which the last update is valid."""


class RenderEntry(Fields, omit_defaults=False):
    """A request in the response of ``/view/renders``."""

    id: int
    """Number of the request since start, from 1."""
    when: float
    """Time of the response, in seconds since 1970."""
    status: int
    """HTTP status."""
    milliseconds: float
    """Duration from the first byte of the request."""
    queued: float
    """Milliseconds of the duration spent waiting for a worker thread."""
    what: str
    """Type and size of the image."""
    scene: str
    """Size, generator and number of primitives of the scene."""
    image: bool
    """True if the image is kept."""
    error: str
    warnings: tuple[str, ...]


class StereoCapture(Fields):
    """Response of ``/view/sensor``: the newest images of the stereo camera."""

    number: int
    """Number of the capture since start, from 1."""
    captions: dict[ImageName, str]
    """Short texts by the names of the images."""
    pose: str = ""
    """Where the left image was taken, as text for ``--stereo-pose``."""


class Click(Struct):
    """Message of the page: a click on geometry."""

    node: int
    """Id of the node."""
    point: Vector
    """Point in the world, metres."""
    button: Button


class ControlChange(Struct):
    """Message of the page: a change of a control. The value of a button is ignored: it counts a click."""

    control: int
    """Id of the control."""
    number: int
    """Number of the change, ascending."""
    value: Annotated[Any, Meta(extra_json_schema={"typescript": "ControlValue"})] = None


class TimeCommand(Struct):
    """Message of the page: a command of its time bar. It sets ``rate`` and ``loop``, if it has them."""

    time: Literal["live", "play", "pause", "seek", "step", "set"]
    at: Annotated[float, Meta(ge=0, le=1e10)] = 0.0
    """Time to seek, seconds since the epoch."""
    by: Annotated[float, Meta(ge=-1e10, le=1e10)] | None = None
    """Seconds to seek from the present position, in place of ``at``. At the end of a live scene, the page goes live."""
    steps: Literal[-1, 1] = 1
    """Direction of a step."""
    rate: Annotated[float, Meta(ge=0.1, le=10)] | None = None
    """Seconds of the timeline in a second."""
    loop: bool | None = None


class Forgot(Struct):
    """Message of the page: it has dropped meshes."""

    forgot: list[int]
    """Ids."""


MESSAGES: Final = (
    SceneUpdate,
    MeshPayload,
    Forget,
    Status,
    PlacedRig,
    NoRig,
    PageSettings,
    PageLighting,
    PageControls,
    Received,
    TimeState,
)
"""Messages that the page receives."""
RECORDED: Final = (RecordedImage, RecordedChannel, RecordingEnd)
"""Messages that only recordings have."""
RESPONSES: Final = (RenderEntry, StereoCapture)
"""Responses to requests of the page."""
REPORTS: Final = (Click, ControlChange, TimeCommand, Forgot)
"""Messages that the page sends."""
