"""glTF 2.0 documents (``.gltf`` with embedded or resolved data, ``.glb``) as scenes, and scenes as ``.glb`` files.

``read_gltf`` (``reader``) is the entry point; its module lists the steps. It never decodes an image, never follows a
URI on its own, and refuses documents beyond ``GltfLimits``. Equal contents become equal objects, across documents
through a shared ``GltfCache``. ``export.export_glb`` writes a tree.
"""

from gateway.gltf.buffers import Resolver
from gateway.gltf.cameras import GltfCamera
from gateway.gltf.document_cache import DocumentContent, HashedDocument
from gateway.gltf.errors import GltfError
from gateway.gltf.gltf_cache import GltfCache
from gateway.gltf.limits import GltfLimits
from gateway.gltf.materials import DEFAULT_MATERIAL, label_from_material
from gateway.gltf.reader import read_gltf
from gateway.gltf.scene import GltfScene
from gateway.gltf.schema import DRAKE_GENERATORS, DRAKE_MERGER

__all__ = [
    "DEFAULT_MATERIAL",
    "DRAKE_GENERATORS",
    "DRAKE_MERGER",
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
]
