"""How surely a plan is reached with no option set: random transports and random arms.

500 transports of the paper's arms, start and goal drawn inside the shared workspace, and 100 pairs
of arms of other lengths and masses. Start and goal keep a margin from the singularities: every
elbow is bent, and not folded, by at least `MARGIN` rad. Every failure is listed with its reason.
Least jerk follows the straight line, whatever the arms: where one of them does not reach all of it,
which its link lengths tell, no plan exists, and none is counted.

    python scripts/robustness.py [--transports 500] [--geometries 100] [--seed 0]
"""

from __future__ import annotations

import argparse
import tempfile
import time
import xml.etree.ElementTree as ElementTree
from collections import Counter
from pathlib import Path

import numpy as np

import planner
from planner.assembly import build_chain
from planner.chain import ClosedChain
from planner.solution import Solution
from planner.solving import solve
from planner.transport import make_transport

MARGIN = 0.35  # rad
NEAREST = 0.05  # m between start and goal at least
SCENARIO = Path(__file__).parents[1] / "urdf" / "human_arms" / "transport.toml"
CRITERIA = ("torque-change", "torque", "jerk")


def elbows(lengths: np.ndarray, base: np.ndarray, point: np.ndarray) -> float:
    """Returns how far the elbow is from straight or folded with the hand at a point [rad]."""
    distance = np.linalg.norm(point - base)
    cosine = (distance**2 - (lengths**2).sum()) / (2.0 * lengths[0] * lengths[1])
    if abs(cosine) >= 1.0:
        return -1.0
    angle = float(np.arccos(cosine))
    return min(angle, np.pi - angle)


def draw_point(
    generator: np.random.Generator, lengths: np.ndarray, bases: np.ndarray
) -> np.ndarray:
    """Returns a point in front of both arms that both reach with the margin, (2,) [m]."""
    reach = lengths.sum(axis=1).max()
    while True:
        point = generator.uniform([bases[0, 0] - reach, 0.05], [bases[1, 0] + reach, reach])
        margins = [elbows(lengths[i], bases[i], point) for i in range(2)]
        if min(margins) > MARGIN:
            return point


def line_is_reached(
    lengths: np.ndarray, bases: np.ndarray, start: np.ndarray, goal: np.ndarray
) -> bool:
    """Returns whether both arms reach every point of the straight line."""
    points = start + np.linspace(0.0, 1.0, 501)[:, None] * (goal - start)
    return min(elbows(lengths[i], bases[i], point) for i in range(2) for point in points) > 0.0


def attempt(scenario: planner.Scenario, chain: ClosedChain) -> tuple[str, float]:
    """Returns how planning ended ("solved", or status and reason) and the time it took [s]."""
    began = time.perf_counter()
    try:
        if scenario.criterion.kind == "jerk":
            outcome = planner.plan(scenario, chain=chain)
            text = "solved" if outcome.solved else f"{outcome.status}: {outcome.reason}"
        else:
            found = solve(scenario, make_transport(scenario, chain))
            text = "solved"
            if not isinstance(found, Solution):
                text = f"{found.status}: {found.reason}"
    except planner.PlannerError as error:
        text = f"input: {error}"
    return text, time.perf_counter() - began


def random_transports(count: int, generator: np.random.Generator) -> None:
    """Prints how many random transports of the paper's arms reach a plan, for each criterion."""
    base = planner.load(SCENARIO)
    chain = build_chain(base)
    lengths = np.array([[0.27, 0.33], [0.27, 0.33]])
    bases = np.array([[0.0, 0.0], [0.45, 0.0]])
    pairs = []
    while len(pairs) < count:
        start, goal = (draw_point(generator, lengths, bases) for _ in range(2))
        if np.linalg.norm(goal - start) > NEAREST:
            pairs.append((start, goal))
    for kind in CRITERIA:
        report = []
        for start, goal in pairs:
            scenario = base.override(
                {
                    "task.start.xyz": [*start.tolist(), 0.0],
                    "task.goal.xyz": [*goal.tolist(), 0.0],
                    "criterion.kind": kind,
                }
            )
            label = f"{np.round(start, 4).tolist()} to {np.round(goal, 4).tolist()}"
            possible = kind != "jerk" or line_is_reached(lengths, bases, start, goal)
            report.append((label, possible, *attempt(scenario, chain)))
        summarise(f"{kind}, {count} transports", report)


def random_geometries(count: int, generator: np.random.Generator, folder: Path) -> None:
    """Prints how many pairs of random arms reach a plan, for each criterion."""
    base = planner.load(SCENARIO)
    cases = []
    for number in range(count):
        lengths = generator.uniform(0.2, 0.5, size=(2, 2))
        masses = generator.uniform(0.3, 3.0, size=(2, 2))
        apart = generator.uniform(0.5, 1.0) * lengths.sum(axis=1).min()
        bases = np.array([[0.0, 0.0], [apart, 0.0]])
        urdfs = [
            scaled_arm(folder / f"{side}_{number}.urdf", side, lengths[i], masses[i])
            for i, side in enumerate(("left", "right"))
        ]
        while True:
            start, goal = (draw_point(generator, lengths, bases) for _ in range(2))
            if np.linalg.norm(goal - start) > NEAREST:
                break
        overrides = {
            "left.urdf": str(urdfs[0]),
            "right.urdf": str(urdfs[1]),
            "right.base.xyz": [float(apart), 0.0, 0.0],
            "object.mass": float(generator.uniform(0.0, 10.0)),
            "task.start.xyz": [*start.tolist(), 0.0],
            "task.goal.xyz": [*goal.tolist(), 0.0],
        }
        straight = line_is_reached(lengths, bases, start, goal)
        cases.append((f"geometry {number}", straight, base.override(overrides)))
    for kind in CRITERIA:
        report = []
        for label, straight, scenario in cases:
            given = scenario.override({"criterion.kind": kind})
            possible = kind != "jerk" or straight
            report.append((label, possible, *attempt(given, build_chain(given))))
        summarise(f"{kind}, {count} pairs of arms", report)


def scaled_arm(path: Path, side: str, lengths: np.ndarray, masses: np.ndarray) -> Path:
    """Writes the paper's arm with other link lengths [m] and masses [kg], as slender rods."""
    tree = ElementTree.parse(SCENARIO.parent / f"{side}_arm.urdf")
    root = tree.getroot()
    moving = [link for link in root.findall("link") if link.find("inertial") is not None]
    for link, length, mass in zip(moving[-2:], lengths, masses, strict=True):
        inertial = link.find("inertial")
        inertial.find("mass").set("value", str(mass))
        inertial.find("origin").set("xyz", f"{length / 2} 0 0")
        inertia = inertial.find("inertia")
        inertia.set("iyy", str(mass * length**2 / 12))
        inertia.set("izz", str(mass * length**2 / 12))
    ends = [joint for joint in root.findall("joint") if joint.find("origin") is not None]
    for joint in ends:
        origin = joint.find("origin")
        x = float(origin.get("xyz").split()[0])
        for old, new in zip((0.27, 0.33), lengths, strict=True):
            if abs(x - old) < 1e-9:
                origin.set("xyz", f"{new} 0 0")
    tree.write(path)
    return path


def summarise(title: str, report: list[tuple[str, bool, str, float]]) -> None:
    """Prints the share solved of what is possible, the times, and every failure with its reason."""
    solved = sum(text == "solved" for _, _, text, _ in report)
    possible = sum(possible or text == "solved" for _, possible, text, _ in report)
    times = np.array([seconds for *_, seconds in report])
    print(
        f"{title}: {solved}/{possible} solved ({100 * solved / possible:.1f} %), "
        f"median {np.median(times):.3f} s, longest {times.max():.2f} s"
    )
    if possible < len(report):
        print(
            f"  {len(report) - possible} x no plan exists: the straight line leaves the workspace"
        )
    failures = [(label, text) for label, able, text, _ in report if able and text != "solved"]
    kinds = Counter(text.split(":")[0] for _, text in failures)
    for kind, number in kinds.most_common():
        print(f"  {number} x {kind}")
    for label, text in failures:
        print(f"    {label}: {text}")


def main() -> None:
    """Runs both studies."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--transports", type=int, default=500)
    parser.add_argument("--geometries", type=int, default=100)
    parser.add_argument("--seed", type=int, default=0)
    given = parser.parse_args()
    print(f"seed {given.seed}; margin from singularities {MARGIN} rad at start and goal")
    if given.transports:
        random_transports(given.transports, np.random.default_rng(given.seed))
    if given.geometries:
        with tempfile.TemporaryDirectory() as folder:
            random_geometries(given.geometries, np.random.default_rng(given.seed), Path(folder))


if __name__ == "__main__":
    main()
