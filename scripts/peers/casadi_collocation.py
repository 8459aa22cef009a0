"""Direct collocation in CasADi with explicit torques, laid out for IPOPT and for fatrop.

On every interval the accelerations are a polynomial through d Gauss points; positions and
velocities follow by exact integration. At the points torques are inverse dynamics of motion and
wrench, and the hands' accelerations agree. Where torques are states, their rates are a polynomial
of the same kind. The order is that of Gauss collocation, 2d; Hessians are exact.
"""

from __future__ import annotations

import contextlib
import tempfile
import time
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from peers.casadi_dynamics import Dynamics, make_dynamics
from peers.casadi_scheme import Answer, Scheme, SolverName, make_gauss, solver_options
from peers.task import Start, Task, Terminal


@dataclass(eq=False)
class _Program:
    """Variables and constraints in the order in which they are written down, stage by stage."""

    scalar: bool
    variables: list = field(default_factory=list)
    first: list = field(default_factory=list)
    rows: list = field(default_factory=list)
    cost: Any = 0.0

    def new(self, name: str, guess: np.ndarray) -> Any:
        """Returns a new variable shaped like its guess."""
        kind = ca.SX if self.scalar else ca.MX
        symbol = kind.sym(name, *guess.shape)
        self.variables.append(ca.vec(symbol))
        self.first.append(guess.ravel(order="F"))
        return symbol

    def vanish(self, *rows: Any) -> None:
        """Demands that rows are zero."""
        self.rows.extend(ca.vec(row) for row in rows)


class Collocation:
    """A problem transcribed for one solver, ready to be solved from the straight line."""

    def __init__(
        self,
        task: Task,
        scheme: Scheme,
        solver: SolverName,
        *,
        tolerance: float = 1e-6,
        options: dict[str, Any] | None = None,
        compiled: str = "",
    ) -> None:
        """Builds it.

        Args:
            task: The problem.
            scheme: How it is transcribed.
            solver: Which solver.
            tolerance: The solver's.
            options: More options for it.
            compiled: Compiler flags, e.g. "-O2": the functions are then generated as C and
                compiled, which counts as building.
        """
        self.task, self.scheme = task, scheme
        self.gauss = make_gauss(scheme.degree)
        began = time.perf_counter()
        nodes, points = self._starts()
        self.guess_seconds = time.perf_counter() - began
        began = time.perf_counter()
        program = self._write(make_dynamics(task), nodes, points)
        self.first = np.concatenate(program.first)
        rows = ca.vertcat(*program.rows)
        problem = {"x": ca.vertcat(*program.variables), "f": program.cost, "g": rows}
        given = solver_options(solver, tolerance, scheme, rows.numel()) | (options or {})
        if compiled:
            given |= {"jit": True, "jit_cleanup": False, "compiler": "shell"}
            given["jit_options"] = {"flags": [compiled], "cleanup": False}
        with contextlib.ExitStack() as stack:
            if compiled:  # generated code is written to the current folder
                folder = stack.enter_context(tempfile.TemporaryDirectory())
                stack.enter_context(contextlib.chdir(folder))
            self.function = ca.nlpsol("peer", solver, problem, given)
        self.build_seconds = time.perf_counter() - began
        self.rows = rows.numel()

    def solve(self) -> Answer:
        """Returns the solution from the straight line."""
        began = time.perf_counter()
        found = self.function(x0=self.first, lbg=0.0, ubg=0.0)
        seconds = time.perf_counter() - began
        stats = self.function.stats()
        return Answer(
            cost=float(found["f"]),
            iterations=int(stats.get("iter_count", -1)),
            solved=bool(stats["success"]),
            status=str(stats["return_status"]),
            variables=len(self.first),
            build=self.build_seconds,
            solve=seconds,
            guess=self.guess_seconds,
            x=np.array(found["x"]).ravel(),
        )

    # ---- the problem ---------------------------------------------------------------------------

    def _starts(self) -> tuple[Start, Start]:
        """Returns the guess at the nodes and at the points."""
        k, width = self.scheme.intervals, self.task.duration / self.scheme.intervals
        nodes = np.arange(k + 1) * width
        points = (np.arange(k)[:, None] + self.gauss.points).ravel() * width
        return self.task.first_guess(nodes), self.task.first_guess(points)

    def _write(self, dynamics: Dynamics, nodes: Start, points: Start) -> _Program:
        """Writes variables and constraints stage by stage: gap to the next stage, then the rest."""
        task, n = self.task, self.task.chain.n
        program = _Program(self.scheme.scalar)
        change = task.rate_weights is not None
        wrench = list(dynamics.wrench)
        last = self.scheme.intervals
        state = self._state(program, nodes, 0, change, points.wrench[0, wrench])
        for k in range(last):
            first_rows = []
            if k == 0:
                first_rows = self._end(dynamics, task.start, dynamics.start, state, last=False)
            place = slice(k * self.scheme.degree, (k + 1) * self.scheme.degree)
            local = Start(*(getattr(points, name)[place] for name in Start.__dataclass_fields__))
            path, following = self._interval(program, dynamics, local, state)
            more = None
            if k == last - 1 and task.goal.rest and change:
                # the internal wrench at the goal: chosen in the last interval, kept as a state
                more = program.new("goal_wrench", local.wrench[-1, wrench])
                following = ca.vertcat(following, more)
            held = points.wrench[-1, wrench] if more is not None else None
            state = self._state(program, nodes, k + 1, change, points.wrench[0, wrench], held)
            program.vanish(state - following, *first_rows, *path)
        program.vanish(*self._end(dynamics, task.goal, dynamics.goal, state, last=True))
        assert state.shape[0] >= 2 * n
        return program

    def _state(
        self,
        program: _Program,
        nodes: Start,
        k: int,
        change: bool,
        wrench: np.ndarray,
        held: np.ndarray | None = None,
    ) -> Any:
        """Returns the state of node k: positions, velocities, torques where they are states."""
        parts = [nodes.q[k], nodes.v[k]]
        if change:
            parts.append(nodes.tau[k])
        if k == 0 and change and self.task.start.rest:
            parts.append(wrench)
        if held is not None:
            parts.append(held)
        return program.new(f"x{k}", np.concatenate(parts))

    def _interval(
        self, program: _Program, dynamics: Dynamics, guess: Start, state: Any
    ) -> tuple[list[Any], Any]:
        """Adds the variables and the cost of one interval; returns its rows and what follows it."""
        task, scheme, gauss = self.task, self.scheme, self.gauss
        n, d, width = task.chain.n, scheme.degree, task.duration / scheme.intervals
        q, v = state[:n], state[n : 2 * n]
        a = program.new("a", guess.a.T)
        wrench = program.new("wrench", guess.wrench[:, list(dynamics.wrench)].T)
        at_v = ca.repmat(v, 1, d) + width * a @ gauss.once
        at_q = ca.repmat(q, 1, d) + width * v @ gauss.points[None] + width**2 * a @ gauss.twice
        following = [q + width * v + width**2 * a @ gauss.twice_end, v + width * a @ gauss.once_end]
        rows = []
        if scheme.lifted:
            lifted_q, lifted_v = program.new("q", guess.q.T), program.new("v", guess.v.T)
            rows += [at_q - lifted_q, at_v - lifted_v]
            at_q, at_v = lifted_q, lifted_v
        if scheme.scalar:
            each = [dynamics.point(at_q[:, j], at_v[:, j], a[:, j], wrench[:, j]) for j in range(d)]
            tau, closure = (ca.horzcat(*part) for part in zip(*each, strict=True))
        else:
            tau, closure = dynamics.point.map(d)(at_q, at_v, a, wrench)
        rows.append(closure)
        if task.rate_weights is not None:
            rate = program.new("u", guess.tau_rate.T)
            at_node = state[2 * n : 3 * n]
            at_point = ca.repmat(at_node, 1, d) + width * rate @ gauss.once
            rows.append(tau - at_point)
            following.append(at_node + width * rate @ gauss.once_end)
            tau = at_point
            program.cost += _quadrature(rate, task.rate_weights, width * gauss.weights)
        else:
            explicit = program.new("tau", guess.tau.T)
            rows.append(tau - explicit)
            tau = explicit
        program.cost += _quadrature(tau, task.torque_weights, width * gauss.weights)
        program.cost += _quadrature(at_v, np.full(n, task.speed_cost), width * gauss.weights)
        away = at_q - ca.repmat(ca.DM(task.reference), 1, d)
        program.cost += _quadrature(away, np.full(n, task.posture_cost), width * gauss.weights)
        return rows, ca.vertcat(*following)

    def _end(
        self, dynamics: Dynamics, end: Terminal, pose: ca.Function, state: Any, *, last: bool
    ) -> list[Any]:
        """Returns the rows of one end.

        At the goal closure and its rate hold already, up to the error of the collocation: only the
        independent joints are stopped there, and only the left hand is placed.
        """
        task, n = self.task, self.task.chain.n
        q, v = state[:n], state[n : 2 * n]
        if last:
            rows = [pose(q), v[[int(joint) for joint in task.transport.joints.independent]]]
        elif end.posture is not None:
            rows = [q - end.posture, v]
        else:
            rows = [dynamics.gap(q), pose(q), v]
        if task.rate_weights is None:
            return rows
        tau = state[2 * n : 3 * n]
        if end.torque is not None:
            rows.append(tau - end.torque)
        elif end.rest:
            zero = np.zeros(n)
            rows.append(dynamics.point(q, zero, zero, state[3 * n :])[0] - tau)
        return rows


def _quadrature(values: Any, weights: np.ndarray, measure: np.ndarray) -> Any:
    """Returns half the integral of weighted squares of the columns."""
    if not np.any(weights):
        return 0.0
    return 0.5 * ca.sum2(ca.sum1(ca.DM(np.outer(weights, measure)) * values**2))
