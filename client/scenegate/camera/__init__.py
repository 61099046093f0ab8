"""Receives the image sets of Scenegate's stereo camera or of a real rc_visard over gRPC.

Needs grpcio and protobuf: ``scenegate-client[camera]``.
"""

from __future__ import annotations

try:
    from scenegate.camera import image_interface_pb2 as image_interface_pb2
    from scenegate.camera.stream import StreamFailure as StreamFailure
except ImportError as _error:
    raise ImportError(f"{_error}; the camera needs pip install 'scenegate-client[camera]'") from None

from scenegate.camera.files import BadImageError as BadImageError
from scenegate.camera.files import Points as Points
from scenegate.camera.files import depth as depth
from scenegate.camera.files import intrinsics as intrinsics
from scenegate.camera.files import pixels as pixels
from scenegate.camera.files import points as points
from scenegate.camera.files import preview as preview
from scenegate.camera.files import save as save
from scenegate.camera.stream import StreamOptions as StreamOptions
from scenegate.camera.stream import fetch_truth as fetch_truth
from scenegate.camera.stream import receive as receive
from scenegate.camera.stream import receive_all as receive_all
from scenegate.credentials import Credentials as Credentials
from scenegate.gateway_http import GatewayError as GatewayError
