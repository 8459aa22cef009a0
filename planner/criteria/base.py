"""What every criterion is made of: weights, the layout of its states, and one evaluation of them.

The running costs are weighted squares,

    L = 1/2 u'W u + 1/2 tau'V tau + state cost,     u = d tau/dt.

With W the torques are states and u the control (eqs. 4 to 9); without W the torques themselves
are the control and the problem has no torque state.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planner.constrained_dynamics import (
    InverseDerivatives,
    Motion,
    Tangent,
    accelerate,
    inertial,
    inverse_derivatives,
)
from planner.costates import Gradient, StateCost, hamiltonian_gradient, torque_costate
from planner.independent_joints import Coordinates
from planner.vectors import matvec


@dataclass(frozen=True, eq=False)
class Evaluation:
    """Everything that the equations need at K states; derivatives once they are asked for.

    Attributes:
        coordinates: Map from independent joints to closed postures.
        closed: Which samples could be closed, (K,).
        tau: Torques, (K, N) [Nm].
        motion: Accelerations and forces.
        n2: Costates of the independent joints' accelerations, (K, p).
        state_cost: Running cost on speed and posture, if any.
    """

    coordinates: Coordinates
    closed: np.ndarray
    tau: np.ndarray
    motion: Motion
    n2: np.ndarray
    state_cost: StateCost | None

    @property
    def tangent(self) -> Tangent:
        """Freedoms at the postures."""
        return self.motion.tangent

    @cached_property
    def derivatives(self) -> InverseDerivatives:
        """Derivatives of the torques that the motion needs."""
        motion, chain = self.motion, self.coordinates.chain
        parts = motion.tangent, motion.v, motion.a, motion.multiplier
        return inverse_derivatives(chain, self.coordinates.joints, *parts)

    @cached_property
    def gradient(self) -> Gradient:
        """Gradient of the Hamiltonian."""
        return hamiltonian_gradient(self.motion, self.derivatives, self.n2, self.state_cost)


@dataclass(frozen=True, eq=False)
class Criterion(ABC):
    """A criterion with its weights.

    Attributes:
        n: Number of joints.
        p: Number of independent joints.
        rate_weights: Diagonal of W, (N,); empty where the torques are no state.
        torque_weights: Diagonal of V, (N,).
        state_cost: Running cost on speed and posture, if any.
    """

    n: int
    p: int
    rate_weights: np.ndarray
    torque_weights: np.ndarray
    state_cost: StateCost | None

    @property
    @abstractmethod
    def name(self) -> str:
        """The criterion's name in a scenario."""

    @property
    def torque_is_state(self) -> bool:
        """Whether the torques are states."""
        return bool(len(self.rate_weights))

    @cached_property
    def state_size(self) -> int:
        """Number of states; as many costates belong to them."""
        return 2 * self.p + (self.n if self.torque_is_state else 0)

    # ---- places of the parts in X = (y, dy/dt, tau, n1, n2, n3) --------------------------------

    @cached_property
    def at_y(self) -> slice:
        """Place of y."""
        return slice(0, self.p)

    @cached_property
    def at_rate(self) -> slice:
        """Place of dy/dt."""
        return slice(self.p, 2 * self.p)

    @cached_property
    def at_tau(self) -> slice:
        """Place of tau; empty where it is no state."""
        return slice(2 * self.p, self.state_size)

    def _costate(self, place: slice) -> slice:
        return slice(place.start + self.state_size, place.stop + self.state_size)

    @cached_property
    def at_n1(self) -> slice:
        """Place of the costates of y."""
        return self._costate(self.at_y)

    @cached_property
    def at_n2(self) -> slice:
        """Place of the costates of dy/dt."""
        return self._costate(self.at_rate)

    @cached_property
    def at_n3(self) -> slice:
        """Place of the costates of tau."""
        return self._costate(self.at_tau)

    # ---- evaluation ----------------------------------------------------------------------------

    def evaluate(self, coordinates: Coordinates, share: np.ndarray, x: np.ndarray) -> Evaluation:
        """Returns everything that the equations need at K states x, (K, 2 * state_size).

        Args:
            coordinates: Map from independent joints to closed postures.
            share: Shares of the duration, (K,).
            x: States and costates.
        """
        at, closed = coordinates.tangent(share, x[:, self.at_y])
        return self.evaluate_at(coordinates, at, closed, x)

    def evaluate_at(
        self, coordinates: Coordinates, at: Tangent, closed: np.ndarray, x: np.ndarray
    ) -> Evaluation:
        """Likewise, at postures whose freedoms are known."""
        chain, joints = coordinates.chain, coordinates.joints
        v = matvec(at.s, x[:, self.at_rate])
        terms = inertial(chain, joints, at, v)
        n2 = x[:, self.at_n2]
        if self.torque_is_state:
            tau = x[:, self.at_tau]
        else:
            tau = -torque_costate(at, terms.reduced, n2) / self.torque_weights
        motion = accelerate(joints, at, v, terms, tau)
        return Evaluation(coordinates, closed, tau, motion, n2, self.state_cost)

    @abstractmethod
    def right_side(self, at: Evaluation, x: np.ndarray, independent: np.ndarray) -> np.ndarray:
        """Returns dX/dt (eq. 12) with the optimal control (eq. 15), (K, 2 * state_size)."""

    @abstractmethod
    def jacobian(
        self, coordinates: Coordinates, at: Evaluation, x: np.ndarray, rate_step: float
    ) -> np.ndarray:
        """Returns d(dX/dt)/dX, (K, 2 * state_size, 2 * state_size)."""

    @abstractmethod
    def torque_rate(
        self, coordinates: Coordinates, share: np.ndarray, x: np.ndarray, at: Evaluation
    ) -> np.ndarray:
        """Returns d tau/dt, (K, N) [Nm/s]."""

    def running_cost(self, at: Evaluation, x: np.ndarray) -> np.ndarray:
        """Returns the running cost L at K states, (K,)."""
        cost = 0.5 * (at.tau * at.tau) @ self.torque_weights
        if self.torque_is_state:
            n3 = x[:, self.at_n3]
            cost = cost + 0.5 * (n3 * n3) @ (1.0 / self.rate_weights)
        if self.state_cost is not None:
            cost = cost + self.state_cost.value(at.tangent.q, at.motion.v)
        return cost

    def running_cost_of(
        self, coordinates: Coordinates, share: np.ndarray, x: np.ndarray
    ) -> np.ndarray:
        """Returns the running cost L at K states, (K,), with as little evaluated as it needs."""
        if not self.torque_is_state or self.state_cost is not None:
            return self.running_cost(self.evaluate(coordinates, share, x), x)
        tau, n3 = x[:, self.at_tau], x[:, self.at_n3]
        cost: np.ndarray = 0.5 * (tau * tau) @ self.torque_weights
        return cost + 0.5 * (n3 * n3) @ (1.0 / self.rate_weights)

    def hamiltonian(self, at: Evaluation, x: np.ndarray, independent: np.ndarray) -> np.ndarray:
        """Returns the terms of the Hamiltonian (eq. 11), whose sum is constant, (K, 4).

        They are the running cost, and the costates times the rates of y, of dy/dt and of tau.
        """
        terms = np.zeros((len(x), 4))
        terms[:, 0] = self.running_cost(at, x)
        terms[:, 1] = (x[:, self.at_n1] * x[:, self.at_rate]).sum(-1)
        terms[:, 2] = (x[:, self.at_n2] * at.motion.a[:, independent]).sum(-1)
        if self.torque_is_state:
            n3 = x[:, self.at_n3]
            terms[:, 3] = -(n3 * n3) @ (1.0 / self.rate_weights)
        return terms
