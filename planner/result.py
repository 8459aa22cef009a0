"""The plan: motion, torques and hand forces over time, its cost and checks, on disk and back."""

from __future__ import annotations

import json
import zipfile
import zlib
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from planner.errors import InputError
from planner.outcome import plain

if TYPE_CHECKING:
    from planner.scenario import Scenario

PLAN_FILE = "plan.json"
TRAJECTORY_FILE = "trajectory.npz"
ARRAYS = (
    "time",
    "joint_names",
    "q",
    "v",
    "a",
    "tau",
    "tau_rate",
    "object_position",
    "object_rotation",
    "hand_force_left",
    "hand_force_right",
    "hand_moment_left",
    "hand_moment_right",
    "internal_force",
    "adjoint",
)


# what reading a spoilt archive raises
_DAMAGED = (OSError, EOFError, zipfile.BadZipFile, zlib.error)


@dataclass(frozen=True, eq=False)
class Plan:
    """An optimal motion of both arms, sampled at N times; n joints an arm, left arm first.

    Attributes:
        scenario: What was planned.
        criterion: Name of the criterion.
        cost: Its value.
        duration: [s].
        solver: Method, nodes, iterations, rms_residual, seconds.
        checks: What was verified, see `planner.checks`.
        remarks: What the reader should know.
        time: (N,) [s].
        joint_names: 2n names.
        q: Joint positions, (N, 2n) [rad].
        v: Joint velocities, (N, 2n) [rad/s].
        a: Joint accelerations, (N, 2n) [rad/s^2].
        tau: Joint torques, (N, 2n) [Nm].
        tau_rate: Their rates, (N, 2n) [Nm/s].
        object_position: Origin of the object's frame, (N, 3) [m].
        object_rotation: Its axes, (N, 3, 3).
        hand_force_left: Force of the left hand on the object, world axes, (N, 3) [N].
        hand_force_right: Likewise of the right hand.
        hand_moment_left: Its moment about the object's frame, (N, 3) [Nm].
        hand_moment_right: Likewise of the right hand.
        internal_force: hand_force_left - hand_force_right, (N, 3) [N].
        adjoint: Costates of Pontryagin's equations, (N, state size): of the independent joints,
            of their rates, and of the torques where these are states. Empty for jerk.
    """

    scenario: Scenario
    criterion: str
    cost: float
    duration: float
    solver: dict[str, Any]
    checks: dict[str, Any]
    remarks: tuple[str, ...]
    time: np.ndarray
    joint_names: tuple[str, ...]
    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    tau_rate: np.ndarray
    object_position: np.ndarray
    object_rotation: np.ndarray
    hand_force_left: np.ndarray
    hand_force_right: np.ndarray
    hand_moment_left: np.ndarray
    hand_moment_right: np.ndarray
    internal_force: np.ndarray
    adjoint: np.ndarray

    status: ClassVar[str] = "solved"
    solved: ClassVar[bool] = True

    @property
    def path_length(self) -> float:
        """Length of the object's path [m]."""
        return float(np.linalg.norm(np.diff(self.object_position, axis=0), axis=1).sum())

    @property
    def mean_internal_force(self) -> float:
        """Mean magnitude of the internal force over time [N]."""
        size = np.linalg.norm(self.internal_force, axis=1)
        return float(np.trapezoid(size, self.time) / self.duration)

    def unwrap(self) -> Plan:
        """Returns the plan itself; a `Failure` raises here."""
        return self

    def save(self, folder: Path | str) -> Path:
        """Writes `plan.json` and `trajectory.npz`; makes the folder.

        Returns:
            The folder.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        arrays = {name: np.asarray(getattr(self, name)) for name in ARRAYS}
        np.savez_compressed(folder / TRAJECTORY_FILE, allow_pickle=False, **arrays)
        content = {
            "status": self.status,
            "cost": self.cost,
            "criterion": self.criterion,
            "duration": self.duration,
            "solver": self.solver,
            "checks": self.checks,
            "remarks": list(self.remarks),
            "versions": versions(),
            "scenario": self.scenario.resolved(),
        }
        text = json.dumps(plain(content), indent=2, allow_nan=False)
        (folder / PLAN_FILE).write_text(text + "\n")
        return folder

    @staticmethod
    def load(folder: Path | str) -> Plan:
        """Returns the plan saved in a folder.

        Raises:
            InputError: The folder holds no plan, or one of a solve that failed.
        """
        from planner.scenario import Scenario

        path = Path(folder) / PLAN_FILE
        try:
            content = json.loads(path.read_text())
            status = content["status"]
        except (OSError, ValueError, KeyError, TypeError):
            raise InputError(
                "holds no plan", source=folder, remedy="name a folder written by planner plan --out"
            ) from None
        if status != Plan.status:
            raise InputError(
                f"holds no plan: that solve ended with {status}",
                source=folder,
                remedy=str(content.get("remedy", "")),
            )
        try:
            with np.load(Path(folder) / TRAJECTORY_FILE, allow_pickle=False) as stored:
                arrays: dict[str, Any] = {name: stored[name] for name in ARRAYS}
            arrays["joint_names"] = tuple(str(name) for name in arrays["joint_names"])
            return Plan(
                scenario=Scenario.from_resolved(content["scenario"], source=path),
                criterion=content["criterion"],
                cost=content["cost"],
                duration=content["duration"],
                solver=content["solver"],
                checks=content["checks"],
                remarks=tuple(content["remarks"]),
                **arrays,
            )
        except (*_DAMAGED, KeyError, TypeError, ValueError) as error:
            raise InputError(
                f"the plan is damaged: {error}", source=folder, remedy="plan it again"
            ) from None

    def show(self, *, open_browser: bool = True, block: bool = True) -> None:
        """Shows the motion in the browser, see `planner.viewer.open_viewer`."""
        from planner.viewer import open_viewer

        open_viewer(self, open_browser=open_browser, block=block)


def versions() -> dict[str, str]:
    """Returns the versions of what a plan's numbers depend on."""
    import platform
    from importlib.metadata import PackageNotFoundError, version

    found = {"python": platform.python_version()}
    for package in ("dual-arm-planner", "pin", "numpy", "scipy"):
        try:
            found[package] = version(package)
        except PackageNotFoundError:
            found[package] = "not installed"
    return found
