"""COLLADA files with what pycollada leaves to its callers, or passes over."""

import numpy as np
import pytest
from numpy.typing import NDArray

from gateway.files.parsers import collada
from gateway.files.parsers.mesh import read_mesh
from gateway.files.parsers.mesh_data import MeshData, Shape
from scenegate.transforms import origin_amid
from tests.files.assets.mesh_files.files import DAE, png, source
from tests.files.parsers.test_mesh import LIMITS

TRIANGLES = DAE[DAE.index("<triangles") : DAE.index("</mesh>")]
INPUT = '<input semantic="VERTEX" source="#v" offset="0"/>'
COLORS = source("c", "1 0 0.2", "RGB")
COLORED = (
    f'<triangles material="s" count="1">{INPUT}<input semantic="COLOR" source="#c" offset="1"/>'
    "<p>0 0 1 0 2 0</p></triangles>"
)


def document(primitives: str, *, sources: str = "", shader: str = "", library: str = "", binding: str = "") -> str:
    """Return a document with these primitives, a material of this shader that is bound to the symbol ``s``."""
    data = DAE.format(asset="<up_axis>Z_UP</up_axis>").replace(TRIANGLES, primitives)
    data = data.replace('<vertices id="v">', f'{sources}<vertices id="v">')
    if not shader:
        return data
    effect = (
        f'<effect id="e"><profile_COMMON>{library}<technique sid="c">{shader}</technique></profile_COMMON></effect>'
    )
    bound = (
        '<instance_geometry url="#g"><bind_material><technique_common><instance_material symbol="s" target="#m">'
        f"{binding}</instance_material></technique_common></bind_material></instance_geometry>"
    )
    image = '<library_images><image id="i"><init_from> {} </init_from></image></library_images>'
    materials = '<library_materials><material id="m"><instance_effect url="#e"/></material></library_materials>'
    return data.replace('<instance_geometry url="#g"/>', bound).replace(
        "<library_geometries>", f"{image}<library_effects>{effect}</library_effects>{materials}<library_geometries>"
    )


PAINTED = TRIANGLES.replace("<triangles", '<triangles material="s"')


def read(data: str) -> tuple[Shape, MeshData]:
    """Return the only shape, and the content; every file is a white PNG image."""
    result = read_mesh(lambda _: png((255, 255, 255)), data.encode(), "dae", LIMITS)
    assert isinstance(result, MeshData), result
    (shape,) = result.shapes
    return shape, result


def test_lines_beside_triangles() -> None:
    shape, content = read(document(f'<linestrips count="1">{INPUT}<p>0 1 2</p></linestrips>{TRIANGLES}'))
    assert len(shape.triangles or b"") == 12
    assert content.warnings == []


def test_holes_of_polygons_are_cut_out() -> None:
    square, hole = ((0, 0), (3, 0), (3, 3), (0, 3)), ((1, 1), (1, 2), (2, 2), (2, 1))
    corners = " ".join(f"5 {y} {z}" for y, z in (*square, *hole))
    polygons = "<p>4 5 6 7</p><ph><p>0 1 2 3</p><h>4 5 6 7</h></ph><ph><p>0 1 2 3</p></ph>"
    data = document(f'<polygons count="3">{INPUT}{polygons}</polygons>')
    data = data.replace('count="9">0 0 0 1 0 0 0 2 0', f'count="24">{corners}').replace(
        'count="3" stride', 'count="8" stride'
    )
    shape, content = read(data)
    a, b, c = np.frombuffer(shape.positions, np.float32).reshape(-1, 3, 3).swapaxes(0, 1)
    areas = np.cross(b - a, c - a)[:, 0] / 2
    assert areas.sum() == pytest.approx(9 - 1 + 9 - 1)
    assert (areas < 0).sum() == 2
    assert content.warnings == []


@pytest.mark.parametrize(
    ("array", "accessor"),
    [
        ("7 7 0 0 0 1 0 0 0 2 0", 'source="#pa" offset="2" count="3" stride="3"'),
        ("0 0 0 9 1 0 0 9 0 2 0 9", 'source="#pa" count="3" stride="4"'),
        ("0 0 0 9 1 0 0 9 0 2 0", 'source="#pa" count="3" stride="4"'),
        ("8 8", 'source="#shared" offset="1" count="3" stride="5"'),
        (None, 'source="#shared" offset="1" count="3" stride="5"'),
    ],
    ids=["offset", "stride", "cut off", "another array", "no array"],
)
def test_sources_that_select_values_of_an_array(array: str | None, accessor: str) -> None:
    data = document(
        TRIANGLES, sources=source("shared", "5 0 0 0 1 1 1 0 0 1 1 0 2 0", "N").replace("shareda", "shared")
    )
    own = "" if array is None else f'<float_array id="pa" count="9">{array}</float_array>'
    data = data.replace('<float_array id="pa" count="9">0 0 0 1 0 0 0 2 0</float_array>', own)
    data = data.replace('source="#pa" count="3" stride="3"', accessor)
    shape, content = read(data)
    assert np.frombuffer(shape.positions, np.float32).reshape(3, 3).tolist() == [[0, 0, 0], [1, 0, 0], [0, 2, 0]]
    assert content.warnings == []


def test_a_component_without_a_name_is_skipped() -> None:
    data = document(TRIANGLES).replace("0 0 0 1 0 0 0 2 0", "9 0 0 0 9 1 0 0 9 0 2 0")
    data = data.replace('stride="3"><param', 'stride="4"><param type="float"/><param')
    assert np.frombuffer(read(data)[0].positions, np.float32).tolist() == [0, 0, 0, 1, 0, 0, 0, 2, 0]


def test_a_document_with_one_scene_that_it_does_not_name() -> None:
    assert read(document(TRIANGLES).replace('<scene><instance_visual_scene url="#s"/></scene>', ""))


@pytest.mark.parametrize(("name", "u"), [("first", 0.25), ("second", 0.75), ("unbound", 0.25)])
@pytest.mark.parametrize("url", ["t.png", "file:///t.png", "file://t.png"])
def test_bind_vertex_input_names_the_texture_coordinates(name: str, u: float, url: str) -> None:
    sets = '<input semantic="TEXCOORD" source="#t{}" offset="1" set="{}"/>'
    triangles = (
        f'<triangles material="s" count="1">{INPUT}{sets.format(0, 3)}{sets.format(1, 4)}<p>0 0 1 0 2 0</p></triangles>'
    )
    library = (
        '<newparam sid="f"><surface type="2D"><init_from>i</init_from></surface></newparam>'
        '<newparam sid="a"><sampler2D><source>f</source></sampler2D></newparam>'
    )
    bind = '<bind_vertex_input semantic="{}" input_semantic="TEXCOORD" input_set="{}"/>'
    data = document(
        triangles,
        sources=source("t0", "0.25 0", "ST") + source("t1", "0.75 0", "ST"),
        shader=f'<phong><diffuse><texture texture="a" texcoord="{name}"/></diffuse></phong>',
        library=library,
        binding=bind.format("first", 3) + bind.format("second", 4),
    )
    shape, content = read(data.replace(" {} ", url))
    assert (shape.image, content.images[0][0]) == (0, url.removeprefix("file://"))
    assert np.frombuffer(shape.uv or b"", np.float32)[0] == u


@pytest.mark.parametrize(
    ("shader", "is_colored"),
    [
        ("<phong><diffuse><color>1 1 1 1</color></diffuse></phong>", True),
        ("<phong><specular><color>1 1 1 1</color></specular></phong>", True),
        ("<phong><diffuse><color>0 0 1 1</color></diffuse></phong>", False),
    ],
)
def test_colours_of_vertices_beside_a_white_effect(shader: str, is_colored: bool) -> None:
    shape, _ = read(document(COLORED, sources=COLORS, shader=shader))
    assert (shape.colors is not None) == is_colored
    if shape.colors is not None:
        assert np.frombuffer(shape.colors, np.uint8)[:4].tolist() == [255, 0, 51, 255]


@pytest.mark.parametrize(
    ("shader", "color"),
    [
        ("<constant><emission><color>0 1 0 1</color></emission></constant>", (0.0, 0.0, 0.0, 1.0)),
        (
            "<lambert><emission><color>0 1 0 1</color></emission><diffuse><color>1 0 0 1</color></diffuse></lambert>",
            (1.0, 0.0, 0.0, 1.0),
        ),
    ],
)
def test_emission(shader: str, color: tuple[float, ...]) -> None:
    shape, _ = read(document(PAINTED, shader=shader))
    assert (shape.color, shape.emission) == (color, (0.0, 1.0, 0.0))


@pytest.mark.parametrize("image", ["", '<image id="i"><init_from/></image>'])
def test_a_mesh_with_a_broken_material_is_drawn(image: str) -> None:
    texture = '<phong><diffuse><texture texture="i" texcoord="t"/></diffuse></phong>'
    data = document(PAINTED, shader=texture)
    assert read(data.replace('<image id="i"><init_from> {} </init_from></image>', image))


@pytest.mark.parametrize(
    ("sampler", "texture", "version"),
    [("<source>lost</source>", "i", "1.4"), ('<instance_image url="#i"/>', "a", "1.5")],
)
def test_textures_of_samplers_without_a_surface(sampler: str, texture: str, version: str) -> None:
    """ANYmal's foot names a surface that it does not have. COLLADA 1.5 has none, and ``<ref>`` in images."""
    library = f'<newparam sid="a"><sampler2D>{sampler}</sampler2D></newparam>'
    shader = f'<phong><diffuse><texture texture="{texture}" texcoord="t"/></diffuse></phong>'
    uv = '<input semantic="TEXCOORD" source="#t" offset="0"/>'
    triangles = f'<triangles material="s" count="1">{INPUT}{uv}<p>0 1 2</p></triangles>'
    data = document(triangles, sources=source("t", "0 0 1 0 1 1", "ST"), shader=shader, library=library)
    data = data.replace("{}", "<ref>t.png</ref>" if version == "1.5" else "t.png")
    shape, content = read(data)
    assert shape.image == 0
    assert [name for name, _ in content.images] == ["t.png"]
    assert content.warnings == []


@pytest.mark.parametrize("before", ["", "<!-- exported -->", "<asset/>"])
def test_a_texture_whose_parameters_are_in_the_effect(before: str) -> None:
    library = (
        '<image id="j"><init_from>t.png</init_from></image>'
        '<newparam sid="f"><surface type="2D"><init_from>j</init_from></surface></newparam>'
        '<newparam sid="a"><sampler2D><source>f</source></sampler2D></newparam>'
    )
    uv = '<input semantic="TEXCOORD" source="#t" offset="0"/>'
    triangles = f'<triangles material="s" count="1">{INPUT}{uv}<p>0 1 2</p></triangles>'
    shader = '<phong><diffuse><texture texture="a" texcoord="t"/></diffuse></phong>'
    data = document(triangles, sources=source("t", "0 0 1 0 1 1", "ST"), shader=shader)
    shape, content = read(data.replace('<effect id="e">', f'<effect id="e">{before}{library}'))
    assert shape.image == 0
    assert content.warnings == []


@pytest.mark.parametrize("numbers", ["1 2 3 9 2 3 4 0 7", "1,0 2,0 3,0 9,0 2,0 3,0 4,0 0,0 7,0"])
def test_a_node_that_looks_at_a_point(numbers: str) -> None:
    """From (1, 2, 3) towards +x: -z of the node is +x, its x is -y, and its y is z."""
    data = document(TRIANGLES).replace("<translate>0 0 5</translate>", f"<lookat>{numbers}</lookat>")
    _, content = read(data)
    ((_, X),) = content.instances
    pose = np.frombuffer(X).reshape(4, 4)
    assert pose == pytest.approx(np.array([(0, 0, -1, 1), (-1, 0, 0, 2), (0, 1, 0, 3), (0, 0, 0, 1)]))


def test_a_material_that_is_bound_to_another_symbol() -> None:
    """As Aspose.3D writes it; Assimp does the same."""
    shader = "<lambert><diffuse><color>0 1 0 1</color></diffuse></lambert>"
    shape, _ = read(document(PAINTED.replace('material="s"', 'material="default"'), shader=shader))
    assert shape.color == (0, 1, 0, 1)


def test_decimal_commas() -> None:
    """As 3ds Max writes them on German computers: also in the unit, and where numbers have no fractions."""
    shader = "<lambert><diffuse><color>0 0.5 1 1</color></diffuse></lambert>"
    data = document(PAINTED, shader=shader).replace("<up_axis>", '<unit meter="0.5"/><up_axis>')
    assert data.count("0.5") == 2
    with_commas = data.replace("0.5", "0,5").replace(">0 0 0 1 0 0 0 2 0<", ">0,0 0,0 0,0 1,0 0,0 0,0 0,0 2,0 0,0<")
    assert with_commas.count(",") == 11
    (shape, content), (expected_shape, expected) = read(with_commas), read(data)
    assert (shape, content) == (expected_shape, expected)
    assert shape.color == (0.0, 0.5, 1.0, 1.0)


def test_vertices_of_several_materials_are_read_once(monkeypatch: pytest.MonkeyPatch) -> None:
    """Those of a survey took 4 ms for each material and 200,000 vertices."""
    searched: list[int] = []

    def search(positions: NDArray[np.float64]) -> tuple[float, float, float]:
        searched.append(len(positions))
        return origin_amid(positions)

    monkeypatch.setattr(collada, "origin_amid", search)
    result = read_mesh(lambda _: b"", document(TRIANGLES * 3).encode(), "dae", LIMITS)
    assert isinstance(result, MeshData)
    assert (len(result.shapes), searched) == (3, [3])
