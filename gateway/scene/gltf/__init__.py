"""glTF 2.0 documents (``.gltf`` with embedded or resolved data, ``.glb``) as trees of nodes.

``read_gltf`` is the way in. It never decodes an image, never follows a URI on its own and accepts nothing that
``GltfLimits`` does not allow; equal contents become equal objects, across documents by a shared ``MeshCache``.
"""

from gateway.scene.gltf.buffers import Resolver
from gateway.scene.gltf.cache import CacheStats, MeshCache
from gateway.scene.gltf.document_cache import HashedDocument
from gateway.scene.gltf.errors import GltfError
from gateway.scene.gltf.kernels import warm_up
from gateway.scene.gltf.limits import GltfLimits
from gateway.scene.gltf.materials import DEFAULT_MATERIAL, label_from_material
from gateway.scene.gltf.reader import read_gltf
from gateway.scene.gltf.scene import DRAKE_GENERATORS, GltfCamera, GltfCounts, GltfScene

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
