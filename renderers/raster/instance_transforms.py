"""Where a frame's instances are."""

from __future__ import annotations

from renderers.compiler.device_function import inner
from renderers.compiler.pointers import f64_at, i64_at, u8_at
from renderers.raster.layout import (
    B_COLUMNS,
    B_HALF,
    B_MIDDLE,
    GUARD,
    J_ELEMENTS,
    J_INSTANCES,
    J_LENGTHS,
    J_LENS,
    J_TABLE,
    J_VERTICES,
    L_CX,
    L_CY,
    L_FX,
    L_FY,
    L_NEAR,
    M_COLUMNS,
    M_SIZE,
    T_CLUSTERS,
    T_COLUMNS,
    T_CULL,
    T_ELEMENT,
    T_ELEMENTS,
    T_HIDDEN,
    T_POSITIONS,
    T_RECORD,
    T_TOPOLOGY,
    T_VERTEX,
)


@inner
def _outside(m, box, lens):
    """Whether all of a box lies beyond the near plane and within the guard band, so that nothing in it is clipped."""
    far_x, far_y, z = abs(m[3]), abs(m[7]), m[11]
    size = abs(m[11])
    for axis in range(3):
        middle, half = box[B_MIDDLE + axis], box[B_HALF + axis]
        far_x += abs(m[axis]) * (abs(middle) + half)
        far_y += abs(m[4 + axis]) * (abs(middle) + half)
        z += m[8 + axis] * middle - abs(m[8 + axis]) * half
        size += abs(m[8 + axis]) * (abs(middle) + half)
    z -= 1e-9 * size  # what rounding may add up to
    most = GUARD - 1.0
    return (
        box[B_HALF] >= 0.0
        and z > lens[L_NEAR]
        and lens[L_FX] * far_x <= (most - abs(lens[L_CX])) * z
        and lens[L_FY] * far_y <= (most - abs(lens[L_CY])) * z
    )


@inner
def _determinant(m):
    """Of the upper left 3 x 3 of a 4 x 4."""
    return (
        m[0] * (m[5] * m[10] - m[6] * m[9]) + m[1] * (m[6] * m[8] - m[4] * m[10]) + m[2] * (m[4] * m[9] - m[5] * m[8])
    )


@inner
def look_from(pose_at, points_at, meshes_at, count):
    """Poses in the world to poses in the camera's frame.

    Args:
        pose_at: address of (4, 4) float64, the camera's pose in the world.
        points_at: address of (count, 4, 4) float64, world from mesh.
        meshes_at: the same, camera from mesh, which are filled.

    Returns 0, and nothing is filled, where the camera's pose is not affine or has no inverse; else 1.
    """
    c, points, out = f64_at(pose_at), f64_at(points_at), f64_at(meshes_at)
    determinant = _determinant(c)
    if not (c[12] == 0.0 and c[13] == 0.0 and c[14] == 0.0 and c[15] == 1.0 and abs(determinant) > 0.0):
        return 0
    scale = 1.0 / determinant
    for row in range(3):
        # The inverse of the 3 x 3: cofactors over the determinant.
        p, q = (row + 1) % 3, (row + 2) % 3
        a = (c[4 + p] * c[8 + q] - c[4 + q] * c[8 + p]) * scale
        b = (c[8 + p] * c[q] - c[8 + q] * c[p]) * scale
        d = (c[p] * c[4 + q] - c[q] * c[4 + p]) * scale
        for k in range(count):
            m = 16 * k
            for column in range(4):
                last = points[m + 12 + column]
                x = points[m + column] - c[3] * last
                y = points[m + 4 + column] - c[7] * last
                z = points[m + 8 + column] - c[11] * last
                out[m + 4 * row + column] = a * x + b * y + d * z
    for k in range(count):
        for column in range(12, 16):
            out[16 * k + column] = points[16 * k + column]
    return 1


@inner
def place(job_at, known_at, meshes_at, sizes_at, bounds_at, select_at, cull_at, count):
    """Tables of the drawn instances, and how much there is to draw: J_VERTICES, J_ELEMENTS and J_INSTANCES.

    Args:
        job_at: address of the J_COLUMNS int64, of which J_TABLE, J_LENGTHS and J_LENS are set; the former two have room
            for all instances.
        known_at: address of (count + 1, T_COLUMNS) int64, the table of all instances.
        meshes_at: address of (count, 4, 4) float64, camera from mesh.
        sizes_at: address of (count,) float64.
        bounds_at: address of (count, B_COLUMNS) float64; 0: nothing may be said of what is hidden.
        select_at: address of (count,) bool, who is drawn; 0: everybody.
        cull_at: address of (count,) bool, whose back faces are culled; 0: nobody's.

    Returns how many have back faces that are culled and not hidden.
    """
    job = i64_at(job_at)
    table, lengths, lens = i64_at(job[J_TABLE]), f64_at(job[J_LENGTHS]), f64_at(job[J_LENS])
    known, points, sizes = i64_at(known_at), f64_at(meshes_at), f64_at(sizes_at)
    select, cull = u8_at(select_at), u8_at(cull_at)
    apart = drawn = vertices = elements = 0
    for k in range(count):
        if select_at != 0 and select[k] == 0:
            continue
        m, out, source, row = 16 * k, M_COLUMNS * drawn, T_COLUMNS * k, T_COLUMNS * drawn
        for value in range(M_SIZE):
            lengths[out + value] = points[m + value]
        lengths[out + M_SIZE] = sizes[k]
        side = hidden = 0
        culled = cull_at != 0 and cull[k] != 0
        solid = bounds_at != 0 and _outside(f64_at(meshes_at + 128 * k), f64_at(bounds_at + 8 * B_COLUMNS * k), lens)
        if culled or solid:
            # In the optical frame a triangle that faces the camera runs counter-clockwise for the viewer, which is a
            # negative area with y down; a mirrored map turns that round.
            determinant = _determinant(f64_at(meshes_at + 128 * k))
            side = -1 if determinant < 0.0 else 1
            hidden = side if solid and determinant != 0.0 else 0
            side = side if culled else 0
            apart += side != 0 and hidden == 0
        table[row + T_VERTEX] = vertices
        table[row + T_ELEMENT] = elements
        for column in (T_POSITIONS, T_ELEMENTS, T_TOPOLOGY, T_RECORD, T_CLUSTERS):
            table[row + column] = known[source + column]
        table[row + T_CULL] = side
        table[row + T_HIDDEN] = hidden
        vertices += known[source + T_COLUMNS + T_VERTEX] - known[source + T_VERTEX]
        elements += known[source + T_COLUMNS + T_ELEMENT] - known[source + T_ELEMENT]
        drawn += 1
    row = T_COLUMNS * drawn
    for column in range(T_COLUMNS):
        table[row + column] = 0
    table[row + T_VERTEX] = vertices
    table[row + T_ELEMENT] = elements
    job[J_VERTICES], job[J_ELEMENTS], job[J_INSTANCES] = vertices, elements, drawn
    return apart
