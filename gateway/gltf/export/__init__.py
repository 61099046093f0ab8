"""Scenes as binary glTF 2.0 files: ``export_glb``."""

from gateway.gltf.export.exporter import GENERATOR, export_glb
from gateway.gltf.export.glb_document import MAX_BYTES, ExportError

__all__ = ["GENERATOR", "MAX_BYTES", "ExportError", "export_glb"]
