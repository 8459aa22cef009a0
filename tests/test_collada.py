"""Meshes of several materials reach the viewer whole."""

from __future__ import annotations

import xml.etree.ElementTree as ElementTree

from planner.collada import one_material_each

SPACE = "{http://www.collada.org/2005/11/COLLADASchema}"
MESH = (
    '<COLLADA xmlns="http://www.collada.org/2005/11/COLLADASchema"><library_geometries>'
    '<geometry id="arm"><mesh><source id="points"/>'
    '<triangles material="grey" count="1"><p>0 1 2</p></triangles>'
    '<triangles material="blue" count="1"><p>2 3 0</p></triangles></mesh></geometry>'
    "</library_geometries><library_visual_scenes><visual_scene><node>"
    '<instance_geometry url="#arm"/></node></visual_scene></library_visual_scenes></COLLADA>'
)


def test_every_material_gets_a_geometry_and_none_is_lost() -> None:
    root = ElementTree.fromstring(one_material_each(MESH))
    geometries = {g.get("id"): g for g in root.iter(f"{SPACE}geometry")}
    found = {}
    for name, geometry in geometries.items():
        (triangles,) = geometry.iter(f"{SPACE}triangles")
        found[triangles.get("material")] = triangles.find(f"{SPACE}p").text
        assert len(list(geometry.iter(f"{SPACE}source"))) == 1, name
    assert found == {"grey": "0 1 2", "blue": "2 3 0"}
    shown = {i.get("url") for i in root.iter(f"{SPACE}instance_geometry")}
    assert shown == {f"#{name}" for name in geometries}


def test_what_needs_no_change_stays() -> None:
    single = MESH.replace('<triangles material="blue" count="1"><p>2 3 0</p></triangles>', "")
    assert one_material_each(single) == single
    assert one_material_each("solid of another kind") == "solid of another kind"
