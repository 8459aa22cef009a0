"""Terms of the arms' equation of motion (left side of eq. 2) from Pinocchio, over a batch.

Both arms stand in one Pinocchio model, the object's inertia lumped into the left arm's last body,
so that one call serves a sample. A loop over samples calls Pinocchio and fills arrays, no more:
small NumPy calls inside it would cost several times what Pinocchio takes.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import pinocchio as pin

_KEPT = 40  # batches whose arrays are kept,
_SMALL = 600  # of no more samples than these


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

    def part(self, some: slice | np.ndarray) -> Placements:
        """Returns some of the samples."""
        return Placements(*(values[some] for values in vars(self).values()))


class _Batch:
    """Arrays for the samples of one batch, with views of every sample.

    The views are made once for all batches of one size: in a loop they would cost as much time as
    Pinocchio takes. What was filled in is handed out as copies.

    Attributes:
        rows: For each sample its inputs, then its outputs, one leading index at a time.
    """

    def __init__(self, inputs: int, count: int, n: int, outputs: tuple[tuple[int, ...], ...]):
        self._inputs = np.empty((inputs, count, n))
        self._outputs = [np.empty((count, *shape)) for shape in outputs]
        # matrices in stacks, (K, 3, N, N), are filled one by one
        each = [
            part
            for values in self._outputs
            for part in (values.swapaxes(0, 1) if values.ndim == 4 else (values,))
        ]
        self.rows = list(zip(*self._inputs, *each, strict=True))

    def take(self, *inputs: np.ndarray) -> list[tuple[np.ndarray, ...]]:
        """Returns the rows, with the inputs, (K, N) each, written into them."""
        for own, given in zip(self._inputs, inputs, strict=True):
            own[...] = given
        return self.rows

    def results(self) -> tuple[np.ndarray, ...]:
        """Returns copies of the outputs."""
        return tuple(values.copy() for values in self._outputs)


class EquationOfMotion:
    """Pinocchio's model of both arms with its work space.

    Attributes:
        model: Both arms, left joints first.
        n: Number of joints of both.
    """

    def __init__(self, model: pin.Model, left_joint: int, right_joint: int) -> None:
        self.model = model
        self.n = int(model.nv)
        self._joints = left_joint, right_joint
        self._data = model.createData()
        self._left = self._data.oMi[left_joint]
        self._right = self._data.oMi[right_joint]
        self._batches: dict[tuple[str, int], _Batch] = {}

    def __reduce__(self) -> tuple[type[EquationOfMotion], tuple[pin.Model, int, int]]:
        """Copies get a work space of their own."""
        return type(self), (self.model, *self._joints)

    def _batch(
        self, name: str, inputs: int, count: int, outputs: tuple[tuple[int, ...], ...]
    ) -> _Batch:
        if count > _SMALL:  # making the views no longer counts, keeping them would
            return _Batch(inputs, count, self.n, outputs)
        batch = self._batches.get((name, count))
        if batch is None:
            if len(self._batches) >= _KEPT:
                self._batches.clear()
            batch = self._batches[name, count] = _Batch(inputs, count, self.n, outputs)
        return batch

    def placements(self, q: np.ndarray) -> Placements:
        """Returns body placements and twist columns at the postures q, (K, N) [rad]."""
        shapes = (6, self.n), (3, 3), (3,), (3, 3), (3,)
        batch = self._batch("placements", 1, len(q), shapes)
        model, data, compute = self.model, self._data, pin.computeJointJacobians
        jacobian = data.J
        left_r, left_t = self._left.rotation, self._left.translation
        right_r, right_t = self._right.rotation, self._right.translation
        for q_k, columns_k, lr_k, lt_k, rr_k, rt_k in batch.take(q):
            compute(model, data, q_k)
            columns_k[...] = jacobian
            lr_k[...] = left_r
            lt_k[...] = left_t
            rr_k[...] = right_r
            rt_k[...] = right_t
        return Placements(*batch.results())

    def inertia_and_bias(self, q: np.ndarray, v: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Returns I(q), (K, N, N) [kg m^2], and C(q, v) + G(q), (K, N) [Nm]."""
        n = self.n
        batch = self._batch("inertia and bias", 2, len(q), ((n, n), (n,)))
        model, data, crba, effects = self.model, self._data, pin.crba, pin.nonLinearEffects
        mass, nonlinear = data.M, data.nle
        for q_k, v_k, inertia_k, bias_k in batch.take(q, v):
            crba(model, data, q_k)
            effects(model, data, q_k, v_k)
            inertia_k[...] = mass
            bias_k[...] = nonlinear
        inertia, bias = batch.results()
        return inertia, bias

    def inverse_dynamics(self, q: np.ndarray, v: np.ndarray, a: np.ndarray) -> np.ndarray:
        """Returns I a + C + G, the torques of both arms without a force at the hands, (K, N)."""
        batch = self._batch("inverse dynamics", 3, len(q), ((self.n,),))
        model, data, rnea = self.model, self._data, pin.rnea
        result = data.tau
        for q_k, v_k, a_k, torque_k in batch.take(q, v, a):
            rnea(model, data, q_k, v_k, a_k)
            torque_k[...] = result
        return batch.results()[0]

    def inverse_dynamics_derivatives(
        self, q: np.ndarray, v: np.ndarray, a: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Returns I a + C + G, (K, N), and its derivatives along q, v and a, (K, 3, N, N).

        The last of them is I.
        """
        n = self.n
        batch = self._batch("derivatives", 3, len(q), ((n,), (3, n, n)))
        model, data, compute = self.model, self._data, pin.computeRNEADerivatives
        tau, dq, dv, da = data.tau, data.dtau_dq, data.dtau_dv, data.M
        for q_k, v_k, a_k, torque_k, dq_k, dv_k, da_k in batch.take(q, v, a):
            compute(model, data, q_k, v_k, a_k)
            torque_k[...] = tau
            dq_k[...] = dq
            dv_k[...] = dv
            da_k[...] = da
        torque, along = batch.results()
        return torque, along
