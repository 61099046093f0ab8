"""Reads glTF 2.0 documents (``.gltf`` and ``.glb``) as scenes, and writes scenes as ``.glb`` files.

``read_gltf`` is the entry point; its module ``reader`` lists the steps. The reader decodes no images, opens no files by
itself, and rejects documents beyond ``GltfLimits``. Documents that share a ``GltfCache`` share one ``Mesh`` or
``Image`` object for equal bytes. Functions append sentences about what is left out or repaired to the list
``warnings``. ``export.export_glb`` writes a scene tree.
"""

from gateway.gltf.animations import AnimationTime
from gateway.gltf.buffers import Resolver
from gateway.gltf.document_cache import DocumentContent, GltfCache, HashedDocument
from gateway.gltf.errors import GltfError
from gateway.gltf.limits import GltfLimits
from gateway.gltf.materials import DEFAULT_MATERIAL, label_from_material
from gateway.gltf.reader import read_gltf, read_mesh_names
from gateway.gltf.scene import GltfCamera, GltfScene
from gateway.gltf.schema import DRAKE_GENERATORS, DRAKE_MERGER

__all__ = [
    "DEFAULT_MATERIAL",
    "DRAKE_GENERATORS",
    "DRAKE_MERGER",
    "AnimationTime",
    "DocumentContent",
    "GltfCache",
    "GltfCamera",
    "GltfError",
    "GltfLimits",
    "GltfScene",
    "HashedDocument",
    "Resolver",
    "label_from_material",
    "read_gltf",
    "read_mesh_names",
]
