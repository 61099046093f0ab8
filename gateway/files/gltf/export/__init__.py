"""Scenes as binary glTF 2.0 files: ``export_glb``."""

from gateway.files.gltf.export.exporter import GENERATOR as GENERATOR
from gateway.files.gltf.export.exporter import export_glb as export_glb
from gateway.files.gltf.export.glb_document import MAX_BYTES as MAX_BYTES
