"""The frames of ``raster.py`` drawn by another renderer, in a process of its own that ``raster.py`` starts.

    python bench/raster_peer.py moderngl|vtk|panda3d|moderngl-4|vtk-8|vtk-pbr

Reads commands from standard input, a line each: ``load FILE WIDTH HEIGHT`` (a scene as ``raster.py`` writes it) and
``draw FRAME``, which draws, reads everything back into arrays and answers with milliseconds, wall and CPU of all
threads. Contexts and windows live on, geometry is uploaded once. Needs nothing of the repository, so that it runs in
the renderer's own environment.
"""

from __future__ import annotations

import math
import os
import sys
import time
from typing import Any

import numpy as np

os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
NEAR, FAR = 0.05, 10.0
BACKGROUND = (204 / 255, 229 / 255, 1.0)


def camera(frame: int) -> np.ndarray:
    """Return the camera position (+Z forward, +Y down) of ``raster.view``."""
    return np.array((0.01 * math.sin(frame), 0.01 * math.cos(frame), -3.0))


class Peer:
    """A scene of instances: mesh arrays, pose, colour, label, and for some a texture."""

    def load(self, scene: Any, width: int, height: int) -> None:
        raise NotImplementedError

    def draw(self, frame: int) -> None:
        raise NotImplementedError


def instances(scene: Any) -> list[tuple[int, np.ndarray, np.ndarray, int]]:
    """Mesh, pose, colour and label of each."""
    parts = (scene["mesh"], scene["pose"], scene["color"], scene["label"])
    return [(int(m), X, c, int(n)) for m, X, c, n in zip(*parts, strict=True)]


class ModernGl(Peer):
    """One pass into three targets: colour, depth in metres, label."""

    VERTEX = """
    #version 330
    uniform mat4 clip_from_camera; uniform mat4 camera_from_mesh; uniform mat3 normal_from_mesh;
    in vec3 position; in vec3 normal; in vec2 uv; out vec3 n; out float z; out vec2 t;
    void main() {
        vec4 p = camera_from_mesh * vec4(position, 1.0);
        n = normal_from_mesh * normal; z = p.z; t = uv; gl_Position = clip_from_camera * p;
    }"""
    FRAGMENT = """
    #version 330
    uniform vec3 base; uniform uint label; uniform sampler2D image; in vec3 n; in float z; in vec2 t;
    layout(location = 0) out vec4 color; layout(location = 1) out float depth; layout(location = 2) out uint name;
    void main() { color = vec4(base * BASE * max(-normalize(n).z, 0.0), 1.0); depth = z; name = label; }"""

    def __init__(self) -> None:
        import moderngl

        settings: dict[str, Any] = {"backend": "egl"}
        self.context: Any = moderngl.create_standalone_context(**settings)
        self.flags = moderngl.DEPTH_TEST | moderngl.CULL_FACE

    def load(self, scene: Any, width: int, height: int) -> None:
        context = self.context
        textured = "texture" in scene
        base = "texture(image, t).rgb" if textured else "vec3(1.0)"
        program = self.program = context.program(self.VERTEX, self.FRAGMENT.replace("BASE", base))
        self.targets = [
            context.texture((width, height), 3),
            context.texture((width, height), 1, dtype="f4"),
            context.texture((width, height), 1, dtype="u4"),
        ]
        self.buffer = context.framebuffer(self.targets, context.depth_renderbuffer((width, height)))
        if textured:
            self.image = context.texture(scene["texture"].shape[1::-1], 4, scene["texture"].tobytes())
            self.image.filter = 0x2601, 0x2601  # GL_LINEAR
            if scene["mipmaps"]:
                self.image.build_mipmaps()
                self.image.filter = 0x2703, 0x2601  # GL_LINEAR_MIPMAP_LINEAR, GL_LINEAR
            self.image.use(0)
        meshes = []
        for k in range(int(scene["meshes"])):
            rows = [scene[f"positions{k}"], scene[f"normals{k}"]] + ([scene[f"uv{k}"]] if textured else [])
            names = ["position", "normal"] + (["uv"] if textured else [])
            layout = "3f 3f 2f" if textured else "3f 3f"
            vertices = context.buffer(np.concatenate(rows, axis=1).astype(np.float32).tobytes())
            elements = context.buffer(scene[f"elements{k}"].tobytes())
            meshes.append(context.vertex_array(program, [(vertices, layout, *names)], elements))
        self.draws = [(meshes[m], X, tuple(c), n) for m, X, c, n in instances(scene)]
        self.pictures = [
            np.empty((height, width, 3), np.uint8),
            np.empty((height, width), np.float32),
            np.empty((height, width), np.uint32),
        ]
        f = 0.9 * width
        clip = np.zeros((4, 4))
        clip[0, 0], clip[1, 1] = 2 * f / width, 2 * f / height
        clip[2] = 0, 0, (FAR + NEAR) / (FAR - NEAR), -2 * FAR * NEAR / (FAR - NEAR)
        clip[3, 2] = 1
        program["clip_from_camera"].write(clip.T.astype(np.float32).tobytes())
        # The optical frame has +Y down and so has row 0 of what is read back: fronts run as they are.
        context.front_face = "cw"

    def draw(self, frame: int) -> None:
        self.buffer.use()
        self.buffer.clear(*BACKGROUND, depth=1.0)
        self.context.enable_only(self.flags)
        for mesh, pose, color, label in self.draws:
            X = pose.copy()
            X[:3, 3] -= camera(frame)
            self.program["camera_from_mesh"].write(X.T.astype(np.float32).tobytes())
            self.program["normal_from_mesh"].write(np.linalg.inv(X[:3, :3]).astype(np.float32).tobytes())
            self.program["base"] = color
            self.program["label"] = label
            mesh.render()
        self._read()

    def _read(self) -> None:
        for texture, picture in zip(self.targets, self.pictures, strict=True):
            texture.read_into(picture, alignment=1)


class ModernGl4(ModernGl):
    """Colour only, 4 samples a pixel, resolved and read back."""

    def load(self, scene: Any, width: int, height: int) -> None:
        super().load(scene, width, height)
        size, context = (width, height), self.context
        del self.targets[1:], self.pictures[1:]
        self.single = context.framebuffer(self.targets)
        self.buffer = context.framebuffer(
            [context.renderbuffer(size, 3, samples=4)], context.depth_renderbuffer(size, samples=4)
        )

    def _read(self) -> None:
        self.context.copy_framebuffer(self.single, self.buffer)
        super()._read()


class Vtk(Peer):
    """One off-screen window: a lit pass with its depth buffer, then a flat pass of label colours."""

    SAMPLES = 0
    PBR = False

    def __init__(self) -> None:
        import vtk
        from vtk.util import numpy_support

        self.vtk: Any = vtk
        self.support: Any = numpy_support
        self.window = vtk.vtkRenderWindow()
        self.window.SetOffScreenRendering(1)
        self.window.SetMultiSamples(self.SAMPLES)
        self.renderer: Any = None

    def load(self, scene: Any, width: int, height: int) -> None:
        vtk, to_vtk = self.vtk, self.support.numpy_to_vtk
        if self.renderer is not None:
            self.window.RemoveRenderer(self.renderer)
        self.renderer = vtk.vtkRenderer()
        self.renderer.SetBackground(BACKGROUND)
        self.window.SetSize(width, height)
        self.window.AddRenderer(self.renderer)
        self.renderer.AutomaticLightCreationOff()
        light = vtk.vtkLight()
        light.SetLightTypeToHeadlight()
        self.renderer.AddLight(light)
        mappers = []
        for k in range(int(scene["meshes"])):
            data, points, cells = vtk.vtkPolyData(), vtk.vtkPoints(), vtk.vtkCellArray()
            points.SetData(to_vtk(scene[f"positions{k}"], deep=1))
            elements = scene[f"elements{k}"].astype(np.int64)
            offsets = np.arange(0, 3 * len(elements) + 1, 3)
            cells.SetData(
                self.support.numpy_to_vtkIdTypeArray(offsets, deep=1),
                self.support.numpy_to_vtkIdTypeArray(elements.ravel(), deep=1),
            )
            data.SetPoints(points)
            data.SetPolys(cells)
            data.GetPointData().SetNormals(to_vtk(scene[f"normals{k}"], deep=1))
            if "texture" in scene:
                data.GetPointData().SetTCoords(to_vtk(scene[f"uv{k}"], deep=1))
            mapper = vtk.vtkPolyDataMapper()
            mapper.SetInputData(data)
            mapper.SetStatic(1)
            mappers.append(mapper)
        self.actors = []
        for m, X, color, label in instances(scene):
            actor = vtk.vtkActor()
            actor.SetMapper(mappers[m])
            matrix = vtk.vtkMatrix4x4()
            matrix.DeepCopy(X.ravel())
            actor.SetUserMatrix(matrix)
            p = actor.GetProperty()
            if self.PBR:
                p.SetInterpolationToPBR()
                p.SetMetallic(0.0)
                p.SetRoughness(0.5)
            else:
                p.SetInterpolationToPhong()
                p.SetAmbient(0.0)
                p.SetDiffuse(1.0)
                p.SetSpecular(0.0)
            p.BackfaceCullingOn()
            texture = None
            if "texture" in scene:
                image = vtk.vtkImageData()
                pixels = np.ascontiguousarray(scene["texture"][..., :3])
                image.SetDimensions(pixels.shape[1], pixels.shape[0], 1)
                image.GetPointData().SetScalars(to_vtk(pixels.reshape(-1, 3), deep=1))
                texture = vtk.vtkTexture()
                texture.SetInputData(image)
                texture.InterpolateOn()
                texture.SetMipmap(bool(scene["mipmaps"]))
            self.renderer.AddActor(actor)
            self.actors.append((actor, texture, tuple(color), tuple((label >> s & 255) / 255 for s in (0, 8, 16))))
        self.size = width, height
        view = self.renderer.GetActiveCamera()
        view.SetViewAngle(2 * math.degrees(math.atan(height / (2 * 0.9 * width))))
        view.SetClippingRange(NEAR, FAR)
        view.SetViewUp(0, -1, 0)
        self.depth = vtk.vtkFloatArray()
        self.colors = vtk.vtkUnsignedCharArray()
        self.labels = vtk.vtkUnsignedCharArray()

    def look(self, frame: int) -> tuple[int, int]:
        """Moves the camera; the last column and row."""
        eye = camera(frame)
        view = self.renderer.GetActiveCamera()
        view.SetPosition(*eye)
        view.SetFocalPoint(eye[0], eye[1], eye[2] + 1)
        return self.size[0] - 1, self.size[1] - 1

    def draw(self, frame: int) -> None:
        right, top = self.look(frame)
        for lit, out in ((True, self.colors), (False, self.labels)):
            for actor, texture, color, name in self.actors:
                actor.GetProperty().SetColor(*(color if lit else name))
                actor.GetProperty().SetLighting(lit)
                actor.SetTexture(texture if lit else None)
            self.renderer.SetBackground(BACKGROUND if lit else (1.0, 1.0, 1.0))
            self.window.Render()
            self.window.GetPixelData(0, 0, right, top, 0, out, 0)
            if lit:
                self.window.GetZbufferData(0, 0, right, top, self.depth)
        z = self.support.vtk_to_numpy(self.depth)
        np.divide(NEAR * FAR, FAR - z * (FAR - NEAR), dtype=np.float32)  # metres


class VtkPbr(Vtk):
    """Colour only, physically based shading."""

    PBR = True

    def load(self, scene: Any, width: int, height: int) -> None:
        super().load(scene, width, height)
        for actor, texture, color, _ in self.actors:
            actor.GetProperty().SetColor(*color)
            actor.SetTexture(texture)

    def draw(self, frame: int) -> None:
        right, top = self.look(frame)
        self.window.Render()
        self.window.GetPixelData(0, 0, right, top, 0, self.colors, 0)


class Vtk8(VtkPbr):
    """Colour only, 8 samples a pixel."""

    SAMPLES = 8
    PBR = False


class Panda(Peer):
    """panda3d's software renderer, colour only, lit at the vertices."""

    def __init__(self) -> None:
        import panda3d.core as core

        core.loadPrcFileData("", "load-display p3tinydisplay\nwindow-type offscreen\naudio-library-name null\n")
        core.loadPrcFileData("", "textures-power-2 none\nsync-video 0\nframebuffer-srgb 0\n")
        from direct.showbase.ShowBase import ShowBase

        self.core: Any = core
        self.base: Any = ShowBase(windowType="none")

    def load(self, scene: Any, width: int, height: int) -> None:
        core, base = self.core, self.base
        pipe = core.GraphicsPipeSelection.get_global_ptr().make_default_pipe()
        wanted = core.FrameBufferProperties()
        wanted.set_rgb_color(True)
        wanted.set_depth_bits(24)
        base.graphicsEngine.remove_all_windows()
        size = core.WindowProperties(size=(width, height))
        window = base.graphicsEngine.make_output(pipe, "peer", 0, wanted, size, core.GraphicsPipe.BF_refuse_window)
        self.texture = core.Texture()
        window.add_render_texture(self.texture, core.GraphicsOutput.RTM_copy_ram)
        window.set_clear_color(core.LVecBase4f(*BACKGROUND, 1))
        root = core.NodePath("root")
        lens = core.PerspectiveLens()
        lens.set_film_size(width, height)
        lens.set_focal_length(0.9 * width)
        lens.set_near_far(NEAR, FAR)
        self.eye = root.attach_new_node(core.Camera("eye", lens))
        window.make_display_region().set_camera(self.eye)
        light = core.DirectionalLight("head")
        light.set_direction((0, 0, 1))
        root.set_light(root.attach_new_node(light))
        meshes = []
        textured = "texture" in scene
        for k in range(int(scene["meshes"])):
            kind = core.GeomVertexFormat.get_v3n3t2() if textured else core.GeomVertexFormat.get_v3n3()
            data = core.GeomVertexData("mesh", kind, core.Geom.UH_static)
            rows = [scene[f"positions{k}"], scene[f"normals{k}"]] + ([scene[f"uv{k}"]] if textured else [])
            vertices = np.ascontiguousarray(np.concatenate(rows, axis=1), np.float32)
            data.unclean_set_num_rows(len(vertices))
            memoryview(data.modify_array(0)).cast("B").cast("f")[:] = vertices.ravel().data
            triangles = core.GeomTriangles(core.Geom.UH_static)
            triangles.set_index_type(core.Geom.NT_uint32)
            elements = np.ascontiguousarray(scene[f"elements{k}"], np.uint32).ravel()
            array = triangles.modify_vertices()
            array.unclean_set_num_rows(len(elements))
            memoryview(array).cast("B").cast("I")[:] = elements.data
            geometry = core.Geom(data)
            geometry.add_primitive(triangles)
            node = core.GeomNode("mesh")
            node.add_geom(geometry)
            meshes.append(node)
        for m, X, color, _ in instances(scene):
            path = root.attach_new_node("place")
            path.attach_new_node(meshes[m])
            path.set_mat(core.LMatrix4f(*X.T.ravel().tolist()))
            material = core.Material()
            material.set_diffuse((*color, 1))
            material.set_ambient((0, 0, 0, 1))
            path.set_material(material)
            if textured:
                image = core.Texture()
                pixels = np.ascontiguousarray(scene["texture"][..., (2, 1, 0)])
                image.setup_2d_texture(
                    pixels.shape[1], pixels.shape[0], core.Texture.T_unsigned_byte, core.Texture.F_rgb
                )
                image.set_ram_image(pixels.tobytes())
                path.set_texture(image)
        self.root = root

    def draw(self, frame: int) -> None:
        core = self.core
        eye = core.LPoint3(*camera(frame))
        self.eye.set_pos(eye)
        self.eye.look_at(eye + core.LVector3(0, 0, 1), core.LVector3(0, -1, 0))
        self.base.graphicsEngine.render_frame()
        np.frombuffer(memoryview(self.texture.get_ram_image()), np.uint8)


PEERS = {"moderngl": ModernGl, "moderngl-4": ModernGl4, "vtk": Vtk, "vtk-8": Vtk8, "vtk-pbr": VtkPbr, "panda3d": Panda}


def main() -> None:
    peer = PEERS[sys.argv[1]]()
    answer = os.fdopen(os.dup(1), "w", buffering=1)
    os.dup2(2, 1)  # what a library prints is no answer
    print("ready", file=answer)
    for line in sys.stdin:
        command, *arguments = line.split()
        wall, cpu = time.perf_counter(), time.process_time()
        if command == "load":
            peer.load(np.load(arguments[0]), int(arguments[1]), int(arguments[2]))
        else:
            peer.draw(int(arguments[0]))
        print(1e3 * (time.perf_counter() - wall), 1e3 * (time.process_time() - cpu), file=answer)


if __name__ == "__main__":
    main()
