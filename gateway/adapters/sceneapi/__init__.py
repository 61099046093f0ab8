"""The live scene over HTTP: ``GET /scene``, ``/scene.glb`` and ``/scene/render``.

``routes``   the routes, ETags and error responses
``query``    query parameters and their OpenAPI description
``service``  listing, glTF file and images of the newest snapshot
"""
