"""Scenes as binary glTF 2.0 files: ``export_glb`` is the way in."""

from gateway.gltf.export.document import MAX_BYTES, ExportError
from gateway.gltf.export.tree import GENERATOR, export_glb

__all__ = ["GENERATOR", "MAX_BYTES", "ExportError", "export_glb"]
