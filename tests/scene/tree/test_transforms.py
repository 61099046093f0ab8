import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from gateway.scene.tree import transforms as tf

unit_floats = st.floats(-1.0, 1.0, allow_nan=False)
lengths = st.floats(-100.0, 100.0)
quaternions = st.tuples(unit_floats, unit_floats, unit_floats, unit_floats).filter(lambda q: math.hypot(*q) > 1e-3)
points = st.tuples(lengths, lengths, lengths)


def hamilton(a: tuple[float, ...], b: tuple[float, ...]) -> tuple[float, ...]:
    """The product of two quaternions [w, x, y, z], written out from i*i = j*j = k*k = ijk = -1."""
    aw, ax, ay, az = a
    bw, bx, by, bz = b
    return (
        aw * bw - ax * bx - ay * by - az * bz,
        aw * bx + ax * bw + ay * bz - az * by,
        aw * by - ax * bz + ay * bw + az * bx,
        aw * bz + ax * by - ay * bx + az * bw,
    )


@given(points, quaternions, points)
def test_a_pose_rotates_as_the_quaternion_sandwich_does(p: Any, q: Any, v: Any) -> None:
    norm = math.hypot(*q)
    unit = tuple(c / norm for c in q)
    conjugate = (unit[0], -unit[1], -unit[2], -unit[3])
    expected = np.array(hamilton(hamilton(unit, (0.0, *v)), conjugate)[1:]) + p
    np.testing.assert_allclose((tf.from_pose(p, q) @ (*v, 1.0))[:3], expected, atol=1e-9)


@given(points, quaternions, st.floats(1e-160, 1e150))
def test_the_length_of_the_quaternion_does_not_matter(p: Any, q: Any, factor: Any) -> None:
    scaled = [c * factor for c in q]
    np.testing.assert_allclose(tf.from_pose(p, scaled), tf.from_pose(p, q), atol=1e-9)


@pytest.mark.parametrize("huge", [1e308, 1e200, 1e-200, 1e-320])
def test_quaternions_whose_square_overflows_or_underflows(huge: Any) -> None:
    np.testing.assert_allclose(
        tf.from_pose((0, 0, 0), (huge, 0, 0, huge)), tf.from_pose((0, 0, 0), (1, 0, 0, 1)), atol=1e-3
    )


def test_the_zero_quaternion_is_no_rotation() -> None:
    np.testing.assert_array_equal(tf.from_pose((1, 2, 3), (0, 0, 0, 0)), tf.translation(1, 2, 3))


@pytest.mark.parametrize("bad", [math.nan, math.inf, -math.inf])
@pytest.mark.parametrize("place", range(4))
@pytest.mark.parametrize("rest", [0.0, 1.0])
def test_non_finite_quaternions_give_non_finite_matrices(bad: Any, place: Any, rest: Any) -> None:
    quaternion = [rest] * 4
    quaternion[place] = bad
    assert not np.isfinite(tf.from_pose((0, 0, 0), quaternion)).all()
    assert not np.isfinite(tf.from_poses(np.array([[0.0, 0.0, 0.0, *quaternion]]))).all()


odd_floats = st.one_of(st.floats(-2, 2), st.sampled_from([0.0, math.nan, math.inf, 1e300, 1e-300]))


@given(hnp.arrays(np.float64, st.tuples(st.integers(1, 9), st.just(7)), elements=odd_floats))
def test_many_poses_at_once_equal_one_by_one(poses: Any) -> None:
    with np.errstate(all="ignore"):
        expected = [tf.from_pose(p[:3], p[3:]) for p in poses.tolist()]
    np.testing.assert_allclose(tf.from_poses(poses), expected, atol=1e-12)


@given(points, points, points)
def test_look_at_is_a_rigid_optical_frame_that_sees_the_target_ahead(eye: Any, target: Any, up: Any) -> None:
    if math.dist(eye, target) < 1e-3:
        return
    X = tf.look_at(eye, target, up)
    np.testing.assert_allclose(X[:3, :3] @ X[:3, :3].T, np.eye(3), atol=1e-9)
    assert np.linalg.det(X[:3, :3]) == pytest.approx(1.0)
    seen = np.linalg.inv(X) @ (*target, 1.0)
    np.testing.assert_allclose(seen[:3], (0, 0, math.dist(eye, target)), atol=1e-6)
    assert -X[:3, 1] @ np.array(up) >= -1e-6 * (1.0 + math.hypot(*up))


def test_look_at_refuses_to_look_at_itself() -> None:
    with pytest.raises(ValueError, match="coincide"):
        tf.look_at((1, 2, 3), (1, 2, 3), (0, 0, 1))


def test_the_shared_identity_cannot_be_written_to() -> None:
    with pytest.raises(ValueError, match="read-only"):
        tf.IDENTITY[0, 3] = 1.0


@given(quaternions)
def test_quaternions_of_rotations(q: tuple[float, ...]) -> None:
    R = tf.from_pose((0.0, 0.0, 0.0), q)[:3, :3]
    (found,) = tf.quaternions_of(R[None])
    assert np.linalg.norm(found) == pytest.approx(1.0)
    np.testing.assert_allclose(tf.from_pose((0.0, 0.0, 0.0), found)[:3, :3], R, atol=1e-14)


def test_quaternions_of_half_turns_and_of_nothing() -> None:
    R = np.array([np.eye(3), np.diag((1.0, -1.0, -1.0)), np.diag((-1.0, 1.0, -1.0)), np.diag((-1.0, -1.0, 1.0))])
    np.testing.assert_array_equal(tf.quaternions_of(R), np.eye(4))
    assert tf.quaternions_of(np.zeros((0, 3, 3))).shape == (0, 4)
