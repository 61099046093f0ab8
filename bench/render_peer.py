"""A glTF render server on VTK: ``render_peer.py``, a process that ``render.py`` starts. It prints its port.

What Drake's own demo server does (vtkGLTFImporter, off-screen window, vtkPNGWriter, vtkTIFFWriter), with everything
made cheaper that can be: the window lives on, the scene is read from memory instead of a file, the form is taken apart
with two searches, and no hash is checked. Needs nothing of the repository, so that it runs in VTK's own environment.
"""

from __future__ import annotations

import os
import tempfile
import time
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")

import numpy as np
import vtk
from vtk.util.numpy_support import numpy_to_vtk, vtk_to_numpy

BACKGROUND = (204 / 255, 229 / 255, 255 / 255)


class Painter:
    """One window for all requests."""

    def __init__(self) -> None:
        self.window = vtk.vtkRenderWindow()
        self.window.SetOffScreenRendering(1)
        self.window.SetMultiSamples(0)
        self.folder = Path(tempfile.mkdtemp())

    def picture(self, fields: dict[str, str], scene: bytes) -> tuple[bytes, str, list[float]]:
        """The file, its type, and when each stage ended."""
        kind, width, height = fields["image_type"], int(fields["width"]), int(fields["height"])
        renderer = vtk.vtkRenderer()
        stream = vtk.vtkMemoryResourceStream()
        stream.SetBuffer(scene, len(scene))
        importer = vtk.vtkGLTFImporter()
        importer.SetStream(stream)
        self.window.AddRenderer(renderer)
        importer.SetRenderWindow(self.window)
        importer.SetCamera(0)
        importer.Update()
        stages = [time.perf_counter()]
        try:
            self.draw(renderer, kind, width, height, fields)
            stages.append(time.perf_counter())
            if kind == "depth":
                body, media_type = self.depth(width, height, fields), "image/tiff"
            else:
                body, media_type = self.png(), "image/png"
        finally:
            self.window.RemoveRenderer(renderer)
        stages.append(time.perf_counter())
        return body, media_type, stages

    def draw(self, renderer: vtk.vtkRenderer, kind: str, width: int, height: int, fields: dict[str, str]) -> None:
        near, far = float(fields["near"]), float(fields["far"])
        camera = renderer.GetActiveCamera()
        matrix = vtk.vtkMatrix4x4()
        rows = (
            (2 * float(fields["focal_x"]) / width, 0, 1 - 2 * float(fields["center_x"]) / width, 0),
            (0, 2 * float(fields["focal_y"]) / height, 2 * float(fields["center_y"]) / height - 1, 0),
            (0, 0, -(far + near) / (far - near), -2 * far * near / (far - near)),
            (0, 0, -1, 0),
        )
        matrix.DeepCopy([value for row in rows for value in row])
        camera.SetExplicitProjectionTransformMatrix(matrix)
        camera.SetUseExplicitProjectionTransformMatrix(True)
        renderer.SetUseFXAA(kind == "color")
        renderer.SetBackground(BACKGROUND if kind == "color" else (1, 1, 1))
        if kind != "color":
            actors = renderer.GetActors()
            actors.InitTraversal()
            while (actor := actors.GetNextActor()) is not None:
                surface = actor.GetProperty()
                surface.RemoveAllTextures()
                actor.SetTexture(None)
                surface.SetInterpolationToGouraud()
                surface.SetLighting(False)
        self.window.SetSize(width, height)
        self.window.Render()

    def png(self) -> bytes:
        grabber = vtk.vtkWindowToImageFilter()
        grabber.SetInput(self.window)
        grabber.SetInputBufferTypeToRGB()
        grabber.ReadFrontBufferOff()
        grabber.ShouldRerenderOff()
        writer = vtk.vtkPNGWriter()
        writer.SetInputConnection(grabber.GetOutputPort())
        writer.WriteToMemoryOn()
        writer.Write()
        return bytes(vtk_to_numpy(writer.GetResult()))

    def depth(self, width: int, height: int, fields: dict[str, str]) -> bytes:
        near, far = float(fields["near"]), float(fields["far"])
        buffer = vtk.vtkFloatArray()
        self.window.GetZbufferData(0, 0, width - 1, height - 1, buffer)
        z = vtk_to_numpy(buffer)
        depth = np.float32(far * near) / (np.float32(far) - z * np.float32(far - near))
        depth[(z == 1.0) | (depth >= np.float32(fields["max_depth"]))] = np.inf
        depth[depth <= np.float32(fields["min_depth"])] = 0.0
        image = vtk.vtkImageData()
        image.SetDimensions(width, height, 1)
        image.GetPointData().SetScalars(numpy_to_vtk(depth))
        writer = vtk.vtkTIFFWriter()
        path = self.folder / "depth.tiff"
        writer.SetFileName(str(path))
        writer.SetCompressionToNoCompression()
        writer.SetInputData(image)
        writer.Write()
        return path.read_bytes()


def taken_apart(body: bytes, content_type: str) -> tuple[dict[str, str], bytes]:
    """The text fields of the form, and the scene, which is its last part."""
    boundary = b"--" + content_type.partition("boundary=")[2].encode()
    begin = body.index(b"\r\n\r\n", body.index(b'name="scene";')) + 4
    fields = {}
    for part in body[:begin].split(boundary)[1:-1]:
        head, _, value = part.partition(b"\r\n\r\n")
        fields[head.partition(b'name="')[2].partition(b'"')[0].decode()] = value.strip().decode()
    return fields, body[begin : body.rindex(b"\r\n" + boundary)]


class Handler(BaseHTTPRequestHandler):
    painter: Painter

    def do_POST(self) -> None:
        body = self.rfile.read(int(self.headers["Content-Length"]))
        begin = time.perf_counter()
        fields, scene = taken_apart(body, self.headers["Content-Type"])
        answer, media_type, stages = self.painter.picture(fields, scene)
        self.send_response(200)
        self.send_header("Content-Type", media_type)
        self.send_header("Content-Length", str(len(answer)))
        took = [1e3 * (after - before) for before, after in zip([begin, *stages], stages, strict=False)]
        named = zip(("parse", "render", "encode"), took, strict=True)
        self.send_header("Server-Timing", ", ".join(f"{name};dur={ms:.2f}" for name, ms in named))
        self.send_header("Connection", "close")
        self.end_headers()
        self.wfile.write(answer)

    def log_message(self, *_: object) -> None:
        pass


def main() -> None:
    Handler.painter = Painter()
    server = HTTPServer(("127.0.0.1", 0), Handler)
    server.socket.listen(64)
    print(server.server_address[1], flush=True)
    server.serve_forever()


if __name__ == "__main__":
    main()
