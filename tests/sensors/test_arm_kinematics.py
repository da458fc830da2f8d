"""The kinematics of the arm against the published table, and its inverse against itself."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import RigidTransform

from sensors import f3
from sensors.arm import TOOL_CENTRE_POINT

# Joints 1 to 6 as published: d, a, twist, low, high, pulses a degree.
F3_TABLE = [
    (350, 100, 90, -180, 180, 569),
    (0, 265, 0, -135, 45, 569),
    (0, 0, 90, -135, 135, 569),
    (270, 0, -90, -180, 180, 455),
    (0, 0, 90, -135, 135, 455),
    (75, 0, 0, -180, 180, 455),
]


def random_joints(seed: int, n: int):
    return np.random.default_rng(seed).uniform(f3.LIMITS[:, 0], f3.LIMITS[:, 1], (n, 7))


def differences(a: RigidTransform, b: RigidTransform) -> tuple[float, float]:
    """Largest distance in mm and largest angle in degrees."""
    between = a.inv() * b
    distance_mm = np.linalg.norm(np.atleast_2d(between.translation), axis=1)
    return float(distance_mm.max()), float(np.rad2deg(between.rotation.magnitude()).max())


def test_model_is_the_product_of_the_published_dh_matrices():
    joints = random_joints(1, 50)
    # The zeros of f3.py: joints 2 and 3 turn downwards, the forearm continues the upper arm.
    theta_deg = np.rad2deg(joints[:, 1:]) * [1, -1, -1, 1, 1, 1] + [0, 0, 90, 0, 0, 0]
    for k in range(len(joints)):
        expected = np.eye(4)
        expected[1, 3] = joints[k, 0]
        for (d, a, twist_deg, *_), angle_deg in zip(F3_TABLE, theta_deg[k], strict=True):
            c, s = np.cos(np.deg2rad(angle_deg)), np.sin(np.deg2rad(angle_deg))
            ct, st = np.cos(np.deg2rad(twist_deg)), np.sin(np.deg2rad(twist_deg))
            expected = expected @ [
                [c, -s * ct, s * st, a * c],
                [s, c * ct, -c * st, a * s],
                [0, st, ct, d],
                [0, 0, 0, 1],
            ]
        for pose in (f3.flange_by_simulator, f3.flange_by_controller):
            np.testing.assert_allclose(pose(joints[k : k + 1])[0].as_matrix(), expected, atol=1e-9)


def test_model_has_the_published_limits_and_the_code_has_the_models():
    model = f3.model_spec().compile()
    for name, low, high in zip(("track", *[f"joint{i}" for i in range(1, 7)]), *f3.LIMITS.T,
                               strict=True):  # fmt: skip
        scale = 0.001 if name == "track" else 1.0
        np.testing.assert_allclose(model.joint(name).range, [scale * low, scale * high], atol=1e-12)
    published = np.array([row[3:5] for row in F3_TABLE])
    np.testing.assert_allclose(np.rad2deg(f3.LIMITS[1:]), published, atol=1e-9)
    np.testing.assert_allclose(np.deg2rad(f3.PULSES[1:]), [row[5] for row in F3_TABLE])


def test_tool_centre_point_of_the_model_is_the_nominal_one():
    model = f3.model_spec().compile()
    np.testing.assert_allclose(
        1000 * model.site("tool_centre_point").pos, TOOL_CENTRE_POINT.translation
    )


def test_level_arm_holds_the_sensor_upright_and_the_waist_turns_about_its_x():
    level = f3.flange_by_simulator(np.zeros((1, 7)))[0] * TOOL_CENTRE_POINT
    # Columns: X up, Y to the right, Z to the front.
    np.testing.assert_allclose(
        level.rotation.as_matrix(), [[0, 0, 1], [0, -1, 0], [1, 0, 0]], atol=1e-12
    )
    np.testing.assert_allclose(level.translation, [100 + 265 + 270 + 75 + 210, 0, 350], atol=1e-9)
    turned = f3.flange_by_simulator(np.array([[0, 0.3, 0, 0, 0, 0, 0]]))[0]
    np.testing.assert_allclose((level.inv() * turned).rotation.as_rotvec(), [0.3, 0, 0], atol=1e-12)


def test_every_way_of_holding_reaches_the_pose_and_the_given_one_is_among_them():
    joints = random_joints(2, 60)
    poses = f3.flange_by_controller(joints)
    for k in range(len(joints)):
        ways, excess_mm = f3.joints_along(poses[k : k + 1], joints[k, :1])
        held = ways[0, excess_mm[0, :, 0] == 0.0, 0]
        distance_mm, angle_deg = differences(poses[k], f3.flange_by_simulator(held))
        assert distance_mm < 1e-9
        assert angle_deg < 1e-9
        off = held[:, 1:] - joints[k, 1:]
        off -= 2 * np.pi * np.rint(off / (2 * np.pi))
        assert np.abs(off).max(axis=1).min() < 1e-7


def test_arm_bent_into_itself_is_noticed():
    free, bent = np.deg2rad([[0, 0, -90, 90, 0, 0, 0], [0, 0, -90, 90, 0, 135, 0]])
    assert f3.self_contact(free[None]) is None
    assert f3.self_contact(np.array([free, free, bent])) == (2, "forearm", "flange")
