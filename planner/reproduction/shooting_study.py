"""How close the initial costates must be for the paper's shooting method to converge (4.1)."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from planner.blas import one_blas_thread
from planner.outcome import Failure, NotSolvedError
from planner.reproduction.cases import TORQUE, Values, Workbench
from planner.reproduction.findings import Finding, Table, Verdict
from planner.reproduction.numerics import SECTION, make_problem
from planner.reproduction.shots import fly, newton_shots
from planner.solvers.collocation import solve_collocation
from planner.solvers.shooting import first_costates, shoot

SIZES = (1e-3, 1e-2, 1e-1, 3e-1, 1.0, 1e1, 1e2)
TRIALS = 8
_SAME = 1e-2  # relative distance of costates that are those of the plan


@dataclass(frozen=True, eq=False)
class Study:
    """What became of all starts for one criterion.

    Attributes:
        name: The criterion.
        rows: Per size of the perturbation: the size, how many found the plan, how many ended at
            another solution, how many were lost in the first flight, most Newton steps.
        zero: Newton steps from costates zero; None if these do not lead to the plan.
        growth: By how much an error of the costates grows on the way to the goal, both scaled.
        missed: By how much the planner's own shooting misses the goal from the costates that
            collocation finds, scaled.
    """

    name: str
    rows: tuple[tuple[float, int, int, int, int], ...]
    zero: int | None
    growth: float
    missed: float

    def safe(self) -> float:
        """Returns the largest size up to which every start finds the plan; 0 if there is none."""
        size = 0.0
        for row in self.rows:
            if row[1] < TRIALS:
                break
            size = row[0]
        return size

    def hopeless(self) -> float:
        """Returns the smallest size from which on no start finds the plan; infinite if none."""
        size = math.inf
        for row in reversed(self.rows):
            if row[1]:
                break
            size = row[0]
        return size

    def table(self) -> Table:
        """Returns the rows as text."""
        return Table(
            (
                f"{self.name}: s",
                "find the plan",
                "another solution",
                "lost at once",
                "of",
                "most Newton steps",
            ),
            tuple(
                (f"{size:g}", f"{found}", f"{other}", f"{lost}", f"{TRIALS}", f"{steps}")
                for size, found, other, lost, steps in self.rows
            ),
        )


def study_shooting(bench: Workbench, name: str, values: Values) -> Study:
    """Shoots from costates perturbed at random, and from costates zero.

    Args:
        bench: Holds the scenario.
        name: The criterion's name in the report.
        values: What is set over the scenario.
    """
    problem = make_problem(bench.scenario.override(dict(values)))
    solved = solve_collocation(problem, tolerance=1e-6, max_nodes=5000)
    if isinstance(solved, Failure):
        raise NotSolvedError(f"{solved.status}: {solved.reason}")
    truth = solved.states(np.zeros(1))[0] / problem.scale
    half = problem.criterion.state_size
    random = np.random.default_rng(0)
    starts = np.repeat(truth[:, None], len(SIZES) * TRIALS + 1, axis=1)
    for place, size in enumerate(SIZES):
        columns = slice(place * TRIALS, (place + 1) * TRIALS)
        starts[half:, columns] *= 1.0 + size * random.standard_normal((half, TRIALS))
    starts[:, -1] = first_costates(problem)
    with one_blas_thread():
        shots = newton_shots(problem, starts)
        distance = np.linalg.norm(shots.start[half:] - truth[half:, None], axis=0)
        right = shots.converged & (distance < _SAME * np.linalg.norm(truth[half:]))
    _, along = fly(problem, truth[:, None], sensitive=True)
    growth = float(np.linalg.norm(along[0, :, half:], ord=2))
    shot = shoot(problem, truth, sensitive=False)
    missed = math.inf
    if shot is not None:
        missed = float(np.max(np.abs(problem.boundary(truth, shot.goal))))
    rows = []
    for place, size in enumerate(SIZES):
        part = slice(place * TRIALS, (place + 1) * TRIALS)
        found = int(right[part].sum())
        other = int(shots.converged[part].sum()) - found
        most = int(np.max(shots.steps[part], where=right[part], initial=0))
        rows.append((size, found, other, int(shots.lost[part].sum()), most))
    zero = int(shots.steps[-1]) if right[-1] else None
    return Study(name, tuple(rows), zero, growth, missed)


def shooting_findings(bench: Workbench) -> list[Finding]:
    """Returns the finding on how close a start must be for shooting to converge."""
    studies = [
        study_shooting(bench, name, values)
        for name, values in (("torque-change", {}), ("torque", TORQUE))
    ]
    limited = all(study.hopeless() < math.inf for study in studies)
    zero = any(study.zero is not None for study in studies)
    verdict = Verdict.CONTRADICTED
    if limited:
        verdict = Verdict.CONDITION if zero else Verdict.SUPPORTED
    return [
        Finding(
            SECTION,
            "Shooting is very sensitive to the guessed costates and fails unless they are close "
            "enough to the right ones.",
            verdict,
            f"The right costates at the start, each multiplied by 1 + s times a normal random "
            f"number, {TRIALS} starts for each s. A start is lost at once where the arms cannot "
            "follow or the equations blow up. " + " ".join(_sentence(study) for study in studies),
            tuple(study.table() for study in studies),
            on_screen=True,
        )
    ]


def _sentence(study: Study) -> str:
    hopeless = study.hopeless()
    never = f"from s = {hopeless:g} on none does" if hopeless < math.inf else "some always do"
    zero = (
        "they do not converge"
        if study.zero is None
        else f"they do converge, in {study.zero} Newton steps: without costates nothing moves, so "
        "that the first flight is calm"
    )
    return (
        f"For {study.name} all find the plan up to s = {study.safe():g}; {never}. "
        f"From costates all zero {zero}. An error of the costates grows "
        f"{study.growth:.0f}-fold on the way (scaled variables). From the costates that "
        "collocation finds, the planner's own shooting, with its tight "
        f"tolerance, comes to the goal within {study.missed:.1e}."
    )
