"""The plan in meshcat: both arms, the object and its path, moving in real time in a browser."""

from __future__ import annotations

import atexit
import contextlib
import io
import math
import subprocess
import sys
import webbrowser
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
import pinocchio as pin
from scipy.interpolate import CubicHermiteSpline, CubicSpline
from scipy.spatial.transform import Rotation, RotationSpline

from planner.arm import Side, read_visuals
from planner.body import read_object_visuals
from planner.drawing import (
    FRAMES_PER_SECOND,
    Animation,
    draw_ball,
    draw_floor,
    draw_path,
    draw_shapes,
    outline,
    set_stage,
)
from planner.errors import InputError, PlannerError
from planner.page import Recorder

if TYPE_CHECKING:
    from planner.result import Plan

SIDES: tuple[Side, Side] = ("left", "right")
FORCE_COLORS: dict[Side, int] = {"left": 0xD55E00, "right": 0x7B3FA0}
OBJECT_COLOR = 0xE69F00
# meshcat's own way to start its server lets the whole network in
_SERVER = """
import functools, tornado.web
listen = tornado.web.Application.listen
tornado.web.Application.listen = functools.partialmethod(listen, address="127.0.0.1")
from meshcat.servers.zmqserver import main
main()
"""
Visuals = dict[Side, tuple[pin.Model, pin.GeometryModel]]


@dataclass(frozen=True, eq=False)
class Motion:
    """A plan at the frames of its animation, F of them.

    Attributes:
        time: From 0 to the plan's duration, (F,) [s].
        joints: For each side, the placements of the arm's joints in the world by the joint's
            index in the model, the fixed base being 0, (F, 4, 4) [m].
        object: Placements of the object in the world, (F, 4, 4) [m].
        forces: For each side, the hand's force on the object, (F, 3) [N].
    """

    time: np.ndarray
    joints: dict[Side, list[np.ndarray]]
    object: np.ndarray
    forces: dict[Side, np.ndarray]


def scene(plan: Plan, *, pause: float = 0.5) -> Any:
    """Returns the plan drawn in a `meshcat.Visualizer` that has no server yet.

    The tree in the browser's own controls has the groups "left", "right", "object", "path",
    "forces" (the hands' forces on the object, as arrows) and "floor", each of which can be hidden.

    Args:
        plan: The plan.
        pause: How long the last posture stays before the motion starts again [s].

    Returns:
        A visualizer whose `window` is a [Recorder][planner.page.Recorder], and whose
        `static_html()` is the finished page.

    Raises:
        ModelError: A URDF of the scenario cannot be used any more.
    """
    import meshcat

    visuals: Visuals = {side: read_visuals(plan.scenario, side) for side in SIDES}
    held = read_object_visuals(plan.scenario)
    motion = sample(plan, visuals)
    low, high = _box(motion, visuals, held)
    size = float(np.linalg.norm(high - low))

    legend = {FORCE_COLORS[side]: f"force of the {side} hand on the object" for side in SIDES}
    view = meshcat.Visualizer(window=Recorder(_caption(plan), legend))
    animation = Animation(motion.time, pause)
    for side, (model, shapes) in visuals.items():
        # a slash in a name would begin a new level of meshcat's tree
        nodes = {joint: model.names[joint].replace("/", "_") for joint in range(model.njoints)}
        nodes[0] = "base"
        draw_shapes(view[side], shapes, nodes)
        for joint in range(1, model.njoints):
            animation.move(view[side][nodes[joint]], motion.joints[side][joint])
    draw_shapes(view["object"], held, dict.fromkeys(range(1), "shapes"))
    if not len(held.geometryObjects):
        draw_ball(view["object/ball"], 0.03 * size, OBJECT_COLOR)
    animation.move(view["object"], motion.object)
    draw_path(view["path"], plan.object_position, 0.003 * size)
    _draw_forces(view["forces"], animation, plan, motion, size)
    draw_floor(view["floor"], low, high)
    set_stage(view, low, high, _eye(motion, low, high))
    view.set_animation(animation.animation, play=True, repetitions=math.inf)
    return view


def write_html(plan: Plan, path: Path | str) -> Path:
    """Writes the animated scene as one page that plays without a server or a network.

    Args:
        plan: The plan.
        path: The file; its folder is made where it is missing.

    Returns:
        The file.

    Raises:
        InputError: The file cannot be written.
        ModelError: A URDF of the scenario cannot be used any more.
    """
    path = Path(path)
    page = scene(plan).static_html()
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(page, encoding="utf-8")
    except OSError as error:
        raise InputError(
            f"cannot be written: {error.strerror}", source=path, remedy="name a writable file"
        ) from None
    return path


def open_viewer(plan: Plan, *, open_browser: bool = False, block: bool = True) -> Any:
    """Serves the animated scene to this computer alone and prints its address.

    Args:
        plan: The plan.
        open_browser: Open the address in the browser, too.
        block: Stay until Ctrl-C, then stop the server. Otherwise the server lives as long as this
            Python does.

    Returns:
        The `meshcat.Visualizer` of the server.

    Raises:
        ModelError: A URDF of the scenario cannot be used any more.
        PlannerError: The server does not start.
    """
    import meshcat
    from meshcat.visualizer import umsgpack

    commands = scene(plan).window.commands
    server, address = _start_server()
    with contextlib.redirect_stdout(io.StringIO()):  # meshcat announces the address in two lines
        view = meshcat.Visualizer(zmq_url=address)
    socket = view.window.zmq_socket
    for command in commands:
        head = [command["type"].encode(), command["path"].encode()]
        socket.send_multipart([*head, umsgpack.packb(command)])
        socket.recv()
    print(f"viewer: {view.url()}{' (Ctrl-C ends it)' if block else ''}", flush=True)  # noqa: T201
    if open_browser:
        webbrowser.open(view.url(), new=2)
    if block:
        try:
            server.wait()
        except KeyboardInterrupt:
            pass
        finally:
            _stop(server)
    return view


def _start_server() -> tuple[subprocess.Popen[str], str]:
    """Starts meshcat's server and returns it with the address that takes its commands."""
    server = subprocess.Popen(
        [sys.executable, "-P", "-u", "-c", _SERVER],
        stdout=subprocess.PIPE,
        stderr=subprocess.DEVNULL,
        text=True,
        start_new_session=True,  # Ctrl-C is for the planner, which then stops the server
    )
    atexit.register(_stop, server)
    assert server.stdout is not None
    for line in server.stdout:
        if line.startswith("zmq_url="):
            return server, line.strip().removeprefix("zmq_url=")
    raise PlannerError("meshcat's server did not start; write a page instead (--html FILE)")


def _stop(server: subprocess.Popen[str]) -> None:
    server.kill()
    server.wait()


def sample(plan: Plan, visuals: Visuals) -> Motion:
    """Returns the plan at the frames of its animation, both ends included.

    Args:
        plan: The plan.
        visuals: For each side, the arm's model and its shapes.
    """
    begin, end = float(plan.time[0]), float(plan.time[-1])
    steps = max(1, math.ceil((end - begin) * FRAMES_PER_SECOND - 1e-9))
    times = np.linspace(begin, end, steps + 1)
    q = CubicHermiteSpline(plan.time, plan.q, plan.v)(times)
    joints: dict[Side, list[np.ndarray]] = {}
    first = 0
    for side, (model, _) in visuals.items():
        data = model.createData()
        placements = np.empty((model.njoints, len(times), 4, 4))
        for frame, posture in enumerate(q[:, first : first + model.nq]):
            pin.forwardKinematics(model, data, posture)
            placements[:, frame] = [joint.homogeneous for joint in data.oMi]
        joints[side] = list(placements)
        first += model.nq
    held = np.tile(np.eye(4), (len(times), 1, 1))
    held[:, :3, 3] = CubicSpline(plan.time, plan.object_position)(times)
    turns = RotationSpline(plan.time, Rotation.from_matrix(plan.object_rotation))
    held[:, :3, :3] = turns(times).as_matrix()
    forces: dict[Side, np.ndarray] = {
        "left": CubicSpline(plan.time, plan.hand_force_left)(times),
        "right": CubicSpline(plan.time, plan.hand_force_right)(times),
    }
    return Motion(times - begin, joints, held, forces)


def _caption(plan: Plan) -> str:
    title = plan.scenario.title or "Two arms, one object"
    return f"{title} · {plan.criterion} · {plan.duration:g} s · cost {plan.cost:.6g}"


def _draw_forces(view: Any, animation: Animation, plan: Plan, motion: Motion, size: float) -> None:
    """Draws the hands' forces on the object, the largest one a sixth of the scene long."""
    largest = max(float(np.linalg.norm(force, axis=1).max()) for force in motion.forces.values())
    for side, force in motion.forces.items():
        grasp = np.array(getattr(plan.scenario, side).grasp.xyz, dtype=float)
        start = motion.object[:, :3, 3] + motion.object[:, :3, :3] @ grasp
        vector = force * (size / 6.0 / max(largest, 1e-9))
        animation.arrow(view[side], start, vector, 0.004 * size, FORCE_COLORS[side])


def _box(
    motion: Motion, visuals: Visuals, held: pin.GeometryModel
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the corners (3,), (3,) [m] of the box that holds all shapes all along."""
    frames = np.unique(np.linspace(0, len(motion.time) - 1, 9).astype(int))
    placed = [(motion.object, shape) for shape in held.geometryObjects]
    for side, (_, shapes) in visuals.items():
        joints = motion.joints[side]
        placed += [(joints[shape.parentJoint], shape) for shape in shapes.geometryObjects]
    points = [motion.object[:, :3, 3]]
    points += [joint[frames, :3, 3] for side in SIDES for joint in motion.joints[side][1:]]
    for placements, shape in placed:
        corners = outline(shape)
        moved = placements[frames] @ shape.placement.homogeneous
        corners = corners @ moved[:, :3, :3].transpose(0, 2, 1) + moved[:, None, :3, 3]
        points.append(corners.reshape(-1, 3))
    everything = np.concatenate(points)
    low, high = everything.min(axis=0), everything.max(axis=0)
    margin = 0.02 * float(np.linalg.norm(high - low)) + 1e-3
    return low - [margin, margin, 0.0], high + margin


def _eye(motion: Motion, low: np.ndarray, high: np.ndarray) -> np.ndarray:
    """Returns the direction (3,) to the camera: from above where all is flat, else from the front.

    Either way the arms stand side by side in the picture.
    """
    left, right = (motion.joints[side][1][0, :3, 3] for side in SIDES)
    across = np.array([right[0] - left[0], right[1] - left[1]])
    if np.linalg.norm(across) < 1e-6:
        across = np.array([1.0, 0.0])
    across /= np.linalg.norm(across)
    front = np.array([across[1], -across[0]])  # left and right as for whoever stands behind them
    extent = high - low
    if extent[2] < 0.4 * max(extent[:2]):
        return np.array([*(0.55 * front), 1.0])
    ahead = motion.object[:, :2, 3].mean(axis=0) - 0.5 * (left + right)[:2]
    if ahead @ front < -0.1 * float(np.linalg.norm(extent)):
        front = -front  # arms that reach ahead are seen from where they reach to
    return np.array([*(front + 0.45 * across), 0.55])
