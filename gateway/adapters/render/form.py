"""Reads the form of a render request (RFC 7578): its parts as they arrive, then its fields; no I/O.

Every form that Drake's demo server or drake-blender accepts is accepted. Unlike Drake's demo server, this one ignores
unknown fields with a warning, so that newer clients with more fields get their images, and computes a missing focal
length from the field of view. Parts in base64 and quoted-printable are decoded; with another
Content-Transfer-Encoding, they are read as they are.
"""

import math
import re
from collections.abc import Mapping
from io import BytesIO
from typing import Final, NamedTuple, cast, get_args

from python_multipart.exceptions import FormParserError, ParseError
from python_multipart.multipart import Field, File, FormParser, parse_options_header

from gateway.adapters.render.config import RenderConfig
from gateway.adapters.render.errors import RequestError, quoted
from gateway.adapters.render.request import MAX_FAR, MAX_FOCAL, MIN_FAR, ImageType, RenderRequest
from gateway.scene.draw.style import LookChoice

IMAGE_TYPES: Final = get_args(ImageType)
LOOK_FIELD: Final = "scenegate_look"
"""Field with a ``LookChoice``, which Drake's client never sends. The prefix keeps later fields of it apart."""
LOOKS: Final = get_args(LookChoice)
SCENE: Final = "scene"
"""Name of the part with the glTF file."""
_REQUIRED: Final = ("image_type", "width", "height", "near", "far", "center_x", "center_y")


class _Bounds(NamedTuple):
    """Bounds of a decimal field. None may be negative."""

    maximum: float = math.inf
    may_be_zero: bool = False


_DECIMAL_BOUNDS: Final[Mapping[str, _Bounds]] = {
    "near": _Bounds(may_be_zero=True),
    "far": _Bounds(MAX_FAR),
    "min_depth": _Bounds(may_be_zero=True),
    "max_depth": _Bounds(),
    "focal_x": _Bounds(MAX_FOCAL),
    "focal_y": _Bounds(MAX_FOCAL),
    "fov_x": _Bounds(),
    "fov_y": _Bounds(),
    "center_x": _Bounds(),
    "center_y": _Bounds(),
}
_IGNORED: Final = "submit"
"""Field that Drake's client sends as ``Render``."""
_KNOWN: Final = frozenset((*_REQUIRED, *_DECIMAL_BOUNDS, LOOK_FIELD, "scene_sha256", _IGNORED))
_DECIMAL_SYNTAX: Final = re.compile(r"[+-]?(\d+(\.\d*)?|\.\d+)([eE][+-]?\d+)?", re.ASCII)
"""Syntax of decimal fields; float() alone would accept "1_000", "nan" and Arabic digits."""
_INTEGER_SYNTAX: Final = re.compile(r"\+?(\d{1,9})(\.0*)?", re.ASCII)
"""Syntax of integer fields; a decimal point with zeros may follow."""
_SHA256: Final = re.compile(r"[0-9a-fA-F]{64}")
_PLAIN_HEADERS: Final = re.compile(
    rb'\r\nContent-Disposition: form-data; name="([\w.-]{1,64})"(?:; filename="([\w .-]{0,200})")?\r\n'
    rb"(?:Content-Type: [\w/+.-]{1,100}\r\n)?\r\n"
)
"""Headers of a part as libcurl writes them, after the boundary."""
_PLAIN_BOUNDARY: Final = re.compile(rb"[\w-]{1,70}")
_PLAIN_HEADERS_BYTES: Final = 600
"""More than the longest plain headers."""


class FormReader:
    """Parses a body that is fed piece by piece (``feed``), or in the buffer in which it arrives (``read``).

    Every method may raise ``RequestError``.
    """

    def __init__(self, content_type: str, config: RenderConfig) -> None:
        """
        Args:
            content_type: Content-Type header of the request, with the boundary.
        """
        if len(content_type) > config.max_header_bytes:
            raise RequestError(
                400, f"Content-Type has {len(content_type)} characters, the limit is {config.max_header_bytes}"
            )
        kind, options = parse_options_header(content_type.encode("latin-1", "replace"))
        if kind != b"multipart/form-data":
            got = quoted(content_type) if content_type else "none"
            raise RequestError(400, f"Content-Type must be multipart/form-data, got {got}")
        if not options.get(b"boundary"):
            raise RequestError(400, f"Content-Type names no boundary: {quoted(content_type)}")
        self._config = config
        self._boundary = options[b"boundary"]
        self._delimiter = b"\r\n--" + self._boundary
        self._parser: FormParser | None = None
        self._reset()
        self._position = 0
        """Position in the buffer: of the boundary before the next part, or of what the parser has not seen."""
        self._value_start = 0
        """Position of the value of the part that is arriving; 0: its headers are arriving."""
        self._search_start = 0
        """Position from which the end of that value is searched."""
        self._name = self._filename = b""
        """Names in the headers of that part."""
        if not _PLAIN_BOUNDARY.fullmatch(self._boundary):
            self._start_parser()

    def _reset(self) -> None:
        self._fields: dict[str, str] = {}
        self._scene: bytes | slice | None = None
        """The scene, or its place in the buffer."""
        self._scene_filename = ""
        self._part_count = 0
        self._last_name = ""
        """Name of the last complete part."""
        self._is_complete = False

    def _start_parser(self) -> FormParser:
        """Let python-multipart parse everything from the first byte on."""
        self._reset()
        self._position = 0
        limits = {
            "MAX_MEMORY_FILE_SIZE": math.inf,  # no file on disk
            "MAX_HEADER_COUNT": self._config.max_part_headers,
            "MAX_HEADER_SIZE": self._config.max_header_bytes,
        }
        try:
            self._parser = FormParser(
                "multipart/form-data",
                on_field=self._add_part,
                on_file=self._add_part,
                on_end=self._end,
                boundary=self._boundary,
                config=limits,
            )
        except FormParserError as error:
            raise RequestError(400, f"Content-Type has an unusable boundary: {error}") from None
        return self._parser

    def feed(self, data: bytes) -> None:
        """Parse the next piece of the body."""
        parser = self._parser or self._start_parser()
        size = parser.bytes_received + len(data)
        if size > self._config.max_body_bytes:
            raise body_too_large(size, self._config)
        try:
            parser.write(data)
        except FormParserError as error:
            number = self._part_count + 1
            if isinstance(error, ParseError):
                text = f"the multipart body is malformed in part {number} of the form: {error}"
                raise RequestError(400, text) from None
            raise part_without_name(number) from None  # the only other error while parsing

    def read(self, buffer: bytearray, count: int) -> None:
        """Read the parts that are complete in the first ``count`` bytes of the body.

        Plain parts are cut out by a search for the boundary: a fifth of the event loop's time for a request. From the
        first other part on, python-multipart parses the body.
        """
        if count > self._config.max_body_bytes:
            raise body_too_large(count, self._config)
        if self._parser is None and not self._read_plain(buffer, count):
            self._start_parser()
        if self._parser is not None:
            with memoryview(buffer) as view:
                self.feed(bytes(view[self._position : count]))
            self._position = count

    def _read_plain(self, buffer: bytearray, count: int) -> bool:
        """Read the parts that are complete. Return False if a part is not plain."""
        boundary_bytes = len(self._delimiter) - 2
        while not self._is_complete:
            if not self._value_start:
                start = self._position + boundary_bytes
                if not buffer.startswith(self._delimiter[2 : 2 + count - self._position], self._position):
                    return False
                headers = _PLAIN_HEADERS.match(buffer, start, count)
                if headers is None:
                    if buffer.startswith(b"--\r\n", start) and start + 4 <= count:
                        self._is_complete = True
                        break
                    return count - start < _PLAIN_HEADERS_BYTES and buffer.find(b"\r\n\r\n", start, count) < 0
                if headers[0].count(b"\n") - 2 > self._config.max_part_headers:
                    return False
                self._name, self._filename = headers[1], headers[2] or b""
                self._value_start = self._search_start = headers.end()
            end = buffer.find(self._delimiter, self._search_start, count)
            if end < 0:
                self._search_start = max(self._value_start, count - len(self._delimiter))
                break
            span = slice(self._value_start, end)
            self._add(self._name, self._filename, span if self._name == b"scene" else bytes(buffer[span]))
            self._position, self._value_start = end + 2, 0
        return True

    def _end(self) -> None:
        self._is_complete = True

    def _add_part(self, part: Field | File) -> None:
        """Add a part of the parser."""
        if isinstance(part, File):
            assert isinstance(part.file_object, BytesIO)
            self._add(part.field_name or b"", part.file_name or b"", part.file_object.getvalue())
        else:
            self._add(part.field_name or b"", b"", part.value or b"")

    def _add(self, field_name: bytes, filename: bytes, value: bytes | slice) -> None:
        """Check a complete part, and add its value to the fields, or take it as the scene."""
        self._part_count += 1
        if self._part_count > self._config.max_parts:
            raise RequestError(400, f"the form has more than {self._config.max_parts} parts")
        name = self._last_name = field_name.decode("utf-8", "replace")
        if not name:
            raise part_without_name(self._part_count)
        if name in self._fields or (name == SCENE and self._scene is not None):
            raise RequestError(400, f"the field {quoted(name)} was sent twice")
        if name == SCENE:
            self._scene = value
            self._scene_filename = filename.decode("utf-8", "replace")
            return
        assert isinstance(value, bytes)
        if len(value) > self._config.max_field_bytes:
            limit = self._config.max_field_bytes
            raise RequestError(400, f"the field {quoted(name)} is longer than {limit} bytes")
        try:
            self._fields[name] = value.decode().strip()
        except UnicodeDecodeError:
            raise RequestError(400, f"the field {quoted(name)} is not UTF-8 text: {quoted(value)}") from None

    def close(self) -> None:
        """Break the reference cycles of the parser, which would keep the body until the next garbage collection."""
        if self._parser is not None:
            self._parser.parser = None
            self._parser = None

    def request(self, buffer: bytearray | None = None) -> RenderRequest:
        """Return the request after the whole body has been fed or read.

        Args:
            buffer: the body that was read. It becomes the scene, without a copy.
        """
        if not self._is_complete and self._parser is None:
            self.feed(bytes(buffer or b""))
        if not self._is_complete:
            assert self._parser is not None
            where = f"after {self._parser.bytes_received} bytes, before the closing boundary"
            last = f"; the last complete part is {quoted(self._last_name)}" if self._part_count else ""
            raise RequestError(400, f"the upload was cut short {where}{last}")
        scene: bytes | bytearray | None
        if isinstance(self._scene, slice):
            assert buffer is not None
            scene = buffer
            del scene[self._scene.stop :]
            del scene[: self._scene.start]
        else:
            scene = self._scene
        return read_fields(self._fields, scene, self._config, self._scene_filename)


def part_without_name(number: int) -> RequestError:
    """Return the error for a part whose headers have no name; ``number`` counts from 1."""
    return RequestError(400, f'part {number} of the form needs Content-Disposition: form-data; name="…"')


def body_too_large(size: int, config: RenderConfig) -> RequestError:
    """Return the error for a body of at least ``size`` bytes."""
    limit = config.max_body_bytes
    return RequestError(413, f"the request body has {size} bytes or more, the limit is {limit} (max_body_bytes)")


def read_fields(
    fields: Mapping[str, str], scene: bytes | bytearray | None, config: RenderConfig, scene_filename: str = ""
) -> RenderRequest:
    """Validate every field.

    Args:
        fields: Text parts by name, stripped of white space.
        scene: The glTF file; None: the form has no such part.
        scene_filename: File name as sent by the client; empty if it was not sent.

    Raises:
        RequestError: names the field, its value and what is accepted.
    """
    warnings = [f"the field {quoted(name)} is unknown and ignored" for name in fields if name not in _KNOWN]
    is_depth = fields.get("image_type") == "depth"
    _check_required_and_choices(fields, scene, is_depth)  # below, every required key is there
    assert scene
    numbers = _read_decimals(fields)
    size: dict[str, int] = {}
    for name in ("width", "height"):
        match = _INTEGER_SYNTAX.fullmatch(fields[name])
        size[name] = int(match[1]) if match else 0
        if not 1 <= size[name] <= config.max_side:
            got = quoted(fields[name])
            raise RequestError(400, f"{name} must be a whole number from 1 to {config.max_side}, got {got}")
    if (pixels := size["width"] * size["height"]) > config.max_pixels:
        raise RequestError(400, f"width * height = {pixels} pixels, the limit is {config.max_pixels} (max_pixels)")
    near, far = numbers["near"], numbers["far"]
    if far < MIN_FAR:
        raise RequestError(400, f"far must be at least {MIN_FAR:g}, got {quoted(fields['far'])}")
    if not near < far:
        raise RequestError(400, f"near must be less than far, got near={near:g} and far={far:g}")
    min_depth, max_depth = (numbers["min_depth"], numbers["max_depth"]) if is_depth else (0.0, math.inf)
    if not min_depth < max_depth:
        raise RequestError(400, f"min_depth must be less than max_depth, got {min_depth:g} and {max_depth:g}")
    sha256_text = fields.get("scene_sha256", "")
    has_hash = _SHA256.fullmatch(sha256_text) is not None
    if not has_hash:  # drake-blender's tests send NOT_USED_IN_THE_TEST
        warnings.append(
            f"scene_sha256 is no SHA-256 hash: {quoted(sha256_text)}" if sha256_text else "scene_sha256 is missing"
        )
    return RenderRequest(
        image_type=cast("ImageType", fields["image_type"]),
        width=size["width"],
        height=size["height"],
        **_intrinsics(fields, numbers, size),
        near=near,
        far=far,
        min_depth=min_depth,
        max_depth=max_depth,
        scene=scene,
        claimed_sha256=sha256_text.lower() if has_hash else None,
        scene_filename=scene_filename,
        look=cast("LookChoice | None", fields.get(LOOK_FIELD)),
        warnings=tuple(warnings),
    )


def _check_required_and_choices(fields: Mapping[str, str], scene: bytes | bytearray | None, is_depth: bool) -> None:
    """Check that the fields of an image are there, and those with choices. Raises RequestError."""
    depth_range = ("min_depth", "max_depth") if is_depth else ()
    required = [*_REQUIRED, *depth_range]
    for name, alternative in (("focal_x", "fov_x"), ("focal_y", "fov_y")):
        if not fields.get(alternative):
            required.append(name)
    if LOOK_FIELD in fields:  # it may be left out, but not be empty
        required.append(LOOK_FIELD)
    missing = [name for name in required if not fields.get(name)]
    if missing and (not scene or len(missing) > 1):
        names = [f"'{SCENE}' (the glTF file)"] * (not scene) + [f"'{name}'" for name in missing]
        raise RequestError(400, f"the fields {', '.join(names)} are missing or empty")
    if not scene:
        problem = "(the glTF file) is missing" if scene is None else "is an empty file"
        raise RequestError(400, f"the field '{SCENE}' {problem}")
    for name in missing:
        problem = "is empty" if name in fields else "is missing"
        hint = "; depth images need it" if name in depth_range else ""
        raise RequestError(400, f"the field '{name}' {problem}{hint}")
    for name, choices in (("image_type", IMAGE_TYPES), (LOOK_FIELD, LOOKS)):
        if name in fields and fields[name] not in choices:
            listed = f"{', '.join(choices[:-1])} or {choices[-1]}"
            raise RequestError(400, f"{name} must be {listed}, got {quoted(fields[name])}")


def _read_decimals(fields: Mapping[str, str]) -> dict[str, float]:
    """Return the decimal fields that are not empty. All of them must be valid, those that are not used, too."""
    numbers: dict[str, float] = {}
    for name, bounds in _DECIMAL_BOUNDS.items():
        if not (text := fields.get(name)):
            continue
        value = numbers[name] = float(text) if _DECIMAL_SYNTAX.fullmatch(text) else math.nan
        if not math.isfinite(value):
            raise RequestError(400, f"{name} must be a finite decimal number, got {quoted(text)}")
        if value > bounds.maximum:
            raise RequestError(400, f"{name} must be at most {bounds.maximum:g}, got {quoted(text)}")
        if value < 0.0 or (value == 0.0 and not bounds.may_be_zero):
            minimum = "at least 0" if bounds.may_be_zero else "positive"
            raise RequestError(400, f"{name} must be {minimum}, got {quoted(text)}")
    return numbers


def _intrinsics(fields: Mapping[str, str], numbers: Mapping[str, float], size: Mapping[str, int]) -> dict[str, float]:
    """Return focal lengths and principal point, pixels. A missing focal length is computed from the field of view.

    The principal point must be inside the image, as in Drake's CameraInfo.
    """
    values: dict[str, float] = {}
    for axis, side in (("x", "width"), ("y", "height")):
        focal, fov, center = f"focal_{axis}", f"fov_{axis}", f"center_{axis}"
        pixels = size[side]
        if numbers.get(fov, 0.0) >= math.pi:
            raise RequestError(400, f"{fov} must be less than pi (radians), got {quoted(fields[fov])}")
        if focal in numbers:
            value = numbers[focal]
        else:  # one of the two is required
            value = pixels / (2.0 * math.tan(numbers[fov] / 2.0))
        if not 1.0 / MAX_FOCAL <= value <= MAX_FOCAL:
            raise RequestError(400, f"{focal} = {value:g} pixels is not from {1.0 / MAX_FOCAL:g} to {MAX_FOCAL:g}")
        if not numbers[center] < pixels:
            raise RequestError(400, f"{center} must be less than the {side} ({pixels}), got {quoted(fields[center])}")
        values |= {focal: value, center: numbers[center]}
    return values
