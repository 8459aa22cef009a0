"""The criterion as a function of polynomial coefficients, and how quantities depend on them."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import pairwise

import numpy as np

from planner.chain import CLOSURE_TOLERANCE
from planner.constrained_dynamics import Tangent, tangent
from planner.criteria.base import Criterion
from planner.independent_joints import Coordinates
from planner.solvers.basis import Basis, basis_at_nodes, gauss_nodes, make_basis
from planner.solvers.curves import Curves
from planner.solvers.inverse_torques import Torques, inverse_torques
from planner.solvers.spectral_ends import Ends, EndValues
from planner.transport import Transport

_SMOOTH_MOTION = 3  # torque rates follow the third derivative of the motion
_SMOOTH_FORCE = 1
_OVERSAMPLING = 1.7
ROUGHLY_CLOSED = 1e-8  # m, rad: while the motion changes; what is left, the next step takes along


@dataclass(eq=False)
class Point:
    """One iterate: coefficients, torques at the nodes, residual and cost."""

    x: np.ndarray
    ends: tuple[EndValues, EndValues]
    torques: Torques
    rate: np.ndarray
    acceleration: np.ndarray
    slope: np.ndarray
    cost: float
    design: np.ndarray | None = None


class SpectralProblem:
    """The minimisation at one degree.

    Attributes:
        transport: The motion asked for.
        criterion: What is minimised.
        coordinates: Map from independent joints to closed postures.
        degree: Degree of the polynomials.
        phi: The motion's basis and its first two derivatives in time at the nodes, (3, K, .).
        psi: The multiplier's basis there, (K, .).
        derivative: Differentiation in time at the nodes, (K, K).
    """

    def __init__(
        self,
        transport: Transport,
        criterion: Criterion,
        coordinates: Coordinates,
        degree: int,
        ends: Ends | None = None,
    ) -> None:
        """Takes the ends of a problem of another degree, if there is one."""
        self.transport = transport
        self.criterion = criterion
        self.coordinates = coordinates
        self.degree = degree
        chain = transport.chain
        self.p, self.m, self.n = chain.p, chain.m, chain.n
        self.ends = ends or Ends(transport, criterion, coordinates)
        count = int(np.ceil(_OVERSAMPLING * degree))
        self.nodes = gauss_nodes(count)
        motion_ends, force_ends = self.ends.prescribed()
        self.motion_basis: Basis = make_basis(degree, *motion_ends, _SMOOTH_MOTION)
        self.force_basis: Basis = make_basis(degree - 2, *force_ends, _SMOOTH_FORCE)
        phi = basis_at_nodes(*self.motion_basis.key, count, 3)
        self.psi = basis_at_nodes(*self.force_basis.key, count, 1)[0]
        units = np.array([1.0, transport.duration, transport.duration**2])
        self.phi = phi / units[:, None, None]
        self.derivative = self.nodes.derivative / transport.duration
        self._known_ends: tuple[EndValues, EndValues] | None = None
        self._at_nodes: tuple[np.ndarray, np.ndarray]

    # ---- places of the unknowns ------------------------------------------------------------------

    @cached_property
    def places(self) -> tuple[slice, slice, slice, slice]:
        """Places of the motion's and the force's coefficients and of the ends' free postures."""
        start, goal = (null.shape[1] for null in self.ends.null_guess)
        sizes = self.motion_basis.free * self.p, start, goal, self.force_basis.free * self.m
        edges = np.concatenate([[0], np.cumsum(sizes)])
        motion, first, last, force = (slice(int(low), int(high)) for low, high in pairwise(edges))
        return motion, force, first, last

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return self.places[1].stop

    @property
    def motion(self) -> slice:
        """Places of the unknowns that move the arms, those of the ends' postures included."""
        return slice(0, self.places[3].stop)

    @property
    def force(self) -> slice:
        """Places of the multiplier's unknowns."""
        return self.places[1]

    # ---- evaluation ------------------------------------------------------------------------------

    def carried(self, ends: tuple[EndValues, EndValues]) -> tuple[np.ndarray, np.ndarray]:
        """Returns what motion and multiplier take at the ends, start first."""
        return (
            np.concatenate([end.motion for end in ends]),
            np.concatenate([end.force for end in ends]),
        )

    def _carried_at_nodes(self, ends: tuple[EndValues, EndValues]) -> tuple[np.ndarray, np.ndarray]:
        """Returns what the ends add to the motion, (3, K, p), and to the multiplier, (K, m)."""
        known = self._known_ends
        if known is None or known[0] is not ends[0] or known[1] is not ends[1]:
            motion, force = self.carried(ends)
            self._known_ends = ends
            self._at_nodes = (
                self.phi[:, :, : len(motion)] @ motion,
                self.psi[:, : len(force)] @ force,
            )
        return self._at_nodes

    def coefficients(
        self, x: np.ndarray, ends: tuple[EndValues, EndValues]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns all coefficients of motion and force on their bases."""
        motion, force = self.carried(ends)
        places = self.places
        return (
            np.vstack([motion, x[places[0]].reshape(self.p, -1).T]),
            np.vstack([force, x[places[1]].reshape(self.m, -1).T]),
        )

    def evaluate(
        self,
        x: np.ndarray,
        ends: tuple[EndValues, EndValues],
        near: Tangent | np.ndarray,
        closure: float = ROUGHLY_CLOSED,
    ) -> Point | None:
        """Returns the iterate with coefficients x; None where the chain cannot be closed.

        Args:
            x: Unknowns; those of the ends' postures are already in `ends`.
            ends: Values at the ends.
            near: Postures of a motion nearby, (K, N), or its freedoms, along which closure is
                sought.
            closure: Bound on the gap that is left [m, rad].
        """
        base, base_multiplier = self._carried_at_nodes(ends)
        places = self.places
        motion = self.phi[:, :, self.motion_basis.conditions :]
        force = self.psi[:, self.force_basis.conditions :]
        y, rate, acceleration = base + motion @ x[places[0]].reshape(self.p, -1).T
        multiplier = base_multiplier + force @ x[places[1]].reshape(self.m, -1).T
        chain, joints = self.transport.chain, self.transport.joints
        if isinstance(near, Tangent):
            guess = near.shifted(joints, y, chain.gap(near.at))
        else:
            guess = near.copy()
        guess[:, joints.independent] = y
        q, at, closed = chain.close(guess, joints.dependent, closure)
        if not closed.all():
            return None
        freedoms = tangent(chain, joints, q, at)
        torques = inverse_torques(chain, joints, freedoms, rate, acceleration, multiplier)
        slope = self.derivative @ torques.tau
        cost = self._cost(torques, slope)
        if not np.isfinite(cost):
            return None
        return Point(x, ends, torques, rate, acceleration, slope, cost)

    def closed(self, point: Point) -> Point:
        """Returns the same iterate with the hands together to the last digits."""
        at = point.torques.tangent
        if np.abs(self.transport.chain.gap(at.at)).max() < CLOSURE_TOLERANCE:
            return point
        return self.evaluate(point.x, point.ends, at, CLOSURE_TOLERANCE) or point

    def remember(self, point: Point) -> None:
        """Makes an iterate the motion near which closure is sought."""
        at = point.torques.tangent
        self.coordinates.remember(self.nodes.u, at.q, at.s)

    def _cost(self, torques: Torques, slope: np.ndarray) -> float:
        criterion = self.criterion
        running = 0.5 * (torques.tau**2) @ criterion.torque_weights
        if criterion.torque_is_state:
            running = running + 0.5 * (slope**2) @ criterion.rate_weights
        if criterion.state_cost is not None:
            running = running + criterion.state_cost.value(torques.tangent.q, torques.v)
        return float(self.nodes.weights @ running) * self.transport.duration

    @staticmethod
    def rows_of_end(index: int, basis: Basis) -> slice:
        """Returns the places of an end's values among a basis's coefficients."""
        return slice(0, basis.ends[0]) if index == 0 else slice(basis.ends[0], basis.conditions)

    @cached_property
    def weight(self) -> np.ndarray:
        """Weights of the nodes in an integral over time, (K, 1) [s]."""
        return self.nodes.weights[:, None] * self.transport.duration

    @cached_property
    def roots(self) -> tuple[np.ndarray, np.ndarray]:
        """Roots of the weights of squared torques and of squared slopes at the nodes, (K, N)."""
        criterion = self.criterion
        of_rates = criterion.rate_weights if criterion.torque_is_state else np.zeros(self.n)
        return np.sqrt(self.weight * criterion.torque_weights), np.sqrt(self.weight * of_rates)

    def curves(self, point: Point) -> Curves:
        """Returns the iterate's polynomials."""
        motion, force = self.coefficients(point.x, point.ends)
        return Curves(
            self.motion_basis.coefficients @ motion, self.force_basis.coefficients @ force
        )

    def moved(
        self, point: Point, move: np.ndarray, closure: float = ROUGHLY_CLOSED
    ) -> Point | None:
        """Returns the iterate after a step in the unknowns; None where it cannot be closed.

        Args:
            point: The iterate.
            move: The step.
            closure: Bound on the gap that is left at the nodes [m, rad].
        """
        ends = list(point.ends)
        with np.errstate(all="ignore"):
            for index, place in ((0, self.places[2]), (1, self.places[3])):
                if place.start != place.stop:
                    near = point.ends[index]
                    y = near.motion[0] + self.ends.null(index, near) @ move[place]
                    values = self.ends.values(index, near.at, y)
                    if values is None:
                        return None
                    ends[index] = values
            both = ends[0], ends[1]
            return self.evaluate(point.x + move, both, point.torques.tangent, closure)
