"""Transforms of a frame's instances into the camera's frame, and the list of draws."""

from renderers.compiler.device_function import device_function, inlined
from renderers.compiler.kernel_types import F64, I64, Pointer
from renderers.compiler.pointers import advance, u8_at
from renderers.raster.layout import GUARD_BAND, Draw, RasterFrame, RasterInstance
from renderers.shading.vec3 import cofactor, determinant


@device_function
def _is_unclipped_convex(frame: RasterFrame, m: Pointer[F64], instance: RasterInstance) -> bool:
    """Return whether a mesh is convex, and its box at the pose ``m`` beyond the near plane and in the guard band."""
    center, half = instance.box_center, instance.box_half_extents
    # Over the box, in the camera's frame: limits of |x| and |y|, and the least z.
    max_x, max_y, min_z = abs(m[3]), abs(m[7]), m[11]
    max_z_terms = abs(m[11])
    for axis in range(3):
        extent = abs(center[axis]) + half[axis]
        max_x += abs(m[axis]) * extent
        max_y += abs(m[4 + axis]) * extent
        min_z += m[8 + axis] * center[axis] - abs(m[8 + axis]) * half[axis]
        max_z_terms += abs(m[8 + axis]) * extent
    min_z -= 1e-9 * max_z_terms  # rounding
    limit = GUARD_BAND - 1.0  # a pixel for rounding
    return (
        half[0] >= 0.0
        and min_z > frame.near
        and frame.fx * max_x <= (limit - abs(frame.cx)) * min_z
        and frame.fy * max_y <= (limit - abs(frame.cy)) * min_z
    )


@device_function
def compute_camera_poses(frame: RasterFrame) -> None:
    """Fill ``X_camera_mesh`` from ``X_world_camera``, whose last row is taken as (0, 0, 0, 1), and ``X_world_mesh``."""
    c, world, out, count = frame.X_world_camera, frame.X_world_mesh, frame.X_camera_mesh, frame.instance_count
    scale = 1.0 / determinant(c)
    for row in range(3):
        # A row of the inverse of the camera's 3 x 3: cofactors of a column over the determinant.
        inverse_x, inverse_y, inverse_z = (
            cofactor(c, 0, row) * scale,
            cofactor(c, 1, row) * scale,
            cofactor(c, 2, row) * scale,
        )
        for k in range(count):
            first = 16 * k  # of a matrix, (4, 4)
            for column in range(4):
                bottom = world[first + 12 + column]
                x = world[first + column] - c[3] * bottom
                y = world[first + 4 + column] - c[7] * bottom
                z = world[first + 8 + column] - c[11] * bottom
                out[first + 4 * row + column] = inverse_x * x + inverse_y * y + inverse_z * z
    for k in range(count):
        for column in range(12, 16):
            out[16 * k + column] = world[16 * k + column]


@inlined
def _back_sign(m: Pointer[F64]) -> I64:
    """Return the sign, +1 or -1, of the area on screen of back faces at the pose ``m``."""
    return -1 if determinant(m) < 0.0 else 1


@device_function
def _set_signs(frame: RasterFrame, k: I64, draw: Draw) -> None:
    """Set ``culled_area_sign`` and ``hidden_area_sign`` of the Draw of instance ``k``."""
    m, cull_back = advance(frame.X_camera_mesh, 16 * k), u8_at(frame.cull_back)
    draw.culled_area_sign = draw.hidden_area_sign = 0
    if frame.cull_back != 0 and cull_back[k] != 0:
        draw.culled_area_sign = _back_sign(m)
    is_convex = frame.skip_hidden_back_faces != 0 and _is_unclipped_convex(frame, m, frame.instances[k])
    if is_convex and determinant(m) != 0.0:
        draw.hidden_area_sign = _back_sign(m)


@device_function
def collect_draws(frame: RasterFrame) -> I64:
    """Fill ``draws`` and the counts of draws, vertices and primitives from the selected instances.

    Return the number of draws whose back faces are culled, without those whose back faces are hidden anyway.
    """
    is_selected = u8_at(frame.is_selected)
    culling_draws = draw_count = vertices = primitives = 0
    for k in range(frame.instance_count):
        if frame.is_selected != 0 and is_selected[k] == 0:
            continue
        instance, next_instance, draw = frame.instances[k], frame.instances[k + 1], frame.draws[draw_count]
        for value in range(12):
            draw.X_camera_mesh[value] = frame.X_camera_mesh[16 * k + value]
        _set_signs(frame, k, draw)
        culling_draws += draw.culled_area_sign != 0 and draw.hidden_area_sign == 0
        draw.first_vertex, draw.first_frame_primitive = vertices, primitives
        draw.positions, draw.indices = instance.positions, instance.indices
        draw.vertices_per_primitive = instance.vertices_per_primitive
        draw.point_or_line_size, draw.first_id = instance.point_or_line_size, instance.first_id
        vertices += next_instance.first_vertex - instance.first_vertex
        primitives += next_instance.first_id - instance.first_id
        draw_count += 1
    total = frame.draws[draw_count]
    total.first_vertex, total.first_frame_primitive = vertices, primitives
    frame.vertex_count, frame.primitive_count, frame.draw_count = vertices, primitives, draw_count
    return culling_draws
