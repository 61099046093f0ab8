"""The browser view: a page that shows the live scene, over one WebSocket per browser.

``routes``           the page, the WebSocket, textures and point-cloud channels
``hub``              the connected browsers and the update loop
``flow_control``     what one browser has and may be sent next; no I/O
``encoder``          one binary update from any revision of the tree to the newest, shared by all browsers
``geometry_json``    parts, draws and materials in an update's JSON header
``frames``           the binary frame: a JSON header and arrays
``resources``        ids of meshes, textures and point clouds, and encoded meshes

``image_routes``     JPEG and MJPEG of the scene, images of the stereo camera, previews of render requests
``scene_images``     the live scene rendered on the server
``sensor_images``    the stereo camera's images
``recent_renders``   the last render requests
``colormaps``        depth, disparity and confidence as RGB images
``shared_results``   one computation for all clients that request the same image

The package depends on ``gateway.scene`` only. Values of other interfaces have the types of ``sources``.
"""
