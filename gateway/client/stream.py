"""A client of the stereo camera's image stream: of ours and of a real rc_visard alike.

``receive_all`` receives sets and keeps them as files; ``receive`` is the bare loop, for programs.
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
_CONNECT_SECONDS = 10.0


class StreamFailure(RuntimeError):  # noqa: N818 - it ends with what failed
    """The stream ended otherwise than by our will; one sentence."""


@dataclass(frozen=True, slots=True)
class StreamOptions:
    """What to ask for and what to keep."""

    target: str
    """``HOST:PORT``; port 50051 when it has none."""
    left: bool = False
    right: bool = False
    disparity: bool = False
    error: bool = False
    confidence: bool = False
    mesh: bool = False
    color: bool = False
    """Left and right as RGB."""
    max_points: int = 0
    """Of a mesh; 0: no limit, else at least 1000."""
    min_depth: bool = False
    """Binned meshes take the nearest point instead of the mean."""
    watertight: bool = False
    textured: bool = False
    count: int = 0
    """End after this many sets; 0: go on until interrupted."""
    output: Path | None = None
    """Folder for PNG, PLY, npz and parameter files, made if need be; None: nothing is kept."""
    preview: Path | None = None
    """Picture file that shows the images of the newest set side by side."""
    credentials: Credentials = field(default_factory=Credentials)
    """TLS and token, where the camera wants them."""
    timeout: float | None = None
    """Seconds after which the stream ends with a failure; None: never."""
    exposure: bool = False
    """Keep how each image was exposed; see ``stream_files.save``."""
    gpio: bool = False
    """Keep the GPIOs of each image."""
    truth: str | None = None
    """Address of the gateway's HTTP port, ``http://HOST:PORT``: keep the ground truth of each set from there."""
    pipeline: int = 0
    """Number of the camera for ``truth``, where there are several."""

    def request(self) -> pb.ImageSetRequest:
        """The message; left and disparity when nothing was chosen."""
        chosen = self.left or self.right or self.disparity or self.error or self.confidence or self.mesh
        return pb.ImageSetRequest(
            left_enabled=self.left or not chosen,
            right_enabled=self.right,
            disparity_enabled=self.disparity or not chosen,
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
    """Figures of a running stream."""

    sets: int = 0
    bytes: int = 0
    seconds: float = 0.0
    """Since the first set came."""
    first: float = 0.0
    """Seconds until the first set came."""
    stamp: str = ""
    """Of the newest set."""
    _told: int = -1

    @property
    def rate(self) -> float:
        """Sets per second."""
        return (self.sets - 1) / self.seconds if self.seconds > 0 else 0.0

    def second_passed(self) -> bool:
        """Whether a second began since this was asked for the last time."""
        before, self._told = self._told, int(self.seconds)
        return self._told > before

    def line(self) -> str:
        """For people."""
        volume = self.bytes / 1e6 / self.seconds if self.seconds > 0 else 0.0
        return f"{self.sets} sets, {self.rate:.1f} per second, {volume:.1f} MB/s, newest {self.stamp}"


def receive(options: StreamOptions) -> Iterator[tuple[pb.ImageSet, int]]:
    """Sets and their sizes in bytes as they come, until the iterator is closed or ``count`` is reached.

    Raises:
        StreamFailure: nobody answers, the request is refused, or the stream broke; one sentence.
        OSError: a certificate cannot be read.
    """
    target = options.target if ":" in options.target.rsplit("]", 1)[-1] else f"{options.target}:50051"
    # Full meshes have 55 MB; the device's own client allows 300.
    settings = [("grpc.max_receive_message_length", -1)]
    with options.credentials.channel(target, settings) as channel:
        try:
            grpc.channel_ready_future(channel).result(_CONNECT_SECONDS)
        except grpc.FutureTimeoutError:
            raise StreamFailure(_why_silent(target)) from None
        # The serialised set is kept as it came: its size is the figure that counts on the wire.
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


def _why_silent(target: str) -> str:
    """gRPC tells a wrong certificate and a port without TLS only to its own log, and goes on trying."""
    host, _, port = target.rpartition(":")
    try:
        socket.create_connection((host.strip("[]"), int(port)), _CONNECT_SECONDS).close()
    except (ValueError, OverflowError):
        return f"{target} is no HOST:PORT: {port!r} is no port"
    except OSError:
        return f"nobody answers at {target}"
    return (
        f"{target} takes connections, but does not answer: only one side uses TLS, its certificate is not made for "
        "this name or not trusted, it wants one to be shown, or it is no gRPC server"
    )


def receive_all(options: StreamOptions, report: Callable[[Progress], None] = lambda _: None) -> Progress:
    """Receives sets, keeps what was asked for, and calls ``report`` after each.

    Returns:
        The figures at the end.

    Raises:
        StreamFailure, OSError: see ``receive``; or a file cannot be written.
        TruthFailure: there is no ground truth of a set.
    """
    progress = Progress()
    begin = time.monotonic()
    if options.output is not None:
        options.output.mkdir(parents=True, exist_ok=True)
    for image_set, size in receive(options):
        now = time.monotonic()
        if progress.sets == 0:
            progress.first, begin = now - begin, now
        progress.sets += 1
        progress.bytes += size
        progress.seconds = now - begin
        progress.stamp = stream_files.stamp(image_set.timestamp)
        if options.output is not None:
            stream_files.save(image_set, options.output, exposure=options.exposure, gpio=options.gpio)
            if options.truth is not None:
                data = fetch_truth(options.truth, progress.stamp, options.credentials, options.pipeline)
                (options.output / f"image_{progress.stamp}_truth.npz").write_bytes(data)
        if options.preview is not None:
            stream_files.write_picture(options.preview, stream_files.preview(image_set))
        report(progress)
    return progress


def depth_of(disparity: pb.DisparityImage) -> NDArray[np.float32]:
    """(H, W) float32 metres along the optical axis, +inf where the disparity is invalid: ``f t / d``."""
    return stream_files.depth(disparity)
