"""Arrays in, pictures out: a CPU rasterizer that knows no scene graph, no protocol and no event loop."""
