"""Mechanisms that the tests move: scenarios of known arms, their states, and exact differences."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from planner.assembly import build_chain
from planner.chain import ClosedChain
from planner.constrained_dynamics import (
    InverseDerivatives,
    Joints,
    Motion,
    Tangent,
    accelerate,
    inertial,
    inverse_derivatives,
    tangent,
)
from planner.independent_joints import choose_joints
from planner.scenario import Scenario, load

HUMAN_ARMS = Path(__file__).parents[1] / "urdf" / "human_arms"
PANDA = "package://example-robot-data/robots/panda_description/urdf/panda.urdf"
PANDA_POSTURE = [0.0, -np.pi / 4, 0.0, -3 * np.pi / 4, 0.0, np.pi / 2, np.pi / 4]
PAIRS = {
    "revolute": 5,
    "spherical": 3,
    "cylindrical": 4,
    "prismatic": 5,
    "planar": 3,
    "rigid": 6,
}
"""Each pair and the number of motions that it blocks in space."""


# ---- scenarios -----------------------------------------------------------------------------------


def human_arms(overrides: dict[str, Any] | None = None) -> Scenario:
    """The paper's scenario."""
    return load(HUMAN_ARMS / "transport.toml", overrides or {})


def arm_urdf(
    lengths: Sequence[float],
    masses: Sequence[float],
    name: str = "arm",
    axis: str = "0 0 1",
    kind: str = "revolute",
) -> str:
    """URDF of a serial arm of slender links along x; its last frame is called `hand`."""
    parts = ['<link name="base"/>']
    parent, at = "base", 0.0
    for place, (length, mass) in enumerate(zip(lengths, masses, strict=True)):
        moment = mass * length**2 / 12
        parts.append(
            f'<joint name="joint{place}" type="{kind}"><origin xyz="{at} 0 0"/>'
            f'<parent link="{parent}"/><child link="link{place}"/><axis xyz="{axis}"/>'
            '<limit lower="-3" upper="3" effort="40" velocity="10"/></joint>'
            f'<link name="link{place}"><inertial><origin xyz="{length / 2} 0 0"/>'
            f'<mass value="{mass}"/><inertia ixx="{moment / 50}" ixy="0" ixz="0" '
            f'iyy="{moment}" iyz="0" izz="{moment}"/></inertial></link>'
        )
        parent, at = f"link{place}", length
    parts.append(
        f'<joint name="wrist" type="fixed"><origin xyz="{at} 0 0"/><parent link="{parent}"/>'
        '<child link="hand"/></joint><link name="hand"/>'
    )
    return f'<robot name="{name}">{"".join(parts)}</robot>'


def bar_urdf() -> str:
    """URDF of an object with an offset centre of mass and unequal, tilted moments of inertia."""
    return (
        '<robot name="bar"><link name="object"><inertial><origin xyz="0.03 -0.02 0.05"/>'
        '<mass value="1.7"/><inertia ixx="0.02" ixy="0.004" ixz="-0.002" iyy="0.03" iyz="0.003" '
        'izz="0.015"/></inertial></link></robot>'
    )


def write(path: Path, text: str) -> Path:
    """Writes a file and returns its path."""
    path.write_text(text)
    return path


def planar_arms(
    folder: Path,
    pair: str = "revolute",
    *,
    gravity: Sequence[float] = (0.0, -9.81, 0.0),
    **extra: Any,
) -> Scenario:
    """Two arms of three joints in the x-y plane that hold a bar with their hands apart."""
    left = write(folder / "left.urdf", arm_urdf((0.3, 0.25, 0.12), (1.1, 0.8, 0.3)))
    right = write(folder / "right.urdf", arm_urdf((0.28, 0.27, 0.1), (1.0, 0.9, 0.2)))
    bar = write(folder / "bar.urdf", bar_urdf())
    return Scenario.from_resolved(
        {
            "left": {
                "urdf": str(left),
                "tip": "hand",
                "posture": [2.2, -1.3, -0.6],
                "grasp": {"xyz": [-0.04, 0.01, 0.0], "rpy": [0.0, 0.0, 0.3]},
            },
            "right": {
                "urdf": str(right),
                "tip": "hand",
                "base": {"xyz": [0.5, 0.0, 0.0], "rpy": [0.0, 0.0, 0.2]},
                "posture": [0.9, 1.3, 0.5],
                "grasp": {"xyz": [0.05, -0.02, 0.0], "rpy": [0.0, 0.0, 2.4]},
            },
            "object": {"urdf": str(bar)},
            "grasp": {"pair": pair},
            "world": {"gravity": list(gravity)},
            "task": {
                "start": {"xyz": [0.2, 0.4, 0.0]},
                "goal": {"xyz": [0.3, 0.35, 0.0]},
                "duration": 1.0,
            },
            **extra,
        }
    )


def pandas(
    pair: str = "rigid",
    axis: Sequence[float] = (0.3, 1.0, 0.2),
    *,
    thing: Path | None = None,
    **extra: Any,
) -> Scenario:
    """Two Pandas side by side, their hands 0.6 m apart on one object, under gravity."""

    def side(sign: float) -> dict[str, Any]:
        return {
            "urdf": PANDA,
            "tip": "panda_hand_tcp",
            "base": {"xyz": [0.0, 0.3 * sign, 0.0]},
            "posture": PANDA_POSTURE,
            "grasp": {"xyz": [0.0, 0.3 * sign, 0.0], "rpy": [np.pi, 0.0, 0.0]},
        }

    thing = thing or HUMAN_ARMS / "point_mass.urdf"
    return Scenario.from_resolved(
        {
            "left": side(1.0),
            "right": side(-1.0),
            "object": {"urdf": str(thing)},
            "grasp": {"pair": pair, "axis": list(axis)},
            "world": {"gravity": [0.0, 0.0, -9.81]},
            "task": {
                "start": {"xyz": [0.35, 0.0, 0.45]},
                "goal": {"xyz": [0.4, 0.1, 0.5]},
                "duration": 1.5,
            },
            **extra,
        }
    )


# ---- states --------------------------------------------------------------------------------------


@dataclass(frozen=True, eq=False)
class Mechanism:
    """A closed chain with its choice of independent joints and a closed posture."""

    scenario: Scenario
    chain: ClosedChain
    joints: Joints
    posture: np.ndarray

    def freedoms(self, q: np.ndarray) -> Tangent:
        """The chain's freedoms at closed postures."""
        return tangent(self.chain, self.joints, q, self.chain.dynamics.placements(q))

    def closed(self, q: np.ndarray) -> np.ndarray:
        """Postures with the same independent joints that close the chain."""
        result, _, good = self.chain.close(q, self.joints.dependent)
        assert good.all()
        return result

    def move(self, q: np.ndarray, rate: np.ndarray, tau: np.ndarray) -> Motion:
        """The motion at closed postures q under rates of the independent joints and torques."""
        at = self.freedoms(q)
        v = np.einsum("kij,kj->ki", at.s, rate)
        return accelerate(self.joints, at, v, inertial(self.chain, self.joints, at, v), tau)

    def shifted(self, q: np.ndarray, along: np.ndarray) -> np.ndarray:
        """Closed postures with the independent joints moved by `along`."""
        moved = q.copy()
        moved[:, self.joints.independent] += along
        return self.closed(moved)


@dataclass(frozen=True, eq=False)
class States:
    """Random states: closed postures, rates of independent joints, torques, costates."""

    q: np.ndarray
    rate: np.ndarray
    tau: np.ndarray
    n2: np.ndarray


def settle(scenario: Scenario) -> Mechanism:
    """The scenario's chain, closed near the postures that the scenario gives."""
    chain = build_chain(scenario)
    guess = np.concatenate([arm.posture for arm in chain.arms])[None]
    joints = choose_joints(chain, guess)
    posture, _, good = chain.close(guess, joints.dependent)
    assert good.all()
    joints = choose_joints(chain, posture)
    return Mechanism(scenario, chain, joints, posture[0])


def derivatives_of(mechanism: Mechanism, motion: Motion) -> InverseDerivatives:
    """Derivatives of the torques that a motion needs."""
    parts = motion.tangent, motion.v, motion.a, motion.multiplier
    return inverse_derivatives(mechanism.chain, mechanism.joints, *parts)


def random_states(mechanism: Mechanism, count: int = 4, seed: int = 0) -> States:
    """States near the mechanism's posture at brisk speeds."""
    generator = np.random.default_rng(seed)
    chain = mechanism.chain
    q = mechanism.posture + generator.uniform(-0.15, 0.15, (count, chain.n))
    return States(
        q=mechanism.closed(q),
        rate=generator.normal(size=(count, chain.p)),
        tau=5.0 * generator.normal(size=(count, chain.n)),
        n2=generator.normal(size=(count, chain.p)),
    )


def mirrored(q: np.ndarray) -> np.ndarray:
    """The paper's arms with their hands where q has them and both elbows on the other side."""
    q = q.copy()
    for shoulder, elbow in ((0, 1), (2, 3)):
        # the hand's direction seen from the shoulder stays: turn the elbow over, the shoulder back
        bend = np.arctan2(0.33 * np.sin(q[elbow]), 0.27 + 0.33 * np.cos(q[elbow]))
        q[shoulder] += 2.0 * bend
        q[elbow] *= -1.0
    return q


# ---- differences ---------------------------------------------------------------------------------


def difference(function: Callable[[float], np.ndarray], step: float) -> np.ndarray:
    """Derivative of a function of one number at zero, by a central difference of sixth order."""
    result = np.zeros_like(function(0.0))
    for place, weight in ((1, 45.0), (2, -9.0), (3, 1.0)):
        result += weight / (60.0 * step) * (function(place * step) - function(-place * step))
    return result


def differences(function: Callable[[np.ndarray], np.ndarray], size: int, step: float) -> np.ndarray:
    """Derivatives along each of `size` unit vectors, stacked on the last axis."""

    def along(unit: np.ndarray) -> np.ndarray:
        return difference(lambda t: function(t * unit), step)

    return np.stack([along(unit) for unit in np.eye(size)], axis=-1)


def relative_error(value: np.ndarray, wanted: np.ndarray) -> float:
    """Largest deviation of each sample over its largest wanted entry, the worst sample's."""
    wanted = np.asarray(wanted)
    assert value.shape == wanted.shape
    axes = tuple(range(1, wanted.ndim))
    size = np.max(np.abs(wanted), axis=axes)
    assert np.all(size > 1e-9), "nothing to compare with"
    return float(np.max(np.max(np.abs(value - wanted), axis=axes) / size))
