"""Reads glTF 2.0 documents (``.gltf`` and ``.glb``) as scenes, and writes scenes as ``.glb`` files.

``read_gltf`` is the entry point; its module ``reader`` lists the steps. The reader decodes no images, opens no files by
itself, and rejects documents beyond ``GltfLimits``. Documents that share a ``GltfCache`` share one ``Mesh`` or
``Image`` object for equal bytes. ``export.export_glb`` writes a scene tree.

In all functions, ``warnings`` is a list to which sentences about what is left out or repaired are appended. For these
and for errors, ``name`` is an object in the document, such as ``meshes[2].primitives[0]``, and ``path`` a property that
refers to something, such as ``nodes[3].mesh``.
"""

from gateway.files.gltf.animations import AnimationTime as AnimationTime
from gateway.files.gltf.buffers import Resolver as Resolver
from gateway.files.gltf.document_cache import DocumentContent as DocumentContent
from gateway.files.gltf.document_cache import GltfCache as GltfCache
from gateway.files.gltf.document_cache import HashedDocument as HashedDocument
from gateway.files.gltf.gltf_errors import GltfError as GltfError
from gateway.files.gltf.gltf_errors import GltfLimits as GltfLimits
from gateway.files.gltf.gltf_scene import GltfScene as GltfScene
from gateway.files.gltf.gltf_scene import PlacedCamera as PlacedCamera
from gateway.files.gltf.gltf_scene import Up as Up
from gateway.files.gltf.material_reader import DEFAULT_MATERIAL as DEFAULT_MATERIAL
from gateway.files.gltf.material_reader import label_from_material as label_from_material
from gateway.files.gltf.reader import read_gltf as read_gltf
from gateway.files.gltf.reader import read_mesh_names as read_mesh_names
from gateway.files.gltf.schema import DRAKE_MERGER as DRAKE_MERGER
from gateway.files.gltf.schema import VTK_EXPORTER as VTK_EXPORTER
