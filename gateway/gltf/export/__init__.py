"""Scenes as binary glTF 2.0 files: ``export_glb``, with motion ``MotionWriter``."""

from gateway.gltf.export.exporter import GENERATOR, export_glb
from gateway.gltf.export.glb_document import MAX_BYTES
from gateway.gltf.export.motion import MotionWriter

__all__ = ["GENERATOR", "MAX_BYTES", "MotionWriter", "export_glb"]
