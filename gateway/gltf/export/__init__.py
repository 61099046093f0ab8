"""Scenes as binary glTF 2.0 files: ``export_glb``."""

from gateway.gltf.export.exporter import GENERATOR, export_glb, export_motion_glb
from gateway.gltf.export.glb_document import MAX_BYTES, ExportError
from gateway.gltf.export.motion import Motion

__all__ = ["GENERATOR", "MAX_BYTES", "ExportError", "Motion", "export_glb", "export_motion_glb"]
