"""CPU rasterizer: draw lists and cameras in, images out. Independent of scene graph, protocols and event loop."""
