"""The browser view: a page that shows the live scene. Each open page has one WebSocket to the gateway.

``routes``           the page's files, the WebSocket, textures and channels of point clouds
``hub``              the connected browsers, and the loop that sends them updates
``browser``          the connection to one page: its snapshot and meshes, and the frames to send; without I/O
``playback``         the time that a page shows: live, paused, playing; commands of its time bar
``encoder``          updates: the differences between two revisions of the scene, encoded once for all browsers
``messages``         all messages to and from the page; the page's types are written from them
``geometry_messages``    parts, draws and materials as those of messages
``light``            the light of the page: the rig of the gateway's images
``frames``           the format of binary WebSocket messages: a JSON header and arrays; those with controls
``resources``        ids of meshes, textures and point clouds, and encoded meshes

``image_routes``     JPEG and MJPEG of the scene, images of the stereo camera, images of render requests
``scene_images``     the live scene, rendered by the gateway
``sensor_images``    the stereo camera's images; depth, disparity and confidence as RGB images

``config``           limits and defaults
``sources``          types of the values that other interfaces provide

The package imports no other interface of the gateway.
"""
