"""Client of the image stream of Scenegate's stereo camera or of a real rc_visard.

``receive`` yields image sets. ``receive_all`` also writes them to files.
"""

from __future__ import annotations

import socket
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from pathlib import Path

import grpc
import numpy as np
from numpy.typing import NDArray

from gateway.client import stream_files
from gateway.client.channel import Credentials
from gateway.client.truth import fetch_truth
from gateway.generated import image_interface_pb2 as pb

METHOD = "/ImageInterface/StreamImageSets"
CONNECT_SECONDS = 10.0
"""Maximum time until the camera is connected."""


class StreamFailure(RuntimeError):  # noqa: N818 - public name
    """The camera ended the stream or cannot be reached; one sentence."""


@dataclass(frozen=True, slots=True)
class StreamOptions:
    """Contents of the image sets, and files to write."""

    target: str
    """``HOST:PORT``; the default port is 50051."""
    left: bool = False
    right: bool = False
    disparity: bool = False
    error: bool = False
    confidence: bool = False
    mesh: bool = False
    color: bool = False
    """Left and right as RGB."""
    max_points: int = 0
    """Maximum number of points of a mesh, at least 1000; 0: no limit."""
    min_depth: bool = False
    """Take the nearest point of each bin of a mesh instead of the mean."""
    watertight: bool = False
    """Fill every hole of the mesh."""
    textured: bool = False
    """Colour the mesh."""
    count: int = 0
    """Number of sets to receive; 0: no limit."""
    output: Path | None = None
    """Folder for PNG, PLY, npz and parameter files, created if missing; None: no files."""
    preview: Path | None = None
    """File with a preview of the newest set, its images side by side."""
    credentials: Credentials = field(default_factory=Credentials)
    """TLS and token."""
    timeout: float | None = None
    """Maximum duration of the stream, seconds; None: no limit."""
    exposure: bool = False
    """Write the exposure of each image; see ``stream_files.save``."""
    gpio: bool = False
    """Write the GPIOs of each image."""
    truth: str | None = None
    """Address of the gateway's HTTP port, ``http://HOST:PORT``, to write the ground truth of each set; None: no
    truth."""
    pipeline: int = 0
    """Number of the camera for ``truth``."""

    def request(self) -> pb.ImageSetRequest:
        """Return the request; without any chosen image, it is for left and disparity."""
        any_chosen = self.left or self.right or self.disparity or self.error or self.confidence or self.mesh
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
        )


@dataclass(slots=True)
class Progress:
    """Statistics of a running stream."""

    sets: int = 0
    """Number of sets received."""
    bytes: int = 0
    """Number of bytes received."""
    seconds: float = 0.0
    """Seconds since the first set."""
    first_set_seconds: float = 0.0
    """Seconds until the first set."""
    timestamp: str = ""
    """Timestamp of the newest set."""
    _last_second: int = -1

    @property
    def rate(self) -> float:
        """Sets per second."""
        return (self.sets - 1) / self.seconds if self.seconds > 0 else 0.0

    def second_passed(self) -> bool:
        """Return True if a new second began since the last call."""
        previous, self._last_second = self._last_second, int(self.seconds)
        return self._last_second > previous

    def line(self) -> str:
        """Return the statistics as one line of text."""
        megabytes_per_second = self.bytes / 1e6 / self.seconds if self.seconds > 0 else 0.0
        return f"{self.sets} sets, {self.rate:.1f} per second, {megabytes_per_second:.1f} MB/s, newest {self.timestamp}"


def receive(options: StreamOptions) -> Iterator[tuple[pb.ImageSet, int]]:
    """Yield sets and their sizes in bytes, until the iterator is closed or ``count`` is reached.

    Raises:
        StreamFailure: no connection, refused request, or broken stream; one sentence.
        OSError: a certificate cannot be read.
    """
    target = options.target if ":" in options.target.rsplit("]", 1)[-1] else f"{options.target}:50051"
    # Full meshes have 55 MB; the vendor's client permits 300.
    settings = [("grpc.max_receive_message_length", -1)]
    with options.credentials.channel(target, settings) as channel:
        try:
            grpc.channel_ready_future(channel).result(CONNECT_SECONDS)
        except grpc.FutureTimeoutError:
            raise StreamFailure(_connection_problem(target)) from None
        # Receive serialised sets, for their size.
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
    """Return why there is no connection. gRPC writes TLS errors to its log only, and retries."""
    host, _, port = target.rpartition(":")
    try:
        socket.create_connection((host.strip("[]"), int(port)), CONNECT_SECONDS).close()
    except (ValueError, OverflowError):
        return f"{target} is no HOST:PORT: {port!r} is no port"
    except OSError:
        return f"no answer from {target}"
    return (
        f"{target} accepts connections, but does not answer: only one side uses TLS, its certificate is not made for "
        "this name or not trusted, it wants one to be shown, or it is no gRPC server"
    )


def receive_all(options: StreamOptions, report: Callable[[Progress], None] = lambda _: None) -> Progress:
    """Receive sets, write the requested files, and call ``report`` after each set.

    Returns:
        The final statistics.

    Raises:
        StreamFailure, OSError: see ``receive``; or a file cannot be written.
        TruthFailure: no ground truth of a set.
    """
    progress = Progress()
    start = time.monotonic()
    if options.output is not None:
        options.output.mkdir(parents=True, exist_ok=True)
    for image_set, size in receive(options):
        now = time.monotonic()
        if progress.sets == 0:
            progress.first_set_seconds, start = now - start, now
        progress.sets += 1
        progress.bytes += size
        progress.seconds = now - start
        progress.timestamp = stream_files.timestamp_text(image_set.timestamp)
        if options.output is not None:
            stream_files.save(image_set, options.output, exposure=options.exposure, gpio=options.gpio)
            if options.truth is not None:
                truth = fetch_truth(options.truth, progress.timestamp, options.credentials, options.pipeline)
                (options.output / f"image_{progress.timestamp}_truth.npz").write_bytes(truth)
        if options.preview is not None:
            stream_files.write_image(options.preview, stream_files.preview(image_set))
        report(progress)
    return progress


def depth_of(disparity: pb.DisparityImage) -> NDArray[np.float32]:
    """Return the depth ``f t / d``, (H, W) float32, metres along the optical axis, +inf where the disparity is
    invalid."""
    return stream_files.depth(disparity)
