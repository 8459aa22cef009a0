"""The optimal control problem as every peer reads it, and the straight-line start that all share.

Models, end conditions and the start come from the planner's own reading of the scenario, so that
all solve the same problem from the same start; nothing of its solvers is used.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.interpolate import CubicSpline

from planner.assembly import build_chain
from planner.chain import ClosedChain
from planner.constrained_dynamics import tangent
from planner.criteria import make_criterion
from planner.holding import preload_torque, static_torque
from planner.scenario import Scenario
from planner.transport import End, Transport, make_transport


@dataclass(frozen=True, eq=False)
class Terminal:
    """What holds at one end.

    Attributes:
        position: Of the object, (3,) [m].
        rotation: Of the object, (3, 3); None if not prescribed.
        posture: Joint positions where they are prescribed or follow from the pose, (N,) [rad].
        torque: Prescribed torques, (N,) [Nm]; None if free.
        rest: Whether accelerations are zero and the internal wrench free.
    """

    position: np.ndarray
    rotation: np.ndarray | None
    posture: np.ndarray | None
    torque: np.ndarray | None
    rest: bool


@dataclass(frozen=True, eq=False)
class Start:
    """The guess at K times: a quintic straight line with the least torques that follow it.

    Attributes:
        q: (K, N) [rad].
        v: (K, N) [rad/s].
        a: (K, N) [rad/s^2].
        tau: (K, N) [Nm].
        tau_rate: (K, N) [Nm/s].
        wrench: Of the left hand on the right one, world axes, (K, 6) [N, Nm].
    """

    q: np.ndarray
    v: np.ndarray
    a: np.ndarray
    tau: np.ndarray
    tau_rate: np.ndarray
    wrench: np.ndarray


@dataclass(frozen=True, eq=False)
class Task:
    """One problem.

    Attributes:
        chain: The closed chain; peers read masses, lengths and frames from its Pinocchio model.
        transport: The planner's reading of the task.
        duration: [s].
        start: Start.
        goal: Goal.
        rate_weights: Weights of the squared torque rates, (N,); None where torques are no state.
        torque_weights: Weights of the squared torques, (N,).
        speed_cost: Weight of the squared joint speeds.
        posture_cost: Weight of the squared distance from `reference`.
        reference: (N,) [rad].
    """

    chain: ClosedChain
    transport: Transport
    duration: float
    start: Terminal
    goal: Terminal
    rate_weights: np.ndarray | None
    torque_weights: np.ndarray
    speed_cost: float
    posture_cost: float
    reference: np.ndarray

    def first_guess(self, times: np.ndarray) -> Start:
        """Returns the start at increasing times [s]."""
        chain, transport = self.chain, self.transport
        path = CubicSpline(transport.share * self.duration, transport.guess, bc_type="clamped")
        q, v, a = path(times), path(times, 1), path(times, 2)
        load = chain.dynamics.inverse_dynamics(q, v, a)
        loop = chain.loop(chain.dynamics.placements(q))
        gamma = loop.jacobian()
        multiplier = np.linalg.solve(gamma @ gamma.transpose(0, 2, 1), gamma @ load[..., None])
        tau = load - (gamma.transpose(0, 2, 1) @ multiplier)[..., 0]
        rate = CubicSpline(times, tau)(times, 1) if len(times) > 1 else np.zeros_like(tau)
        return Start(q, v, a, tau, rate, loop.wrench(multiplier[..., 0]))


def read_task(scenario: Scenario, chain: ClosedChain | None = None) -> Task:
    """Returns the problem that a scenario poses.

    Raises:
        NotImplementedError: The peers do not cover it.
    """
    chain = chain or build_chain(scenario)
    transport = make_transport(scenario, chain)
    criterion = make_criterion(scenario, chain, transport.reference)
    if criterion is None:
        raise NotImplementedError("minimum jerk is known in closed form")
    state = criterion.state_cost
    return Task(
        chain=chain,
        transport=transport,
        duration=transport.duration,
        start=_terminal(transport, transport.start),
        goal=_terminal(transport, transport.goal),
        rate_weights=criterion.rate_weights if criterion.torque_is_state else None,
        torque_weights=criterion.torque_weights,
        speed_cost=0.0 if state is None else state.speed,
        posture_cost=0.0 if state is None else state.posture,
        reference=transport.reference,
    )


def _terminal(transport: Transport, end: End) -> Terminal:
    chain, rule = transport.chain, end.torque_rule
    if np.any(end.velocity):
        raise NotImplementedError("the peers start and end at rest")
    determined = end.held or chain.p == len(chain.task_rows(end.pose.rotation is not None))
    torque = None
    if rule == "given":
        torque = end.torque
    elif rule in ("static", "preload"):
        if not determined:
            raise NotImplementedError("holding torques at an end whose posture is free")
        q = end.posture[None]
        at = tangent(chain, transport.joints, q, chain.dynamics.placements(q))
        holding = (
            preload_torque(chain, at, end.preload) if end.preload else static_torque(chain, at)
        )
        torque = holding[0]
    return Terminal(
        position=end.pose.position,
        rotation=end.pose.rotation,
        posture=end.posture if determined else None,
        torque=torque,
        rest=rule == "rest",
    )
