"""Pieces of a meshcat scene: shapes, path, arrows, floor, camera, and tracks of an animation.

Every moving body is one node of meshcat's tree: the node moves, and its shapes hang below it at
rest with their mesh scales. An animation then needs no more than positions and quaternions, and
mirrored meshes (negative scales) stay right.
"""

from __future__ import annotations

import math
import warnings
from pathlib import Path
from typing import Any

import numpy as np
import pinocchio as pin
from scipy.spatial.transform import Rotation

FRAMES_PER_SECOND = 60
FIELD_OF_VIEW = 30.0  # [deg], upright
PATH_COLOR, START_COLOR, GRID_COLOR = 0xCC79A7, 0x8A8F98, 0xBFC5CE


def draw_shapes(view: Any, shapes: pin.GeometryModel, nodes: dict[int, str]) -> None:
    """Hangs each shape below the node of the joint that carries it.

    Args:
        view: The visualizer, at the node above the joints'; its window is a `Recorder`.
        shapes: The shapes, placed in their joints' frames.
        nodes: The node of each joint.
    """
    from pinocchio.visualize import MeshcatVisualizer

    loader = MeshcatVisualizer(pin.Model(), None, shapes)
    loader.initViewer(viewer=view)
    for shape in shapes.geometryObjects:
        loader.viewerVisualGroupName = nodes[shape.parentJoint]
        node = view[f"{nodes[shape.parentJoint]}/{shape.name}"]
        count = len(view.window.commands)
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")  # a file that fails is drawn from its triangles instead
            loader.loadViewerGeometryObject(shape, pin.GeometryType.VISUAL)
        loaded = len(view.window.commands) > count
        if not loaded and not _draw_triangles(node, shape):
            warnings.warn(f"cannot draw {shape.name}: {shape.meshPath}", stacklevel=2)
            continue
        # triangles that Pinocchio read have their scale already, files have not
        from_file = loaded and Path(shape.meshPath).suffix.lower() in (".dae", ".obj", ".stl")
        scale = np.ravel(shape.meshScale) if from_file else np.ones(3)
        node.set_transform(shape.placement.homogeneous @ np.diag([*scale, 1.0]))


def outline(shape: pin.GeometryObject) -> np.ndarray:
    """Returns points (K, 3) [m] in the shape's own frame: its corners, or some of a mesh's."""
    if hasattr(shape.geometry, "tri_indices"):
        vertices = np.asarray(shape.geometry.vertices())
        return vertices[:: max(1, len(vertices) // 500)]
    shape.geometry.computeLocalAABB()
    box = (shape.geometry.aabb_local.min_, shape.geometry.aabb_local.max_)
    return np.array([[box[i][0], box[j][1], box[k][2]] for i, j, k in np.ndindex(2, 2, 2)])


def _draw_triangles(node: Any, shape: pin.GeometryObject) -> bool:
    """Draws the triangles that Pinocchio read; returns whether there were any."""
    import meshcat.geometry as g

    mesh = shape.geometry
    if not hasattr(mesh, "tri_indices") or mesh.num_tris == 0:
        return False
    faces = np.array([list(mesh.tri_indices(k)) for k in range(mesh.num_tris)])
    red, green, blue = (int(255 * part) for part in shape.meshColor[:3])
    material = g.MeshPhongMaterial(
        color=(red << 16) + (green << 8) + blue, opacity=float(shape.meshColor[3])
    )
    node.set_object(g.TriangularMeshGeometry(mesh.vertices(), faces), material)
    return True


def draw_ball(node: Any, radius: float, color: int, at: np.ndarray | None = None) -> None:
    """Draws a ball of a radius [m] and a color, at a position (3,) [m]."""
    import meshcat.geometry as g

    node.set_object(g.Sphere(radius), g.MeshPhongMaterial(color=color))
    if at is not None:
        node.set_transform(placement(position=at))


def draw_path(view: Any, points: np.ndarray, radius: float) -> None:
    """Draws a path (N, 3) [m] with its ends, as a tube: browsers draw lines one pixel wide."""
    import meshcat.geometry as g

    points = points[np.unique(np.linspace(0, len(points) - 1, 201).astype(int))]
    steps = np.linalg.norm(np.diff(points, axis=0), axis=1)
    points = points[np.concatenate([[True], steps > 1e-9])]
    draw_ball(view["start"], 2.6 * radius, START_COLOR, points[0])
    draw_ball(view["goal"], 2.6 * radius, PATH_COLOR, points[-1])
    if len(points) < 2:
        return
    along = np.gradient(points, axis=0)
    along /= np.maximum(np.linalg.norm(along, axis=1, keepdims=True), 1e-12)
    aside = np.eye(3)[np.argmin(np.abs(along[0]))]
    sides = np.empty_like(points)
    for row, tangent in enumerate(along):  # carried along the path, so the tube does not twist
        aside = aside - (aside @ tangent) * tangent
        aside = aside / np.linalg.norm(aside)
        sides[row] = aside
    turn = np.linspace(0.0, 2.0 * np.pi, 12, endpoint=False)[:, None, None]
    rings = points + radius * (np.cos(turn) * sides + np.sin(turn) * np.cross(along, sides))
    index = np.arange(rings.shape[0] * rings.shape[1]).reshape(rings.shape[:2])
    beside = np.roll(index, -1, axis=0)
    a, b, c, d = (
        part.ravel() for part in (index[:, :-1], index[:, 1:], beside[:, :-1], beside[:, 1:])
    )
    faces = np.concatenate([np.stack([a, b, c], axis=1), np.stack([b, d, c], axis=1)])
    tube = g.TriangularMeshGeometry(rings.reshape(-1, 3), faces)
    view["line"].set_object(tube, g.MeshBasicMaterial(color=PATH_COLOR))
    # once more, faintly, through whatever hides it: planar arms move in the plane of the path
    ghost = g.MeshBasicMaterial(color=PATH_COLOR, depthTest=False, opacity=0.35)
    view["hidden"].set_object(tube, ghost)


class Animation:
    """Keyed motion of nodes, in real time.

    Args:
        time: Times of the samples, (F,) [s], from 0.
        pause: How long the last sample stays [s].
    """

    def __init__(self, time: np.ndarray, pause: float) -> None:
        from meshcat.animation import Animation

        held = [time[-1] + pause] if pause > 0.0 else []
        self.frames = [float(frame) for frame in FRAMES_PER_SECOND * np.array([*time, *held])]
        self.animation = Animation(default_framerate=FRAMES_PER_SECOND)

    def move(self, node: Any, placements: np.ndarray) -> None:
        """Moves a node through placements (F, 4, 4) [m], in the frame of the node above."""
        node.set_transform(placements[0])
        quaternions = Rotation.from_matrix(placements[:, :3, :3]).as_quat()  # x, y, z, w
        flips = np.sum(quaternions[1:] * quaternions[:-1], axis=1) < 0.0
        quaternions[1:][np.cumsum(flips) % 2 == 1] *= -1.0  # q and -q are one turn: stay with one
        self._track(node, "position", "vector3", placements[:, :3, 3])
        self._track(node, "quaternion", "quaternion", quaternions)

    def arrow(
        self, node: Any, start: np.ndarray, vector: np.ndarray, radius: float, color: int
    ) -> None:
        """Draws and moves an arrow.

        Args:
            node: Where it hangs.
            start: Its foot, (F, 3) [m].
            vector: From foot to tip, (F, 3) [m].
            radius: Of its rod [m]; the head is larger.
            color: As 0xRRGGBB.
        """
        import meshcat.geometry as g

        # over everything else, since it starts inside the object and the hands
        material = g.MeshBasicMaterial(color=color, depthTest=False, transparent=True)
        upright = pin.utils.rotate("x", np.pi / 2.0)  # three.js stands its cylinders along y
        node["rod/rod"].set_object(g.Cylinder(1.0, radius), material)
        node["rod/rod"].set_transform(placement(upright, np.array([0.0, 0.0, 0.5])))
        node["head/head"].set_object(g.Cylinder(1.0, radiusTop=0.0, radiusBottom=0.4), material)
        node["head/head"].set_transform(placement(upright, np.array([0.0, 0.0, -0.5])))

        length = np.maximum(np.linalg.norm(vector, axis=1), 1e-6)
        head = np.minimum(7.0 * radius, length)
        rod = np.maximum(length - head, 1e-6)  # a scale of zero has no inverse
        feet = np.tile(np.eye(4), (len(start), 1, 1))
        feet[:, :3, :3], feet[:, :3, 3] = _turn_z_to(vector), start
        self.move(node, feet)
        one, zero = np.ones_like(rod), np.zeros_like(rod)
        self._track(node["rod"], "scale", "vector3", np.stack([one, one, rod], axis=1))
        self._track(node["head"], "scale", "vector3", np.stack([head, head, head], axis=1))
        self._track(node["head"], "position", "vector3", np.stack([zero, zero, length], axis=1))

    def _track(self, node: Any, name: str, kind: str, values: np.ndarray) -> None:
        from meshcat.animation import AnimationClip, AnimationTrack

        keyed = values.tolist()
        keyed += [keyed[-1]] * (len(self.frames) - len(keyed))
        clip = self.animation.clips.setdefault(node.path, AnimationClip(fps=FRAMES_PER_SECOND))
        clip.tracks[name] = AnimationTrack(name, kind, self.frames, keyed)


def _turn_z_to(vectors: np.ndarray) -> np.ndarray:
    """Returns rotations (F, 3, 3) that take the z axis to each of the vectors (F, 3)."""
    lengths = np.linalg.norm(vectors, axis=1, keepdims=True)
    z = np.where(lengths > 1e-12, vectors, [0.0, 0.0, 1.0])
    z = z / np.linalg.norm(z, axis=1, keepdims=True)
    x = np.cross(np.where(np.abs(z[:, 2:]) < 0.9, [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]), z)
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    return np.stack([x, np.cross(z, x), z], axis=2)


def draw_floor(node: Any, low: np.ndarray, high: np.ndarray) -> None:
    """Draws a grid of squares, 1, 2 or 5 times a power of ten [m] wide, at the height low[2]."""
    import meshcat.geometry as g

    size = float(np.max(high[:2] - low[:2]))
    power = 10.0 ** math.floor(math.log10(size / 6.0))
    step = max(k * power for k in (1, 2, 5) if k * power <= size / 6.0 or k == 1)
    first = np.floor((low[:2] - 0.35 * size) / step) * step
    last = np.ceil((high[:2] + 0.35 * size) / step) * step
    ends = []
    for axis in (0, 1):
        for at in np.arange(first[axis], last[axis] + 0.5 * step, step):
            for other in (first[1 - axis], last[1 - axis]):
                ends.append([at, other, low[2]] if axis == 0 else [other, at, low[2]])
    lines = g.PointsGeometry(np.array(ends, dtype=np.float32).T)
    node.set_object(g.LineSegments(lines, g.LineBasicMaterial(color=GRID_COLOR)))


def set_stage(view: Any, low: np.ndarray, high: np.ndarray, eye: np.ndarray) -> None:
    """Sets background and camera so that a box is seen whole.

    Args:
        view: The visualizer at the root of the scene. It is shifted to have the box in the middle,
            as meshcat's camera turns about the origin.
        low: Lower corner of the box, (3,) [m].
        high: Upper corner, (3,) [m].
        eye: Direction from the box to the camera, (3,).
    """
    view.set_transform(placement(position=-0.5 * (low + high)))
    eye = eye / np.linalg.norm(eye)
    across = np.cross([0.0, 0.0, 1.0], eye)
    across /= np.linalg.norm(across)
    seen = 0.5 * np.abs(np.stack([across, np.cross(eye, across), eye])) @ (high - low)
    slope = math.tan(math.radians(FIELD_OF_VIEW / 2.0))
    distance = 1.03 * max(seen[1] / slope, seen[0] / (1.4 * slope)) + 0.6 * seen[2]
    x, y, z = distance * eye
    camera = view["/Cameras/default/rotated/<object>"]
    camera.set_property("fov", FIELD_OF_VIEW)
    camera.set_property("position", [float(x), float(z), float(-y)])  # three.js has y upwards
    view["/Background"].set_property("top_color", [0.98, 0.985, 0.99])
    view["/Background"].set_property("bottom_color", [0.85, 0.87, 0.9])
    for node in ("/Grid", "/Axes"):
        view[node].set_property("visible", False)


def placement(rotation: np.ndarray | None = None, position: np.ndarray | None = None) -> np.ndarray:
    """Returns a homogeneous placement (4, 4) of a rotation (3, 3) and a position (3,)."""
    matrix = np.eye(4)
    if rotation is not None:
        matrix[:3, :3] = rotation
    if position is not None:
        matrix[:3, 3] = position
    return matrix
