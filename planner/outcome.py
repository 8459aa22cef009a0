"""How a solve ended when it gave no plan: a name, the reason, and what to try."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

from planner.errors import PlannerError

if TYPE_CHECKING:
    from planner.scenario import Scenario

REMEDIES = {
    "mesh-full": "allow more nodes (--set solver.max_nodes=10000), loosen solver.tolerance, or "
    "lengthen task.duration",
    "singular-jacobian": "start from another motion (--set solver.start=line or spectral), or "
    "regularise redundant joints (--set criterion.speed_cost=0.01)",
    "no-descent": "start from an easier motion: a lighter object, a longer duration, a goal "
    "closer by; or --set solver.starts=8",
    "closure-lost": "move start or goal away from the edge of the shared workspace, or choose "
    "postures on the other side of the elbow",
    "unbounded-squeeze": "prescribe the squeeze at one end (--set boundary.start.torque=static, or "
    "an internal_force there), or let the torques cost something (--set criterion.kind=mixed)",
    "singular-chain": "choose another posture or another pair: at this one the hands' closure "
    "leaves the joints undetermined",
    "disagreement": "solve to a tighter tolerance (--set solver.tolerance=1e-6), or try several "
    "starts (--set solver.starts=8)",
}


class NotSolvedError(PlannerError):
    """Raised where a plan is needed and there is only a failure."""


@dataclass(frozen=True, eq=False)
class Failure:
    """A solve that gave no plan. It holds no trajectory and cannot be mistaken for a plan.

    Attributes:
        status: Name of the outcome, one of `REMEDIES`.
        reason: What happened, in a sentence.
        remedy: What to try next.
        evidence: Numbers that support the reason.
        scenario: What was to be planned.
    """

    status: str
    reason: str
    remedy: str
    evidence: dict[str, Any] = field(default_factory=dict)
    scenario: Scenario | None = None

    solved: ClassVar[bool] = False

    def __post_init__(self) -> None:
        assert self.status in REMEDIES, self.status

    def save(self, folder: Path | str) -> Path:
        """Writes `plan.json` with the status and its reason, and no trajectory.

        A trajectory that an earlier plan left in the folder is removed, so that it cannot be
        taken for this one's.

        Returns:
            The file written.
        """
        folder = Path(folder)
        folder.mkdir(parents=True, exist_ok=True)
        (folder / "trajectory.npz").unlink(missing_ok=True)
        content = {
            "status": self.status,
            "reason": self.reason,
            "remedy": self.remedy,
            "evidence": self.evidence,
            "scenario": self.scenario.resolved() if self.scenario else None,
        }
        path = folder / "plan.json"
        path.write_text(json.dumps(plain(content), indent=2, allow_nan=False) + "\n")
        return path

    def unwrap(self) -> Any:
        """Raises: there is no plan to return.

        Raises:
            NotSolvedError: Always, with status, reason and remedy.
        """
        raise NotSolvedError(f"{self.status}: {self.reason}; {self.remedy}")


def plain(value: Any) -> Any:
    """Returns what JSON can hold: NumPy's numbers as Python's, infinity and NaN as text."""
    value = value.tolist() if hasattr(value, "tolist") else value
    if isinstance(value, dict):
        return {key: plain(part) for key, part in value.items()}
    if isinstance(value, list | tuple):
        return [plain(part) for part in value]
    return str(value) if isinstance(value, float) and not math.isfinite(value) else value


def failure(status: str, reason: str, scenario: Scenario | None = None, **evidence: Any) -> Failure:
    """Returns a failure with the remedy that belongs to its status."""
    return Failure(status, reason, REMEDIES[status], evidence, scenario)
