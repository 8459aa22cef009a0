"""Postures within the joint limits: Newton's method, and a search that also works at the edges.

Newton's method is quick, and fails where it starts far away, where arms are stretched, or where
the way leads out of the joint limits. Damped least squares, which never leaves the limits and
never increases the error, finds the way there; it walks from many postures at once.
"""

from __future__ import annotations

import numpy as np

from planner.chain import ClosedChain
from planner.posture_equations import ObjectPose, jacobian, residual
from planner.vectors import matvec, transpose

TOLERANCE = 1e-11
_AT_REST = 1e-9  # rad: redundant joints that move less have arrived
_OFF_PLANE = 1e-9  # m
_NEWTON_STEPS = 60
_LONGEST_STEP = 0.5  # rad or m
_DAMPED_STEPS = 150
_CLIP_STEPS = 40
_SOFT = 1e-3


def newton_step(matrix: np.ndarray, error: np.ndarray) -> np.ndarray:
    """Returns the least joint steps that cancel the errors to first order, (K, N)."""
    if matrix.shape[-1] == matrix.shape[-2]:
        try:
            return -np.linalg.solve(matrix, error[..., None])[..., 0]
        except np.linalg.LinAlgError:
            pass
    return -matvec(np.linalg.pinv(matrix, rcond=1e-8), error)


def newton(
    chain: ClosedChain, pose: ObjectPose, seed: np.ndarray, reference: np.ndarray
) -> np.ndarray | None:
    """Returns the posture that Newton's method finds from `seed`, (N,), or None.

    Redundant joints come as near to `reference`, in the norm of all joints, as they can in the
    neighbourhood.

    Args:
        chain: The closed chain.
        pose: Where the object shall be.
        seed: Posture within the limits, (N,).
        reference: Posture to stay near, (N,).
    """
    turned = pose.rotation is not None
    redundant = chain.p > len(chain.task_rows(turned))
    lower, upper = limits = chain.limits
    q, multiplier = seed, np.zeros(chain.m + len(chain.task_rows(turned)))
    for _ in range(_NEWTON_STEPS):
        now = residual(chain, q[None], pose.position, pose.rotation)
        error = now.error[0]
        solved = float(np.abs(error).max()) < TOLERANCE
        if solved and not redundant:
            break
        matrix = jacobian(chain, now, orientation=turned)[0]
        if redundant:
            nearest, multiplier = nearest_within_limits(
                matrix, matrix @ q - error, reference, limits, multiplier
            )
            step = nearest - q
        else:
            step = newton_step(matrix, error)
        largest = float(np.abs(step).max())
        if solved and largest < _AT_REST:
            break
        before, q = q, q + step * min(1.0, _LONGEST_STEP / max(largest, 1e-300))
    else:
        q = before  # what was found out is true of this one
    within = bool(((q >= lower - 1e-9) & (q <= upper + 1e-9)).all())
    return q if solved and within and now.off_plane[0] < _OFF_PLANE else None


def nearest_within_limits(
    matrix: np.ndarray,
    right: np.ndarray,
    reference: np.ndarray,
    limits: tuple[np.ndarray, np.ndarray],
    multiplier: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:
    """Returns the point nearest to `reference` with matrix @ x = right within the limits.

    Its multiplier comes second; that of a similar problem is where the search for it starts.
    Where the limits leave no such point, the equations are traded against the distance.
    """
    x, found = _clipped(matrix, right, reference, limits, multiplier, 0.0)
    if found is not None:
        return x, found
    nothing = np.zeros(len(right))
    return _clipped(matrix, right, reference, limits, nothing, _SOFT)[0], nothing


def _clipped(
    matrix: np.ndarray,
    right: np.ndarray,
    reference: np.ndarray,
    limits: tuple[np.ndarray, np.ndarray],
    nu: np.ndarray,
    soft: float,
) -> tuple[np.ndarray, np.ndarray | None]:
    """Returns x = reference + matrix' nu, clipped at the limits, with matrix @ x + soft nu = right.

    Newton's method on the multiplier nu, which comes second, None if it was not found; joints at
    their limits do not count, and where too few are left the step is damped. Solving again for what
    is left over makes up for the squared condition number.
    """
    lower, upper = limits

    def at(nu: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray, float]:
        open_ = reference + nu @ matrix
        x = np.minimum(np.maximum(open_, lower), upper)
        left, away = right - matrix @ x, x - reference
        dual = float(0.5 * away @ away + nu @ left - 0.5 * soft * nu @ nu)
        return open_, x, left - soft * nu, dual

    whole = float((matrix * matrix).sum())
    ridge = least = soft + 1e-12 * whole  # larger after a step that made the dual fall
    open_, x, left, gain = at(nu)
    for _ in range(_CLIP_STEPS):
        size = np.abs(left).max()
        if size < 1e-13:
            return x, nu
        moving = matrix * ((open_ >= lower) & (open_ <= upper))
        square = moving @ matrix.T
        square.flat[:: len(square) + 1] += ridge
        trial = nu + np.linalg.solve(square, left)
        new = at(trial)
        # the dual rises; towards round-off only what is left over tells
        if new[3] > gain or np.abs(new[2]).max() < 0.5 * size:
            nu, (open_, x, left, gain) = trial, new
            ridge = max(0.1 * ridge, least)
        else:
            ridge = min(max(10.0 * ridge, 1e-4 * whole), whole)
    return x, None


def closed_within_limits(chain: ClosedChain, pose: ObjectPose, seeds: np.ndarray) -> np.ndarray:
    """Returns the postures that damped least squares reaches from seeds, (L, N) with L <= K.

    Levenberg's and Marquardt's steps, damped by the size of the error, on the joints that are not
    pressed against their limits.

    Args:
        chain: The closed chain.
        pose: Where the object shall be.
        seeds: Postures to start from, (K, N).
    """
    lower, upper = chain.limits
    turned = pose.rotation is not None
    q = np.clip(seeds, lower, upper)
    now = residual(chain, q, pose.position, pose.rotation)
    error, matrix = now.error, jacobian(chain, now, orientation=turned)
    off_plane, damping = now.off_plane, np.full(len(q), 1e-3)
    found = [q[:0]]
    identity = np.eye(error.shape[1])
    for _ in range(_DAMPED_STEPS):
        size = np.abs(error).max(axis=1)
        there = size < TOLERANCE
        if there.any():
            found.append(q[there & (off_plane < _OFF_PLANE)])
        walking = ~there & (damping < 1e8)
        if not walking.any():
            break
        if not walking.all():
            q, error, matrix, off_plane, damping, size = (
                part[walking] for part in (q, error, matrix, off_plane, damping, size)
            )
        slope = (error[:, None, :] @ matrix)[:, 0]
        pressed = ((q <= lower) & (slope > 0.0)) | ((q >= upper) & (slope < 0.0))
        moving = matrix * ~pressed[:, None, :]
        damped = (damping * np.minimum(size, 1.0) + 1e-14)[:, None, None] * identity
        shares = np.linalg.solve(moving @ transpose(moving) + damped, error[..., None])
        step = -(transpose(moving) @ shares)[..., 0]
        largest = np.maximum(np.abs(step).max(axis=1), 1e-300)
        step *= np.minimum(1.0, _LONGEST_STEP / largest)[:, None]
        trial = np.clip(q + step, lower, upper)
        new = residual(chain, trial, pose.position, pose.rotation)
        better = (new.error**2).sum(axis=1) < (error**2).sum(axis=1)
        slopes = jacobian(chain, new, orientation=turned)
        q = np.where(better[:, None], trial, q)
        error = np.where(better[:, None], new.error, error)
        matrix = np.where(better[:, None, None], slopes, matrix)
        off_plane = np.where(better, new.off_plane, off_plane)
        damping = np.where(better, np.maximum(damping / 5.0, 1e-12), damping * 4.0)
    return np.concatenate(found)
