"""COLLADA meshes rewritten for meshcat, whose viewer loses meshes of more than one material."""

from __future__ import annotations

import copy
import xml.etree.ElementTree as ElementTree

_NAMESPACE = "http://www.collada.org/2005/11/COLLADASchema"
_LARGEST = 8_000_000  # characters of one geometry with its copies: the page shall stay light
_PRIMITIVES = ("triangles", "polylist", "polygons", "tristrips", "trifans", "lines", "linestrips")


def one_material_each(text: str) -> str:
    """Returns a COLLADA file in which every geometry has one material.

    meshcat merges all meshes of a file into one with a list of materials, in which a mesh that
    has a list of its own is lost. Very large geometries stay as they are.

    Args:
        text: The file's text; what is no COLLADA comes back as it is.
    """
    try:
        root = ElementTree.fromstring(text)
    except ElementTree.ParseError:
        return text
    parts: dict[str, list[str]] = {}
    for library in root.iter(_tag("library_geometries")):
        for geometry in list(library):
            mesh = geometry.find(_tag("mesh"))
            if mesh is None:
                continue
            groups = [child for child in mesh if child.tag in map(_tag, _PRIMITIVES)]
            if len(groups) < 2 or len(groups) * len(ElementTree.tostring(geometry)) > _LARGEST:
                continue
            name = geometry.get("id", "")
            for kept in range(1, len(groups)):
                twin = copy.deepcopy(geometry)
                twin.set("id", f"{name}-part{kept}")
                _keep(twin, kept)
                library.append(twin)
                parts.setdefault(name, []).append(f"{name}-part{kept}")
            _keep(geometry, 0)
    if not parts:
        return text
    for node in root.iter(_tag("node")):
        for instance in node.findall(_tag("instance_geometry")):
            for part in parts.get(instance.get("url", "").removeprefix("#"), []):
                twin = copy.deepcopy(instance)
                twin.set("url", f"#{part}")
                node.append(twin)
    ElementTree.register_namespace("", _NAMESPACE)
    return ElementTree.tostring(root, encoding="unicode")


def _keep(geometry: ElementTree.Element, kept: int) -> None:
    """Removes all groups of faces but one."""
    mesh = geometry.find(_tag("mesh"))
    assert mesh is not None
    groups = [child for child in mesh if child.tag in map(_tag, _PRIMITIVES)]
    for index, group in enumerate(groups):
        if index != kept:
            mesh.remove(group)


def _tag(name: str) -> str:
    return f"{{{_NAMESPACE}}}{name}"
