"""glTF 2.0 documents (``.gltf`` with embedded or resolved data, ``.glb``) as trees of nodes.

``read_gltf`` is the way in. It never decodes an image, never follows a URI on its own and accepts nothing that
``GltfLimits`` does not allow; equal contents become equal objects, across documents by a shared ``MeshCache``.
"""

from gateway.gltf.buffers import Resolver
from gateway.gltf.content_cache import CacheStats, MeshCache
from gateway.gltf.document_cache import HashedDocument
from gateway.gltf.errors import GltfError
from gateway.gltf.limits import GltfLimits
from gateway.gltf.materials import DEFAULT_MATERIAL, label_from_material
from gateway.gltf.reader import read_gltf
from gateway.gltf.reader_kernels import warm_up
from gateway.gltf.scene import DRAKE_GENERATORS, GltfCamera, GltfCounts, GltfScene

__all__ = [
    "DEFAULT_MATERIAL",
    "DRAKE_GENERATORS",
    "CacheStats",
    "GltfCamera",
    "GltfCounts",
    "GltfError",
    "GltfLimits",
    "GltfScene",
    "HashedDocument",
    "MeshCache",
    "Resolver",
    "label_from_material",
    "read_gltf",
    "warm_up",
]
