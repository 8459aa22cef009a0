"""Where the time of a plan goes, by wrapping the planner's own functions.

Each wrapped function belongs to a phase; time counts for the innermost phase that runs. Loops that
call Pinocchio count beside that, together with the samples that they handle.
"""

from __future__ import annotations

import contextlib
import importlib
import time
from collections import defaultdict
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pinocchio as pin

REST = "rest"
# phase: where its functions are looked up, "module:name" or "module:class.name". What a version
# of the planner has not got is skipped.
PHASES: dict[str, tuple[str, ...]] = {
    "read": ("planner.planning:build_chain",),
    "inverse kinematics, straight line": ("planner.planning:make_transport",),
    "solve: setting up and the rest": ("planner.planning:solve",),
    "solve: spectral, the rest": ("planner.solvers.search:minimise",),
    "solve: spectral evaluations": ("planner.solvers.spectral_problem:SpectralProblem.evaluate",),
    "solve: spectral derivatives": (
        "planner.solvers.descent:normal_equations",
        "planner.solvers.descent:gradient",
        "planner.solvers.descent:torque_bend",
        "planner.solvers.descent:torque_curvature",
    ),
    "solve: costates and mesh": (
        "planner.solvers.confirm:warm_start",
        "planner.solving:spectral_solution",
        "planner.solvers.confirm:spectral_solution",
    ),
    "solve: boundary value, the rest": (
        "planner.solving:solve_collocation",
        "planner.solvers.confirm:solve_collocation",
    ),
    "solve: evaluations": (
        "planner.boundary_value_problem:BoundaryValueProblem.right_side",
        "planner.boundary_value_problem:BoundaryValueProblem.boundary",
        "planner.boundary_value_problem:BoundaryValueProblem.evaluate",
    ),
    "solve: Jacobians": (
        "planner.solvers.confirm:MotionJacobian",
        "planner.solvers.warm_start:MotionJacobian.__call__",
        "planner.boundary_value_problem:BoundaryValueProblem.jacobian",
        "planner.boundary_value_problem:BoundaryValueProblem.boundary_jacobian",
    ),
    "solve: linear algebra": (
        "scipy.integrate._bvp:splu",
        "scipy.integrate._bvp:construct_global_jac",
        "planner.solvers.trust_region:QuadraticModel._newton_step",
        "planner.solvers.trust_region:reduce_model",
        "planner.solvers.trust_region:trust_region_step",
        "scipy.linalg:cho_factor",
        "scipy.linalg:cho_solve",
        "scipy.linalg:solve",
        "scipy.linalg:lstsq",
    ),
    "sampling": ("planner.planning:sample",),
    "checks": ("planner.planning:verify",),
}
LOOPS = ("placements", "inertia_and_bias", "inverse_dynamics", "inverse_dynamics_derivatives")
WITHIN: dict[str, tuple[Callable[..., Any], ...]] = {
    "placements": (pin.computeJointJacobians,),
    "inertia_and_bias": (pin.crba, pin.nonLinearEffects),
    "inverse_dynamics": (pin.rnea,),
    "inverse_dynamics_derivatives": (pin.computeRNEADerivatives,),
}
ARGUMENTS = {pin.computeJointJacobians: 1, pin.crba: 1, pin.nonLinearEffects: 2}  # else 3


@dataclass(frozen=True, eq=False)
class Calls:
    """Calls of one Pinocchio function during a plan.

    Attributes:
        function: The function.
        model: The model that it was called for.
        count: How often.
    """

    function: Callable[..., Any]
    model: pin.Model
    count: int


@dataclass(frozen=True)
class Phase:
    """Time of one phase, a plan.

    Attributes:
        name: Name.
        seconds: Without the phases inside it [s].
        pinocchio: Part of it in loops that call Pinocchio [s].
        count: How often it was entered.
    """

    name: str
    seconds: float
    pinocchio: float
    count: int


@dataclass(frozen=True, eq=False)
class Profile:
    """Mean of several plans.

    Attributes:
        phases: Phases in their order.
        calls: Calls of Pinocchio's functions.
    """

    phases: tuple[Phase, ...]
    calls: tuple[Calls, ...]


@dataclass(eq=False)
class _Watch:
    """A stopwatch whose time goes to the phase on top of the stack."""

    stack: list[str] = field(default_factory=lambda: [REST])
    since: float = field(default_factory=time.perf_counter)
    seconds: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    pinocchio: dict[str, float] = field(default_factory=lambda: defaultdict(float))
    entered: dict[str, int] = field(default_factory=lambda: defaultdict(int))
    samples: dict[tuple[str, int], int] = field(default_factory=lambda: defaultdict(int))
    models: dict[int, pin.Model] = field(default_factory=dict)

    def switch(self) -> None:
        now = time.perf_counter()
        self.seconds[self.stack[-1]] += now - self.since
        self.since = now

    def phase(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(*given: Any, **named: Any) -> Any:
            self.switch()
            self.stack.append(name)
            self.entered[name] += 1
            try:
                return function(*given, **named)
            finally:
                self.switch()
                self.stack.pop()

        return wrapped

    def loop(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def wrapped(motion: Any, q: np.ndarray, *given: Any) -> Any:
            began = time.perf_counter()
            result = function(motion, q, *given)
            self.pinocchio[self.stack[-1]] += time.perf_counter() - began
            self.models[id(motion.model)] = motion.model
            self.samples[name, id(motion.model)] += len(q)
            return result

        return wrapped


def profiled(action: Callable[[], object], runs: int) -> Profile:
    """Returns the profile of an action, the mean of some runs after one that warms up."""
    action()
    with _watching() as watch:
        watch.switch()
        watch.seconds.clear()
        for _ in range(runs):
            action()
        watch.switch()
    names = [*PHASES, REST]
    phases = tuple(
        Phase(
            name,
            watch.seconds[name] / runs,
            watch.pinocchio[name] / runs,
            round(watch.entered[name] / runs),
        )
        for name in names
        if watch.seconds[name] > 0.0
    )
    totals: dict[tuple[Callable[..., Any], int], int] = defaultdict(int)
    for (loop, model), count in watch.samples.items():
        for function in WITHIN[loop]:
            totals[function, model] += count
    calls = tuple(
        Calls(function, watch.models[model], round(count / runs))
        for (function, model), count in totals.items()
    )
    return Profile(phases, calls)


def pinocchio_seconds(calls: tuple[Calls, ...], repeats: int = 5) -> float:
    """Returns the time of the same calls of Pinocchio with nothing around them [s]."""
    generator = np.random.default_rng(0)
    total = 0.0
    for call in calls:
        data = call.model.createData()
        vectors = [0.3 * generator.normal(size=call.model.nv) for _ in range(3)]
        given = vectors[: ARGUMENTS.get(call.function, 3)]
        function, model = call.function, call.model
        times = []
        for _ in range(repeats):
            began = time.perf_counter()
            for _ in range(call.count):
                function(model, data, *given)
            times.append(time.perf_counter() - began)
        total += sorted(times)[repeats // 2]
    return total


@contextlib.contextmanager
def _watching() -> Iterator[_Watch]:
    """Wraps all functions, and unwraps them at the end."""
    from planner.equation_of_motion import EquationOfMotion

    watch = _Watch()
    undo: list[tuple[Any, str, Any]] = []

    def put(owner: Any, name: str, wrapped: Any) -> None:
        undo.append((owner, name, getattr(owner, name)))
        setattr(owner, name, wrapped)

    try:
        for phase, places in PHASES.items():
            for owner, name in filter(None, map(_find, places)):
                put(owner, name, watch.phase(phase, getattr(owner, name)))
        for name in LOOPS:
            if hasattr(EquationOfMotion, name):
                loop = watch.loop(name, getattr(EquationOfMotion, name))
                put(EquationOfMotion, name, loop)
        yield watch
    finally:
        for owner, name, original in reversed(undo):
            setattr(owner, name, original)


def _find(place: str) -> tuple[Any, str] | None:
    module, _, path = place.partition(":")
    *outer, name = path.split(".")
    try:
        owner: Any = importlib.import_module(module)
        for part in outer:
            owner = getattr(owner, part)
    except (ImportError, AttributeError):
        return None
    return (owner, name) if hasattr(owner, name) else None
