"""Terms of the arms' equation of motion (left side of eq. 2) from Pinocchio, over a batch.

Both arms stand in one Pinocchio model, the object's inertia lumped into the left arm's last body,
so that one call serves a sample. A loop over samples calls Pinocchio and fills arrays, no more:
small NumPy calls inside it would cost several times what Pinocchio takes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin


@dataclass(frozen=True, eq=False)
class Placements:
    """Where everything is, for K samples.

    Attributes:
        columns: Joint twist columns (linear at the world's origin; angular), world axes, (K, 6, N).
        left_rotation: Body that carries the left hand, (K, 3, 3).
        left_translation: (K, 3) [m].
        right_rotation: Body that carries the right hand, (K, 3, 3).
        right_translation: (K, 3) [m].
    """

    columns: np.ndarray
    left_rotation: np.ndarray
    left_translation: np.ndarray
    right_rotation: np.ndarray
    right_translation: np.ndarray


class EquationOfMotion:
    """Pinocchio's model of both arms with its work space.

    Attributes:
        model: Both arms, left joints first.
        n: Number of joints of both.
    """

    def __init__(self, model: pin.Model, left_joint: int, right_joint: int) -> None:
        self.model = model
        self.n = int(model.nv)
        self._data = model.createData()
        self._left = self._data.oMi[left_joint]
        self._right = self._data.oMi[right_joint]

    def placements(self, q: np.ndarray) -> Placements:
        """Returns body placements and twist columns at the postures q, (K, N) [rad]."""
        count, n = q.shape
        result = Placements(
            np.empty((count, 6, n)),
            np.empty((count, 3, 3)),
            np.empty((count, 3)),
            np.empty((count, 3, 3)),
            np.empty((count, 3)),
        )
        model, data, compute = self.model, self._data, pin.computeJointJacobians
        columns, jacobian = result.columns, data.J
        left_r, left_t = self._left.rotation, self._left.translation
        right_r, right_t = self._right.rotation, self._right.translation
        rows = zip(
            np.ascontiguousarray(q),
            columns,
            result.left_rotation,
            result.left_translation,
            result.right_rotation,
            result.right_translation,
            strict=True,
        )
        for q_k, columns_k, lr_k, lt_k, rr_k, rt_k in rows:
            compute(model, data, q_k)
            columns_k[...] = jacobian
            lr_k[...] = left_r
            lt_k[...] = left_t
            rr_k[...] = right_r
            rt_k[...] = right_t
        return result

    def inertia_and_bias(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns I(q), (K, N, N) [kg m^2], and C(q, v) + G(q), (K, N) [Nm]."""
        count, n = q.shape
        inertia, bias = np.empty((count, n, n)), np.empty((count, n))
        model, data, crba, effects = self.model, self._data, pin.crba, pin.nonLinearEffects
        mass, nonlinear = data.M, data.nle
        rows = zip(np.ascontiguousarray(q), np.ascontiguousarray(v), inertia, bias, strict=True)
        for q_k, v_k, inertia_k, bias_k in rows:
            crba(model, data, q_k)
            effects(model, data, q_k, v_k)
            inertia_k[...] = mass
            bias_k[...] = nonlinear
        return inertia, bias

    def inverse_dynamics(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Returns I a + C + G, the torques of both arms without a force at the hands, (K, N)."""
        torque = np.empty(q.shape)
        model, data, rnea = self.model, self._data, pin.rnea
        result = data.tau
        rows = zip(*map(np.ascontiguousarray, (q, v, a)), torque, strict=True)
        for q_k, v_k, a_k, torque_k in rows:
            rnea(model, data, q_k, v_k, a_k)
            torque_k[...] = result
        return torque

    def inverse_dynamics_derivatives(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns I a + C + G, (K, N), and its derivatives along q, v and a, (K, 3, N, N).

        The last of them is I.
        """
        count, n = q.shape
        torque, along = np.empty((count, n)), np.empty((count, 3, n, n))
        model, data, compute = self.model, self._data, pin.computeRNEADerivatives
        tau, dq, dv, da = data.tau, data.dtau_dq, data.dtau_dv, data.M
        rows = zip(*map(np.ascontiguousarray, (q, v, a)), torque, along, strict=True)
        for q_k, v_k, a_k, torque_k, (dq_k, dv_k, da_k) in rows:
            compute(model, data, q_k, v_k, a_k)
            torque_k[...] = tau
            dq_k[...] = dq
            dv_k[...] = dv
            da_k[...] = da
        return torque, along
