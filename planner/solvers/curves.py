"""A motion and the multiplier as polynomials of the share of the duration."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from planner.solvers.basis import legendre_values


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
    return legendre_values(np.asarray(share), len(coefficients) - 1, order) @ coefficients
