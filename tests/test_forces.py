"""Hand forces: Newton's and Euler's laws of the object, with its motion differentiated anew."""

from __future__ import annotations

import numpy as np
import pinocchio as pin
from mechanisms import Mechanism, difference, random_states, relative_error

from planner.constrained_dynamics import Motion
from planner.forces import hand_forces, object_motion
from planner.solvers.inverse_torques import inverse_torques


def moving(mechanism: Mechanism) -> tuple[Motion, np.ndarray]:
    """A motion with accelerations and hand forces of order one, and its torques."""
    states = random_states(mechanism, 3, seed=5)
    generator = np.random.default_rng(6)
    at = mechanism.freedoms(states.q)
    acceleration = generator.normal(size=states.rate.shape)
    squeeze = 3.0 * generator.normal(size=(3, mechanism.chain.m))
    tau = inverse_torques(
        mechanism.chain, mechanism.joints, at, states.rate, acceleration, squeeze
    ).tau
    return mechanism.move(states.q, states.rate, tau), tau


def along(mechanism: Mechanism, motion: Motion, time: float) -> tuple[np.ndarray, np.ndarray]:
    """The object's pose a little later, with the acceleration kept."""
    independent = mechanism.joints.independent
    y = time * motion.v[:, independent] + 0.5 * time**2 * motion.a[:, independent]
    chain = mechanism.chain
    return chain.object_pose(chain.dynamics.placements(mechanism.shifted(motion.tangent.q, y)))


def spin(mechanism: Mechanism, motion: Motion, time: float) -> np.ndarray:
    """The object's angular velocity at a time, from its rotation alone."""

    def turned(later: float) -> np.ndarray:
        _, now = along(mechanism, motion, time)
        _, then = along(mechanism, motion, time + later)
        return np.array([pin.log3(b @ a.T) for a, b in zip(now, then, strict=True)])

    return difference(turned, 1e-2)


def center(mechanism: Mechanism, motion: Motion, time: float) -> np.ndarray:
    """The object's centre of mass."""
    position, rotation = along(mechanism, motion, time)
    return position + rotation @ mechanism.chain.body.com


def acceleration(mechanism: Mechanism, motion: Motion) -> np.ndarray:
    """Of the centre of mass, by a difference of its positions."""

    def velocity(time: float) -> np.ndarray:
        return difference(lambda later: center(mechanism, motion, time + later), 1e-2)

    return difference(velocity, 1e-2)


def test_the_objects_motion_is_that_of_its_poses(mechanism: Mechanism) -> None:
    motion, _ = moving(mechanism)
    found = object_motion(mechanism.chain, motion.tangent.at, motion.v, motion.a)
    position, rotation = along(mechanism, motion, 0.0)
    assert np.allclose(found.position, position, atol=1e-12)
    assert np.allclose(found.rotation, rotation, atol=1e-12)
    assert relative_error(found.acceleration, acceleration(mechanism, motion)) < 1e-6
    assert relative_error(found.angular_velocity, spin(mechanism, motion, 0.0)) < 1e-8
    turn = difference(lambda t: spin(mechanism, motion, t), 1e-2)
    assert relative_error(found.angular_acceleration, turn) < 1e-6


def test_forces_add_up_to_mass_times_acceleration(mechanism: Mechanism) -> None:
    motion, _ = moving(mechanism)
    forces = hand_forces(mechanism.chain, motion)
    chain = mechanism.chain
    wanted = chain.body.mass * (acceleration(mechanism, motion) - chain.gravity)
    assert relative_error(forces.left_force + forces.right_force, wanted) < 1e-6


def test_moments_turn_the_object(mechanism: Mechanism) -> None:
    """The rate of the angular momentum about the centre of mass is the moment about it."""
    motion, _ = moving(mechanism)
    body = mechanism.chain.body
    forces = hand_forces(mechanism.chain, motion)
    total = forces.left_force + forces.right_force
    position, rotation = along(mechanism, motion, 0.0)
    lever = center(mechanism, motion, 0.0) - position
    moment = forces.left_moment + forces.right_moment - np.cross(lever, total)

    def momentum(time: float) -> np.ndarray:
        _, turned = along(mechanism, motion, time)
        inertia = turned @ body.inertia @ turned.transpose(0, 2, 1)
        return np.einsum("kij,kj->ki", inertia, spin(mechanism, motion, time))

    wanted = difference(momentum, 1e-2)
    # a point mass has no angular momentum: then the moment is nothing beside the hands' own
    scale = max(np.max(np.abs(wanted)), 1e-6 * np.max(np.abs(forces.left_force)))
    assert np.max(np.abs(moment - wanted)) < 1e-6 * scale
    assert rotation.shape == (3, 3, 3)


def test_each_hand_bears_what_its_own_arm_is_short_of(mechanism: Mechanism) -> None:
    """Each arm alone: its torques drive its links and press on the object with the hand."""
    motion, tau = moving(mechanism)
    chain = mechanism.chain
    forces = hand_forces(chain, motion)
    position, _ = along(mechanism, motion, 0.0)
    start = 0
    for arm, force, moment in (
        (chain.left, forces.left_force, forces.left_moment),
        (chain.right, forces.right_force, forces.right_moment),
    ):
        part = slice(start, start + arm.n)
        start += arm.n
        model = arm.model.copy()
        model.gravity.linear = chain.gravity
        data = model.createData()
        for k in range(len(tau)):
            q, v, a = (
                np.ascontiguousarray(x[k, part]) for x in (motion.tangent.q, motion.v, motion.a)
            )
            own = pin.rnea(model, data, q, v, a).copy()
            pin.forwardKinematics(model, data, q)
            jacobian = pin.computeJointJacobian(model, data, q, arm.tip_joint)
            # the wrench moved from the object's frame to the joint's, in the joint's axes
            place = data.oMi[arm.tip_joint]
            shift = moment[k] + np.cross(position[k] - place.translation, force[k])
            wrench = np.concatenate([place.rotation.T @ force[k], place.rotation.T @ shift])
            error = own + jacobian.T @ wrench - tau[k, part]
            assert np.max(np.abs(error)) < 1e-9 * np.max(np.abs(tau)), arm.side


def test_a_pair_transmits_no_moment_along_its_free_axis(human_arms: Mechanism) -> None:
    """The paper's hands are hinged: neither turns the point mass about z."""
    motion, _ = moving(human_arms)
    forces = hand_forces(human_arms.chain, motion)
    assert np.max(np.abs(forces.right_moment[:, 2])) < 1e-12
    assert np.max(np.abs(forces.left_moment[:, 2])) < 1e-12
    assert np.min(np.linalg.norm(forces.right_force, axis=1)) > 0.1


def test_forces_are_linear_in_the_internal_force(mechanism: Mechanism) -> None:
    """Torques along Gamma' squeeze the object and leave the motion as it is."""
    motion, tau = moving(mechanism)
    squeeze = np.random.default_rng(8).normal(size=motion.multiplier.shape)
    gamma = motion.tangent.gamma
    pressed = mechanism.move(
        motion.tangent.q,
        motion.v[:, mechanism.joints.independent],
        tau - np.einsum("kmn,km->kn", gamma, squeeze),
    )
    assert np.max(np.abs(pressed.a - motion.a)) < 1e-9 * np.max(np.abs(motion.a))
    assert relative_error(pressed.multiplier - motion.multiplier, squeeze) < 1e-9
    before, after = hand_forces(mechanism.chain, motion), hand_forces(mechanism.chain, pressed)
    total = before.left_force + before.right_force
    assert relative_error(after.left_force + after.right_force, total) < 1e-9
    assert np.max(np.abs(after.right_force - before.right_force)) > 0.05
