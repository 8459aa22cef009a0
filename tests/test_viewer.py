"""The animated scene: what it holds, that it moves as the plan does, that it needs no network."""

import base64
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pinocchio as pin
import pytest
import umsgpack
from scipy.spatial.transform import Rotation

from planner import scenario as scenarios
from planner import viewer
from planner.arm import read_arm
from planner.errors import InputError

ROOT = Path(__file__).resolve().parents[1]
TRANSPORT = ROOT / "urdf" / "human_arms" / "transport.toml"


def some_plan(scenario, samples=51, duration=1.0):
    """A motion of the paper's arms that need not be optimal, nor hold an object, to be drawn."""
    time = np.linspace(0.0, duration, samples)
    s = (time / duration)[:, None]
    rest = np.array([*scenario.left.posture, *scenario.right.posture])
    turn = np.linspace(-0.6, 0.6, len(rest))
    q = rest + turn * (3.0 * s**2 - 2.0 * s**3)
    v = turn * (6.0 * s - 6.0 * s**2) / duration
    position = np.array([0.1, 0.4, 0.0]) + s * [0.3, -0.1, 0.0] + s * (1.0 - s) * [0.0, 0.2, 0.0]
    force = np.hstack([np.sin(np.pi * s), 2.0 * s, 0.0 * s])
    return SimpleNamespace(
        scenario=scenario,
        criterion="torque-change",
        cost=16.8,
        duration=duration,
        time=time,
        q=q,
        v=v,
        object_position=position,
        object_rotation=Rotation.from_euler("z", 2.0 * s).as_matrix(),
        hand_force_left=force,
        hand_force_right=-force,
    )


@pytest.fixture(scope="module")
def plan():
    return some_plan(scenarios.load(TRANSPORT))


@pytest.fixture(scope="module")
def commands(plan):
    return viewer.scene(plan).window.commands


def clips_of(commands):
    (animation,) = [command for command in commands if command["type"] == "set_animation"]
    return {entry["path"]: entry["clip"] for entry in animation["animations"]}, animation["options"]


def keys(clip, name):
    (track,) = [track for track in clip["tracks"] if track["name"] == f".{name}"]
    return [key["time"] for key in track["keys"]], np.array([k["value"] for k in track["keys"]])


def test_importing_the_viewer_is_cheap():
    code = (
        "import sys, planner.viewer; print([m for m in ('meshcat', 'IPython') if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True)
    assert done.stdout.strip() == "[]", done.stderr


def test_every_body_moves_in_real_time_and_forever(plan, commands):
    clips, options = clips_of(commands)
    moving = {"left/left_shoulder", "left/left_elbow", "right/right_shoulder", "right/right_elbow"}
    arrows = {f"forces/{side}{part}" for side in viewer.SIDES for part in ("", "/rod", "/head")}
    assert {path.removeprefix("/meshcat/") for path in clips} == moving | {"object"} | arrows
    assert options["play"]
    assert options["repetitions"] == np.inf
    for clip in clips.values():
        assert clip["fps"] == 60
        for track in clip["tracks"]:
            frames = [key["time"] for key in track["keys"]]
            assert frames[:-1] == pytest.approx(np.arange(61.0))  # 1 s
            assert frames[-1] == pytest.approx(60.0 + 0.5 * 60.0)  # and the pause
            assert track["keys"][-1]["value"] == track["keys"][-2]["value"]


def test_last_frame_is_the_plans_end_whatever_the_duration(plan):
    odd = some_plan(plan.scenario, samples=11, duration=0.7123)
    clips, _ = clips_of(viewer.scene(odd, pause=0.0).window.commands)
    frames, _ = keys(clips["/meshcat/object"], "position")
    assert frames[0] == 0.0
    assert frames[-1] == pytest.approx(60.0 * 0.7123)
    assert max(np.diff(frames)) <= 1.0 + 1e-9


def test_keys_are_forward_kinematics(plan, commands):
    clips, _ = clips_of(commands)
    for side, half in (("left", plan.q[:, :2]), ("right", plan.q[:, 2:])):
        model = read_arm(plan.scenario, side).model
        data = model.createData()
        for frame, sample in ((0, 0), (30, 25), (60, 50)):
            pin.forwardKinematics(model, data, half[sample])
            for joint in (1, 2):
                clip = clips[f"/meshcat/{side}/{model.names[joint]}"]
                at = keys(clip, "position")[1][frame]
                turn = Rotation.from_quat(keys(clip, "quaternion")[1][frame]).as_matrix()
                assert at == pytest.approx(data.oMi[joint].translation, abs=1e-9)
                assert turn == pytest.approx(data.oMi[joint].rotation, abs=1e-9)
    assert keys(clips["/meshcat/object"], "position")[1][60] == pytest.approx(
        plan.object_position[-1]
    )


def test_quaternions_never_jump(plan):
    spinning = some_plan(plan.scenario)
    turns = np.linspace(0.0, 9.0, len(spinning.time))
    spinning.object_rotation = Rotation.from_euler("z", turns[:, None]).as_matrix()
    clips, _ = clips_of(viewer.scene(spinning).window.commands)
    quaternions = keys(clips["/meshcat/object"], "quaternion")[1]
    assert np.all(np.sum(quaternions[1:] * quaternions[:-1], axis=1) > 0.9)


def test_arrows_are_the_forces(plan, commands):
    clips, _ = clips_of(commands)
    longest = max(np.linalg.norm(plan.hand_force_left, axis=1))
    tips = {}
    for side, force in (("left", plan.hand_force_left[-1]), ("right", plan.hand_force_right[-1])):
        foot = keys(clips[f"/meshcat/forces/{side}"], "position")[1][60]
        quaternion = keys(clips[f"/meshcat/forces/{side}"], "quaternion")[1][60]
        tip = keys(clips[f"/meshcat/forces/{side}/head"], "position")[1][60]
        assert foot == pytest.approx(plan.object_position[-1])
        tips[side] = Rotation.from_quat(quaternion).apply(tip)
        length = np.linalg.norm(tips[side])
        assert tips[side] / length == pytest.approx(force / np.linalg.norm(force), abs=1e-9)
    assert tips["left"] == pytest.approx(-tips["right"])
    starts = keys(clips["/meshcat/forces/left/head"], "position")[1][:, 2]
    lengths = np.linalg.norm(plan.hand_force_left, axis=1)
    assert starts[60] / starts.max() == pytest.approx(lengths[-1] / longest, rel=1e-2)


def test_every_shape_of_the_urdf_is_drawn_once(plan, commands):
    drawn = [c["path"] for c in commands if c["type"] == "set_object"]
    assert len(drawn) == len(set(drawn))
    for side in viewer.SIDES:
        _, shapes = viewer.read_visuals(plan.scenario, side)
        here = [path for path in drawn if path.startswith(f"/meshcat/{side}/")]
        assert len(here) == len(shapes.geometryObjects) > 0
    assert "/meshcat/path/line" in drawn


def test_object_without_a_picture_is_a_ball(plan, tmp_path):
    bare = tmp_path / "bare.urdf"
    bare.write_text(
        '<robot name="bare"><link name="object"><inertial><mass value="1"/><inertia ixx="0" '
        'ixy="0" ixz="0" iyy="0" iyz="0" izz="0"/></inertial></link></robot>'
    )
    changed = some_plan(plan.scenario.override({"object.urdf": str(bare)}))
    drawn = {c["path"] for c in viewer.scene(changed).window.commands if c["type"] == "set_object"}
    assert "/meshcat/object/ball" in drawn


def test_object_at_rest_can_be_drawn(plan):
    still = some_plan(plan.scenario)
    still.object_position = np.tile([0.2, 0.3, 0.0], (len(still.time), 1))
    still.hand_force_left = still.hand_force_right = np.zeros((len(still.time), 3))
    for command in viewer.scene(still).window.commands:
        if command["type"] == "set_transform":
            assert np.all(np.isfinite(command["matrix"]))


def test_mirrored_mesh_keeps_its_scale_below_the_node_that_moves(plan, tmp_path):
    (tmp_path / "wedge.obj").write_text("v 0 0 0\nv 1 0 0\nv 0 1 0\nv 0 0 1\nf 1 2 3\nf 1 2 4\n")
    text = (TRANSPORT.parent / "left_arm.urdf").read_text()
    mesh = '<geometry><mesh filename="wedge.obj" scale="0.1 -0.2 0.3"/></geometry>'
    cylinder = '<geometry><cylinder radius="0.018" length="0.33"/></geometry>'
    assert cylinder in text
    (tmp_path / "left_arm.urdf").write_text(text.replace(cylinder, mesh))
    changed = plan.scenario.override({"left.urdf": str(tmp_path / "left_arm.urdf")})
    commands = viewer.scene(some_plan(changed)).window.commands
    placed = {c["path"]: np.reshape(c["matrix"], (4, 4)).T for c in commands if "matrix" in c}
    (path,) = [c["path"] for c in commands if c["type"] == "set_object" and holds_mesh(c)]
    assert path.startswith("/meshcat/left/left_elbow/")
    scaled = placed[path][:3, :3]
    assert np.linalg.norm(scaled, axis=0) == pytest.approx([0.1, 0.2, 0.3])
    assert np.linalg.det(scaled) < 0.0
    parent = placed["/meshcat/left/left_elbow"][:3, :3]
    assert parent @ parent.T == pytest.approx(np.eye(3))


def holds_mesh(command):
    return command["object"]["geometries"][0].get("format") == "obj"


def test_page_needs_no_network(plan, tmp_path):
    file = viewer.write_html(plan, tmp_path / "new" / "plan.html")
    page = file.read_text(encoding="utf-8")
    assert file == tmp_path / "new" / "plan.html"
    assert plan.scenario.title in page
    assert not re.search(r"<(script|link|img|iframe)[^>]*\s(src|href)\s*=", page)
    assert "@import" not in page
    urls = set(re.findall(r"https?://[^\s\"'`)]*", page))
    assert urls <= {"http://www.w3.org/1999/xhtml"}  # the name of a language, never fetched


def test_page_holds_the_scene(plan, commands):
    page = viewer.scene(plan).static_html()
    packed = re.findall(r'"data:application/octet-binary;base64,([^"]*)"', page)
    unpacked = [umsgpack.unpackb(base64.b64decode(part)) for part in packed]
    assert [(c["type"], c["path"]) for c in unpacked] == [(c["type"], c["path"]) for c in commands]


def test_title_cannot_smuggle_in_markup(plan):
    shady = some_plan(plan.scenario.override({"title": "<script src='http://x'></script>"}))
    assert "<script src" not in viewer.scene(shady).static_html()


def test_page_that_cannot_be_written_is_bad_input(plan, tmp_path):
    with pytest.raises(InputError, match="cannot be written"):
        viewer.write_html(plan, tmp_path)


def test_server_is_for_this_computer_alone(plan, capsys, monkeypatch):
    opened = []
    monkeypatch.setattr(viewer.webbrowser, "open", lambda url, new: opened.append(url))
    server, address = viewer._start_server()
    monkeypatch.setattr(viewer, "_start_server", lambda: (server, address))
    try:
        view = viewer.open_viewer(plan, block=False)
        assert re.fullmatch(r"viewer: http://127\.0\.0\.1:\d+/static/\n", capsys.readouterr().out)
        assert not opened
        port = int(view.url().split(":")[2].split("/")[0])
        if Path("/proc/net/tcp").exists():
            assert listeners(port) == {"0100007F"}  # 127.0.0.1
        assert "/meshcat/left/left_elbow" in scene_of(view)
    finally:
        viewer._stop(server)


def scene_of(view):
    """The paths of all that meshcat's own server holds."""
    packed = re.findall(r"base64,([A-Za-z0-9+/=]+)\"", view.static_html())
    return {umsgpack.unpackb(base64.b64decode(part))["path"] for part in packed}


def listeners(port):
    """Addresses, as Linux writes them, at which this computer listens to a port."""
    found = set()
    for table in ("/proc/net/tcp", "/proc/net/tcp6"):
        if Path(table).exists():
            for line in Path(table).read_text().splitlines()[1:]:
                address, state = line.split()[1], line.split()[3]
                if state == "0A" and int(address.split(":")[1], 16) == port:
                    found.add(address.split(":")[0])
    return found
