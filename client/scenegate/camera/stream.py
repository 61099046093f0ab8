"""Receive the image sets of Scenegate's stereo camera or of a real rc_visard, over gRPC.

``receive`` yields the sets. ``receive_all`` also writes them to files, for ``scenegate stream``.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Generator
from dataclasses import dataclass, field
from pathlib import Path

import grpc

from scenegate.camera import files
from scenegate.camera import image_interface_pb2 as pb
from scenegate.credentials import Credentials
from scenegate.gateway_http import fetch, parse_address
from scenegate.regular_files import write_whole

METHOD = "/ImageInterface/StreamImageSets"
"""The gRPC method of the stream."""
CONNECT_SECONDS = 10.0
"""Timeout for the connection to the camera."""
TRUTH_SECONDS = 60.0
"""Timeout of a request for ground truth. The gateway queues the frame and renders it again."""

_CHANNEL_OPTIONS = [
    ("grpc.max_receive_message_length", -1),  # complete meshes have 55 MB, and gRPC's default limit is 4 MB
    # A receive window of 1 MB and one set. By default it grows, and a slow reader gets old sets: reading left and
    # disparity 5 times a second, of 20, they are 0.3 s old instead of 0.6, and small ones 0.7 s instead of 2.2.
    ("grpc.http2.bdp_probe", 0),
    ("grpc.http2.lookahead_bytes", 1 << 20),
]


class StreamFailure(RuntimeError):  # noqa: N818 - public name
    """The camera cannot be reached, or ended the stream; the message is one sentence."""


@dataclass(frozen=True, slots=True)
class StreamOptions:
    """Address of the camera, contents of the image sets, and files to write."""

    target: str
    """``HOST:PORT`` or ``HOST``. The default port is 50051."""
    left: bool = False
    """Receive the left image."""
    right: bool = False
    """Receive the right image."""
    disparity: bool = False
    """Receive the disparity image."""
    error: bool = False
    """Receive the disparity error image."""
    confidence: bool = False
    """Receive the confidence image."""
    mesh: bool = False
    """Receive the mesh."""
    color: bool = False
    """Receive the left and right images in RGB instead of grey."""
    color_camera: bool = False
    """Receive the image of the colour camera (Scenegate only)."""
    depth: bool = False
    """Receive depth in millimetres (Scenegate only)."""
    aligned: bool = False
    """Receive ``depth`` as seen by the colour camera."""
    max_points: int = 0
    """Maximum number of points of a mesh, at least 1000; 0: no limit."""
    min_depth: bool = False
    """Use the nearest point in each bin of pixels of a mesh instead of the mean."""
    watertight: bool = False
    """Receive a mesh without holes."""
    textured: bool = False
    """Receive a mesh with colours."""
    count: int = 0
    """Number of sets to receive; 0: no limit."""
    output: Path | None = None
    """Folder for PNG, PLY, npz and parameter files, which is created if missing; None: do not write these files."""
    preview: Path | None = None
    """Image file to write with all images of the newest set, side by side; None: do not write it."""
    credentials: Credentials = field(default_factory=Credentials)
    """Token and TLS certificates."""
    timeout: float | None = None
    """Maximum duration of the stream, seconds; None: no limit."""
    exposure: bool = False
    """Write the exposure of each image to ``output``; see ``files.save``."""
    gpio: bool = False
    """Write the GPIOs of each image to ``output``; see ``files.save``."""
    truth: str | None = None
    """Address of the gateway's HTTP port, ``http://HOST:PORT``, from which to write the ground truth of each set to
    ``output``; None: do not write it."""
    pipeline: int = 0
    """Number of the camera whose ground truth is written."""

    def request(self) -> pb.ImageSetRequest:
        """Return the gRPC request. If neither image nor mesh is chosen, it is for left and disparity."""
        rc_visard_images = self.left or self.right or self.disparity or self.error or self.confidence or self.mesh
        any_chosen = rc_visard_images or self.color_camera or self.depth
        return pb.ImageSetRequest(
            left_enabled=self.left or not any_chosen,
            right_enabled=self.right,
            disparity_enabled=self.disparity or not any_chosen,
            disparity_error_enabled=self.error,
            confidence_enabled=self.confidence,
            mesh_enabled=self.mesh,
            mesh_options=pb.MeshOptions(
                max_points=self.max_points,
                binning_method=pb.MeshOptions.MIN_DEPTH if self.min_depth else pb.MeshOptions.AVERAGE,
                watertight=self.watertight,
                textured=self.textured,
            )
            if self.mesh
            else None,
            color=self.color,
            color_camera_enabled=self.color_camera,
            depth_mm_enabled=self.depth,
            depth_aligned=self.aligned,
        )


@dataclass(slots=True)
class Progress:
    """Statistics of a running stream."""

    sets: int = 0
    """Number of sets received."""
    bytes: int = 0
    """Bytes of all sets received."""
    seconds: float = 0.0
    """Time from the first to the newest set, in seconds."""
    timestamp: str = ""
    """Timestamp of the newest set, ``sec.nsec``."""
    _last_second: int = 0
    """``seconds``, rounded down, at the last call of ``second_passed``."""

    @property
    def rate(self) -> float:
        """Sets per second."""
        return (self.sets - 1) / self.seconds if self.seconds > 0 else 0.0

    def second_passed(self) -> bool:
        """Return True if ``seconds``, rounded down, has increased since the last call."""
        previous, self._last_second = self._last_second, int(self.seconds)
        return self._last_second > previous

    def line(self) -> str:
        """Return the statistics as one line of text."""
        text = f"{self.sets} sets"
        if self.seconds > 0:
            text += f", {self.rate:.1f} per second, {self.bytes / 1e6 / self.seconds:.1f} MB/s"
        return f"{text}, newest {self.timestamp}"


def receive(options: StreamOptions) -> Generator[tuple[pb.ImageSet, int], None, None]:
    """Yield image sets and their sizes in bytes, until ``count`` is reached or the iterator is closed.

    Raises:
        StreamFailure: the camera cannot be reached, refuses the request, or ends the stream.
        OSError: a certificate cannot be read.
    """
    if not isinstance(options.target, str) or options.target.startswith(("http://", "https://")):
        raise StreamFailure(f"the camera's address must be like 127.0.0.1:50051, not {options.target!r}")
    target = options.target if ":" in options.target.rsplit("]", 1)[-1] else f"{options.target}:50051"
    with options.credentials.channel(target, _CHANNEL_OPTIONS) as channel:
        try:
            grpc.channel_ready_future(channel).result(CONNECT_SECONDS)
        except grpc.FutureTimeoutError:
            raise StreamFailure(_connection_problem(target)) from None
        # Without a deserializer the sets are bytes, whose size is known.
        open_stream = channel.unary_stream(METHOD, request_serializer=pb.ImageSetRequest.SerializeToString)
        call = open_stream(options.request(), timeout=options.timeout, metadata=options.credentials.metadata)
        try:
            for number, data in enumerate(call, 1):
                yield pb.ImageSet.FromString(data), len(data)
                if number == options.count:
                    break
            else:
                raise StreamFailure(f"{target} ended the stream")
        except grpc.RpcError as error:
            raise StreamFailure(f"{target} ended the stream: {error.code().name}: {error.details()}") from None
        finally:
            call.cancel()


def _connection_problem(target: str) -> str:
    """Return why gRPC cannot connect. gRPC does not tell: it logs TLS errors and tries again."""
    host, _, port = target.rpartition(":")
    try:
        socket.create_connection((host.strip("[]"), int(port)), CONNECT_SECONDS).close()
    except (ValueError, OverflowError):
        return f"{target} is not HOST:PORT: {port!r} is not a port"
    except OSError:
        return (
            f"no answer from {target}: is a gateway running there, with its stereo camera on this port (--grpc-port, "
            "50051 by default)? `scenegate serve --demo` starts one"
        )
    return (
        f"{target} accepts connections, but does not answer: only one side uses TLS, its certificate is not made for "
        "this name or not trusted, it asks for a client certificate, or it is not a gRPC server"
    )


def receive_all(options: StreamOptions, report: Callable[[Progress], None] = lambda _: None) -> Progress:
    """Receive sets, write the requested files, and call ``report`` after each set.

    Returns:
        Statistics of the whole stream.

    Raises:
        StreamFailure: as ``receive``.
        OSError: a certificate cannot be read, or a file cannot be written.
        GatewayError: ground truth cannot be received.
    """
    if options.truth is not None:
        parse_address(options.truth, options.credentials)
    if options.output is not None:
        options.output.mkdir(parents=True, exist_ok=True)
    progress = Progress()
    start = time.monotonic()
    for image_set, size in receive(options):
        now = time.monotonic()
        if progress.sets == 0:
            start = now
        progress.sets += 1
        progress.bytes += size
        progress.seconds = now - start
        progress.timestamp = files.timestamp_text(image_set.timestamp)
        if options.output is not None:
            files.save(image_set, options.output, exposure=options.exposure, gpio=options.gpio)
            if options.truth is not None:
                truth = fetch_truth(options.truth, progress.timestamp, options.credentials, options.pipeline)
                write_whole(options.output / f"image_{progress.timestamp}_truth.npz", truth)
        if options.preview is not None:
            files.write_image(options.preview, files.preview(image_set))
        report(progress)
    return progress


_ANONYMOUS = Credentials()


def fetch_truth(address: str, timestamp: str, credentials: Credentials = _ANONYMOUS, pipeline: int = 0) -> bytes:
    """Return the content of ``/stereo/truth.npz`` for an image set: exact depth and labels.

    Args:
        address: address of the gateway's HTTP port, ``http://HOST:PORT``.
        timestamp: timestamp of the set, ``sec.nsec``.
        credentials: token and TLS certificates.
        pipeline: number of the camera.

    Raises:
        GatewayError: the gateway does not respond, or does not have this set.
        OSError: a certificate cannot be read.
    """
    wanted, path = f"ground truth of {timestamp}", "stereo/truth.npz"
    return fetch(address, path, credentials, wanted, TRUTH_SECONDS, timestamp=timestamp, pipeline=pipeline)
