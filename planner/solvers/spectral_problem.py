"""The criterion as a function of polynomial coefficients, with first and second derivatives."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from planner.boundary_conditions import EndConditions
from planner.constrained_dynamics import accelerate, inertial, tangent
from planner.criteria.base import Criterion
from planner.criteria.curvature import STEP, join_tangents
from planner.independent_joints import Coordinates
from planner.inverse_kinematics import pose_error
from planner.solvers.basis import Basis, basis_at_nodes, gauss_nodes, make_basis
from planner.solvers.inverse_torques import Torques, inverse_torques
from planner.transport import Transport
from planner.vectors import matvec, transpose

_SMOOTH_MOTION = 3  # torque rates follow the third derivative of the motion
_SMOOTH_FORCE = 1
_OVERSAMPLING = 1.7
_XI_STEP = 1e-5


@dataclass(frozen=True, eq=False)
class EndValues:
    """What the polynomials take at one end.

    Attributes:
        y: Independent joints, (p,).
        rate: Their rates, (p,) [rad/s].
        acceleration: Their accelerations where the end fixes them, (p,), else None.
        multiplier: lambda where the end fixes it, (m,), else None.
    """

    y: np.ndarray
    rate: np.ndarray
    acceleration: np.ndarray | None
    multiplier: np.ndarray | None

    def motion(self, duration: float) -> list[np.ndarray]:
        """Returns value, slope and second derivative per share of the duration."""
        values = [self.y, duration * self.rate]
        if self.acceleration is not None:
            values.append(duration**2 * self.acceleration)
        return values


@dataclass(frozen=True, eq=False)
class Curves:
    """A motion and multiplier as polynomials of the share of the duration.

    Attributes:
        motion: Legendre coefficients of y, (degree + 1, p).
        force: Legendre coefficients of lambda, (degree + 1, m).
    """

    motion: np.ndarray
    force: np.ndarray

    def y(self, share: np.ndarray, order: int = 0) -> np.ndarray:
        """Returns y's derivative of some order in the share, (K, p)."""
        return _evaluate(self.motion, share, order)

    def multiplier(self, share: np.ndarray, order: int = 0) -> np.ndarray:
        """Returns lambda's derivative of some order in the share, (K, m)."""
        return _evaluate(self.force, share, order)


def _evaluate(coefficients: np.ndarray, share: np.ndarray, order: int) -> np.ndarray:
    if order:
        coefficients = 2.0**order * np.polynomial.legendre.legder(coefficients, order, axis=0)
    values: np.ndarray = np.polynomial.legendre.legval(2.0 * share - 1.0, coefficients).T
    return values


@dataclass(eq=False)
class Point:
    """One iterate: coefficients, torques at the nodes, residual and cost."""

    x: np.ndarray
    ends: tuple[EndValues, EndValues]
    torques: Torques
    rate: np.ndarray
    acceleration: np.ndarray
    multiplier: np.ndarray
    slope: np.ndarray
    cost: float


class SpectralProblem:
    """The minimisation at one degree.

    Attributes:
        transport: The motion asked for.
        criterion: What is minimised.
        coordinates: Map from independent joints to closed postures.
        degree: Degree of the polynomials.
    """

    def __init__(
        self,
        transport: Transport,
        criterion: Criterion,
        coordinates: Coordinates,
        degree: int,
    ) -> None:
        self.transport = transport
        self.criterion = criterion
        self.coordinates = coordinates
        self.degree = degree
        chain = transport.chain
        self.p, self.m, self.n = chain.p, chain.m, chain.n
        parts = transport, criterion, coordinates
        self.conditions = (
            EndConditions(*parts, transport.start),
            EndConditions(*parts, transport.goal),
        )
        count = int(np.ceil(_OVERSAMPLING * degree))
        self.nodes = gauss_nodes(count)
        motion_ends, force_ends = self._ends_prescribed()
        self.motion_basis: Basis = make_basis(degree, *motion_ends, _SMOOTH_MOTION)
        self.force_basis: Basis = make_basis(degree - 2, *force_ends, _SMOOTH_FORCE)
        self.phi = basis_at_nodes(degree, *motion_ends, _SMOOTH_MOTION, count, 3)
        self.psi = basis_at_nodes(degree - 2, *force_ends, _SMOOTH_FORCE, count, 1)[0]
        self._nulls = tuple(
            np.zeros((self.p, 0)) if end.end.held else end._null_guess for end in self.conditions
        )

    def _ends_prescribed(self) -> tuple[tuple[int, int], tuple[int, int]]:
        """Returns how many values motion and multiplier take at start and goal."""
        motion, force = [], []
        for end in self.conditions:
            rule = end.end.torque_rule if self.criterion.torque_is_state else "free"
            motion.append(2 if rule == "free" else 3)
            force.append(0 if rule in ("free", "rest") else 1)
        return (motion[0], motion[1]), (force[0], force[1])

    # ---- places of the unknowns ------------------------------------------------------------------

    @cached_property
    def _sizes(self) -> tuple[int, int, int, int]:
        return (
            self.motion_basis.free * self.p,
            self.force_basis.free * self.m,
            self._nulls[0].shape[1],
            self._nulls[1].shape[1],
        )

    @cached_property
    def places(self) -> tuple[slice, slice, slice, slice]:
        """Places of the motion's and the force's coefficients and of the ends' free postures."""
        edges = np.concatenate([[0], np.cumsum(self._sizes)])
        a, b, c, d = (
            slice(int(low), int(high)) for low, high in zip(edges[:-1], edges[1:], strict=True)
        )
        return a, b, c, d

    @property
    def size(self) -> int:
        """Number of unknowns."""
        return sum(self._sizes)

    @cached_property
    def motion(self) -> np.ndarray:
        """Indices of the unknowns that move the arms, those of the ends' postures included."""
        return np.r_[self.places[0], self.places[2], self.places[3]]

    @cached_property
    def force(self) -> np.ndarray:
        """Indices of the multiplier's unknowns."""
        return np.r_[self.places[1]]

    def metric(self, point: Point) -> np.ndarray:
        """Returns the root M of a norm on the motion's unknowns: |M d| is the change of joint
        speeds that a step d makes, root mean square in rad per duration."""
        whole = self._unknowns_to_motion(point)[:, self.p : 2 * self.p, self.motion]
        speeds = point.torques.tangent.s @ whole * self.transport.duration
        rows = (speeds * np.sqrt(self.nodes.weights)[:, None, None]).reshape(-1, len(self.motion))
        square = rows.T @ rows
        square[np.diag_indices_from(square)] += 1e-10 * np.max(np.diag(square))
        root: np.ndarray = np.linalg.cholesky(square).T
        return root

    # ---- ends --------------------------------------------------------------------------------------

    def end_values(self, index: int, y: np.ndarray) -> list[EndValues]:
        """Returns what the polynomials take at an end whose postures are y, (K, p)."""
        end = self.conditions[index]
        chain, joints = self.transport.chain, self.transport.joints
        at, _ = self.coordinates.tangent(np.full(len(y), end.share), y)
        rate = np.broadcast_to(end.rate, y.shape)
        rule = end.end.torque_rule if self.criterion.torque_is_state else "free"
        if rule == "free":
            return [EndValues(row, end.rate, None, None) for row in y]
        if rule == "rest":
            return [EndValues(row, end.rate, np.zeros(self.p), None) for row in y]
        tau = end.prescribed_torque(at)
        assert tau is not None
        v = matvec(at.s, rate)
        motion = accelerate(joints, at, v, inertial(chain, joints, at, v), tau)
        accelerations = motion.a[:, joints.independent]
        return [
            EndValues(y[k], end.rate, accelerations[k], motion.multiplier[k]) for k in range(len(y))
        ]

    def retract(self, index: int, y: np.ndarray) -> np.ndarray:
        """Returns postures y, (K, p), moved back to where the object is as prescribed."""
        end = self.conditions[index]
        chain = self.transport.chain
        rows = end._task_rows
        for _ in range(8):
            at, _ = self.coordinates.tangent(np.full(len(y), end.share), y)
            error = pose_error(chain, at.at, end.end.pose.position, end.end.pose.rotation)
            off = error @ rows[:, : error.shape[1]].T
            if np.max(np.abs(off)) < 1e-13:
                break
            jacobian = rows @ chain.object_jacobian(at.at) @ at.s
            y = y - matvec(np.linalg.pinv(jacobian), off)
        return y

    def _end_slopes(self, index: int, values: EndValues) -> tuple[np.ndarray, np.ndarray]:
        """Returns derivatives of the end's values along its free postures.

        Shapes (values of the motion, p, free) and (values of the force, m, free).
        """
        null = self.null(index, values.y)
        moved = np.concatenate([values.y + _XI_STEP * null.T, values.y - _XI_STEP * null.T])
        found = self.end_values(index, self.retract(index, moved))
        free = null.shape[1]
        motions = np.array([value.motion(self.transport.duration) for value in found])
        motion = (motions[:free] - motions[free:]) / (2.0 * _XI_STEP)
        force = np.zeros((0, self.m, free))
        if values.multiplier is not None:
            forces = np.array([value.multiplier for value in found])
            force = ((forces[:free] - forces[free:]) / (2.0 * _XI_STEP)).T[None]
        return motion.transpose(1, 2, 0), force

    def null(self, index: int, y: np.ndarray) -> np.ndarray:
        """Returns motions of y that leave the object where the end prescribes it, (p, free)."""
        end = self.conditions[index]
        chain = self.transport.chain
        at, _ = self.coordinates.tangent(np.array([end.share]), y[None])
        jacobian = end._task_rows @ chain.object_jacobian(at.at)[0] @ at.s[0]
        guess = self._nulls[index]
        projected = guess - np.linalg.pinv(jacobian) @ (jacobian @ guess)
        orthonormal: np.ndarray = np.linalg.qr(projected)[0] if guess.size else projected
        return orthonormal

    # ---- evaluation ----------------------------------------------------------------------------------

    def _carried(self, ends: tuple[EndValues, EndValues]) -> tuple[np.ndarray, np.ndarray]:
        duration = self.transport.duration
        motion = np.array([*ends[0].motion(duration), *ends[1].motion(duration)])
        forces = [end.multiplier for end in ends if end.multiplier is not None]
        return motion, np.array(forces).reshape(len(forces), self.m)

    def coefficients(
        self, x: np.ndarray, ends: tuple[EndValues, EndValues]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns all coefficients of motion and force on their bases."""
        motion, force = self._carried(ends)
        places = self.places
        return (
            np.vstack([motion, x[places[0]].reshape(-1, self.p)]),
            np.vstack([force, x[places[1]].reshape(-1, self.m)]),
        )

    def evaluate(
        self, x: np.ndarray, ends: tuple[EndValues, EndValues], guess: np.ndarray | None = None
    ) -> Point | None:
        """Returns the iterate with coefficients x; None where the chain cannot be closed.

        Args:
            x: Unknowns; those of the ends' postures are already in `ends`.
            ends: Values at the ends.
            guess: Postures near those at the nodes, (K, N), from which closure is sought.
        """
        duration = self.transport.duration
        motion, force = self.coefficients(x, ends)
        y = self.phi[0] @ motion
        rate = self.phi[1] @ motion / duration
        acceleration = self.phi[2] @ motion / duration**2
        multiplier = self.psi @ force
        chain, joints = self.transport.chain, self.transport.joints
        if guess is None:
            q, at, closed = self.coordinates.close(self.nodes.u, y)
        else:
            guess = guess.copy()
            guess[:, joints.independent] = y
            q, at, closed = chain.close(guess, joints.dependent)
        if not closed.all():
            return None
        freedoms = tangent(chain, joints, q, at)
        torques = inverse_torques(chain, joints, freedoms, rate, acceleration, multiplier)
        slope = self.nodes.derivative @ torques.tau / duration
        cost = self._cost(torques, slope)
        if not np.isfinite(cost):
            return None
        return Point(x, ends, torques, rate, acceleration, multiplier, slope, cost)

    def _cost(self, torques: Torques, slope: np.ndarray) -> float:
        criterion = self.criterion
        running = 0.5 * (torques.tau**2) @ criterion.torque_weights
        if criterion.torque_is_state:
            running = running + 0.5 * (slope**2) @ criterion.rate_weights
        if criterion.state_cost is not None:
            running = running + criterion.state_cost.value(torques.tangent.q, torques.v)
        return float(self.nodes.weights @ running) * self.transport.duration

    def _design(self, point: Point) -> np.ndarray:
        """Returns how torques at the nodes depend on the unknowns, (K, N, size)."""
        duration, torques = self.transport.duration, point.torques
        count = len(self.nodes.u)
        blocks = (
            torques.along_y,
            torques.along_rate / duration,
            torques.along_acceleration / duration**2,
        )
        all_motion = sum(
            phi[:, None, :, None] * block[:, :, None, :]
            for phi, block in zip(self.phi, blocks, strict=True)
        )
        all_force = self.psi[:, None, :, None] * torques.along_multiplier[:, :, None, :]
        skip, skip_force = self.motion_basis.conditions, self.force_basis.conditions
        design = np.empty((count, self.n, self.size))
        places = self.places
        design[:, :, places[0]] = all_motion[:, :, skip:].reshape(count, self.n, -1)
        design[:, :, places[1]] = all_force[:, :, skip_force:].reshape(count, self.n, -1)
        for index, place in ((0, places[2]), (1, places[3])):
            if place.start == place.stop:
                continue
            motion, force = self._end_slopes(index, point.ends[index])
            rows = self._rows_of_end(index, self.motion_basis)
            design[:, :, place] = np.einsum("knap,apf->knf", all_motion[:, :, rows], motion)
            if len(force):
                rows = self._rows_of_end(index, self.force_basis)
                design[:, :, place] += np.einsum("knam,amf->knf", all_force[:, :, rows], force)
        return design

    @staticmethod
    def _rows_of_end(index: int, basis: Basis) -> slice:
        return slice(0, basis.ends[0]) if index == 0 else slice(basis.ends[0], basis.conditions)

    def normal_equations(self, point: Point) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Returns gradient, Gauss-Newton matrix, and the cost's derivative along the torques.

        Shapes (size,), (size, size), (K, N).
        """
        criterion, duration = self.criterion, self.transport.duration
        design = self._design(point)
        count = len(self.nodes.u)
        flat = design.reshape(count, -1)
        weight = self.nodes.weights[:, None] * duration
        matrix = np.zeros((self.size, self.size))
        along_torque = np.zeros((count, self.n))
        if criterion.torque_is_state:
            root = np.sqrt(weight * criterion.rate_weights)
            slopes = (self.nodes.derivative / duration) @ flat
            rows = (slopes.reshape(count, self.n, -1) * root[..., None]).reshape(-1, self.size)
            matrix += rows.T @ rows
            along_torque += (self.nodes.derivative.T / duration) @ (root**2 * point.slope)
        if np.any(criterion.torque_weights):
            root = np.sqrt(weight * criterion.torque_weights)
            rows = (design * root[..., None]).reshape(-1, self.size)
            matrix += rows.T @ rows
            along_torque += root**2 * point.torques.tau
        gradient = along_torque.ravel() @ design.reshape(-1, self.size)
        for value, derivative, factor in self._state_rows(point):
            rows = derivative.reshape(-1, self.size)
            scaled = factor * np.repeat(weight[:, 0], self.n)
            matrix += rows.T @ (scaled[:, None] * rows)
            gradient = gradient + (scaled * value.ravel()) @ rows
        return gradient, matrix, along_torque

    def _state_rows(self, point: Point) -> list[tuple[np.ndarray, np.ndarray, float]]:
        """Returns state costs as (value, derivative along the unknowns, weight)."""
        cost, torques = self.criterion.state_cost, point.torques
        if cost is None:
            return []
        whole = self._unknowns_to_motion(point)
        y, rate = whole[:, : self.p], whole[:, self.p : 2 * self.p]
        s = torques.tangent.s
        return [
            (torques.v, torques.drag @ y + s @ rate, cost.speed),
            (torques.tangent.q - cost.reference, s @ y, cost.posture),
        ]

    def _unknowns_to_motion(self, point: Point) -> np.ndarray:
        """Returns how (y, dy/dt, d2y/dt2, lambda) at the nodes depend on the unknowns.

        Shape (K, 3 p + m, size).
        """
        duration, count = self.transport.duration, len(self.nodes.u)
        result = np.zeros((count, 3 * self.p + self.m, self.size))
        skip, skip_force = self.motion_basis.conditions, self.force_basis.conditions
        places, p = self.places, self.p
        for order, phi in enumerate(self.phi):
            part = np.einsum("kc,ij->kicj", phi[:, skip:], np.eye(p)) / duration**order
            result[:, order * p : (order + 1) * p, places[0]] = part.reshape(count, p, -1)
        part = np.einsum("kc,ij->kicj", self.psi[:, skip_force:], np.eye(self.m))
        result[:, 3 * p :, places[1]] = part.reshape(count, self.m, -1)
        for index, place in ((0, places[2]), (1, places[3])):
            if place.start == place.stop:
                continue
            motion, force = self._end_slopes(index, point.ends[index])
            rows = self._rows_of_end(index, self.motion_basis)
            for order, phi in enumerate(self.phi):
                part = np.einsum("ka,apf->kpf", phi[:, rows], motion) / duration**order
                result[:, order * p : (order + 1) * p, place] = part
            if len(force):
                rows = self._rows_of_end(index, self.force_basis)
                result[:, 3 * p :, place] = np.einsum("ka,amf->kmf", self.psi[:, rows], force)
        return result

    def _contraction(
        self, torques: Torques, along_torque: np.ndarray, weight: np.ndarray
    ) -> np.ndarray:
        """Returns the gradient along (y, dy/dt, d2y/dt2, lambda) at samples, (K, 3 p + m)."""
        parts = [
            matvec(transpose(part), along_torque)
            for part in (
                torques.along_y,
                torques.along_rate,
                torques.along_acceleration,
                torques.along_multiplier,
            )
        ]
        cost = self.criterion.state_cost
        if cost is not None:
            s = torques.tangent.s
            speed = weight * cost.speed * torques.v
            away = weight * cost.posture * (torques.tangent.q - cost.reference)
            parts[0] += matvec(transpose(torques.drag), speed) + matvec(transpose(s), away)
            parts[1] += matvec(transpose(s), speed)
        return np.concatenate(parts, axis=1)

    def curvature(self, point: Point, along_torque: np.ndarray) -> np.ndarray:
        """Returns what the torques' second derivatives add to the Gauss-Newton matrix.

        One difference along each independent joint, and an exact one along each rate: torques are
        quadratic in the rates and linear in accelerations and multiplier.
        """
        chain, joints = self.transport.chain, self.transport.joints
        p, count = self.p, len(self.nodes.u)
        base = point.torques.tangent
        moved = base.q[None] + STEP * base.s.transpose(2, 0, 1)
        moved = moved.reshape(p * count, self.n)
        there = tangent(chain, joints, moved, chain.dynamics.placements(moved))
        at = join_tangents(there, base, p)
        rates = np.broadcast_to(point.rate, (2, p, count, p)).copy()
        rate_step = 1.0 / self.transport.duration
        for joint in range(p):
            rates[1, joint, :, joint] += rate_step

        def repeat(values: np.ndarray) -> np.ndarray:
            return np.tile(values, (2 * p, 1))

        torques = inverse_torques(
            chain,
            joints,
            at,
            rates.reshape(-1, p),
            repeat(point.acceleration),
            repeat(point.multiplier),
        )
        weight = self.nodes.weights[:, None] * self.transport.duration
        gradients = self._contraction(torques, repeat(along_torque), repeat(weight))
        old = self._contraction(point.torques, along_torque, weight)
        change = gradients.reshape(2, p, count, -1) - old
        size = 3 * p + self.m
        second = np.zeros((count, size, size))
        along_y = change[0].transpose(1, 2, 0) / STEP
        second[:, :, :p] = along_y
        second[:, :p, :] = transpose(along_y)
        second[:, :p, :p] = 0.5 * (along_y[:, :p] + transpose(along_y[:, :p]))
        along_rate = change[1][:, :, p : 2 * p].transpose(1, 2, 0) / rate_step
        second[:, p : 2 * p, p : 2 * p] = 0.5 * (along_rate + transpose(along_rate))
        cost = self.criterion.state_cost
        if cost is not None:  # its Gauss-Newton part is in the normal equations already
            s, drag = base.s, point.torques.drag
            both = np.concatenate([drag, s], axis=2)
            second[:, : 2 * p, : 2 * p] -= cost.speed * weight[..., None] * transpose(both) @ both
            second[:, :p, :p] -= cost.posture * weight[..., None] * transpose(s) @ s
        whole = self._unknowns_to_motion(point)
        result = np.tensordot(whole, second @ whole, axes=((0, 1), (0, 1)))
        for index, place in ((0, self.places[2]), (1, self.places[3])):
            if place.start != place.stop:
                result[place, place] += self._end_curvature(index, point, old)
        return result

    def _end_curvature(self, index: int, point: Point, gradient: np.ndarray) -> np.ndarray:
        """Returns the curvature of the set of allowed end postures, (free, free)."""
        duration, p = self.transport.duration, self.p
        values = point.ends[index]
        null = self.null(index, values.y)
        free = null.shape[1]
        rows = self._rows_of_end(index, self.motion_basis)
        along = sum(
            (phi[:, rows].T @ gradient[:, order * p : (order + 1) * p]) / duration**order
            for order, phi in enumerate(self.phi)
        )
        force_rows = self._rows_of_end(index, self.force_basis)
        along_force = self.psi[:, force_rows].T @ gradient[:, 3 * p :]
        pairs = [
            (i, j, a, b)
            for i in range(free)
            for j in range(i + 1)
            for a in (1, -1)
            for b in (1, -1)
        ]
        step = 10.0 * np.sqrt(_XI_STEP) * 1e-2
        moves = np.array([step * (a * null[:, i] + b * null[:, j]) for i, j, a, b in pairs])
        found = self.end_values(index, self.retract(index, values.y + moves))
        height = np.array(
            [
                float(np.sum(along * np.array(value.motion(duration))))
                + (0.0 if value.multiplier is None else float(along_force[0] @ value.multiplier))
                for value in found
            ]
        )
        result = np.zeros((free, free))
        for (i, j, a, b), value in zip(pairs, height, strict=True):
            result[i, j] += a * b * value / (4.0 * step**2)
        lower = np.tril(result, -1)
        return lower + lower.T + np.diag(np.diag(result))

    def curves(self, point: Point) -> Curves:
        """Returns the iterate's polynomials."""
        motion, force = self.coefficients(point.x, point.ends)
        return Curves(
            self.motion_basis.coefficients @ motion, self.force_basis.coefficients @ force
        )

    def project(
        self, ends: tuple[EndValues, EndValues], y: np.ndarray, multiplier: np.ndarray | None
    ) -> np.ndarray:
        """Returns the unknowns nearest to a motion, (K, p), and multiplier, (K, m), at the nodes."""
        motion, force = self._carried(ends)
        root = np.sqrt(self.nodes.weights)[:, None]
        places, result = self.places, np.zeros(self.size)
        skip = len(motion)
        rest = root * (y - self.phi[0][:, :skip] @ motion)
        found = np.linalg.lstsq(root * self.phi[0][:, skip:], rest, rcond=None)[0]
        result[places[0]] = found.ravel()
        if multiplier is not None:
            skip = len(force)
            rest = root * (multiplier - self.psi[:, :skip] @ force)
            found = np.linalg.lstsq(root * self.psi[:, skip:], rest, rcond=None)[0]
            result[places[1]] = found.ravel()
        return result

    def moved(self, point: Point, move: np.ndarray) -> Point | None:
        """Returns the iterate after a step in the unknowns; None where it cannot be closed."""
        ends = []
        for index, place in ((0, self.places[2]), (1, self.places[3])):
            values = point.ends[index]
            if place.start != place.stop:
                y = values.y + self.null(index, values.y) @ move[place]
                with np.errstate(all="ignore"):
                    y = self.retract(index, y[None])
                    if not np.all(np.isfinite(y)):
                        return None
                    values = self.end_values(index, y)[0]
            ends.append(values)
        with np.errstate(all="ignore"):
            return self.evaluate(point.x + move, (ends[0], ends[1]), point.torques.tangent.q)
