from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation

from harness.scoring import six_parameters
from harness.scoring.bound import (
    Beams,
    parameter_deviations,
    pose_covariance,
    pose_information,
)


def square_grid(normal, centre_mm, half_mm: float, count: int):
    """Points (count^2, 3) of a square face."""
    tangents = np.linalg.svd(np.asarray(normal, dtype=float)[None, :])[2][1:]
    line = np.linspace(-half_mm, half_mm, count)
    u, v = (g.ravel() for g in np.meshgrid(line, line))
    return centre_mm + u[:, None] * tangents[0] + v[:, None] * tangents[1]


def beams_on(faces, sigma_mm: float, origin_mm) -> Beams:
    """Beams from one point to points on faces (normal, points)."""
    points = np.concatenate([p for _, p in faces])
    normal = np.concatenate([np.broadcast_to(n, p.shape) for n, p in faces])
    face = np.repeat(np.arange(len(faces)), [len(p) for _, p in faces])
    away = points - origin_mm
    beam = away / np.abs(away[:, 2:])
    return Beams(points, beam, normal, face, np.full(len(points), sigma_mm**2))


def perturbed(T: RigidTransform, change) -> RigidTransform:
    """A pose after a perturbation (rad, mm) on its left."""
    return RigidTransform.from_components(change[3:], Rotation.from_rotvec(change[:3])) * T


def test_three_orthogonal_squares_have_the_bound_of_the_closed_form() -> None:
    # Squares whose middles lie on their own normals through the origin: with N points of variance
    # s^2 across the face and mean square extent q along each tangent, two equal views leave
    # 2 s^2 / N on each translation and s^2 / (N q) on each turn, and no correlation.
    count, half, distance, sigma = 11, 40.0, 300.0, 0.7
    normals = np.eye(3)
    faces = [(n, square_grid(n, distance * n, half, count)) for n in normals]
    points = np.concatenate([p for _, p in faces])
    normal = np.repeat(normals, count**2, axis=0)
    face = np.repeat(np.arange(3), count**2)
    # Every beam meets its face with n . b = 0.6.
    beam = 0.6 * normal + 0.8 * np.roll(normal, 1, axis=1)
    view = Beams(points, beam, normal, face, np.full(len(points), (sigma / 0.6) ** 2))
    covariance = pose_covariance(pose_information(view, view))
    q = np.mean(np.linspace(-half, half, count) ** 2)
    turn, shift = sigma**2 / (count**2 * q), 2.0 * sigma**2 / count**2
    np.testing.assert_allclose(
        covariance, np.diag([turn] * 3 + [shift] * 3), rtol=1e-9, atol=1e-12 * shift
    )


@pytest.fixture
def tilted_pair() -> tuple[Beams, Beams]:
    """Two views of four tilted faces; each sees another part of each, and the last of only one."""
    rng = np.random.default_rng(7)
    normals = np.array([[0.5, 0.1, -1], [-0.4, 0.5, -1], [0.1, -0.6, -1], [0.3, 0.4, -1.0]])
    normals /= np.linalg.norm(normals, axis=1, keepdims=True)
    centres = np.array([[0, -90, 800], [80, 10, 700], [-60, 60, 900], [10, 100, 850.0]])
    views = []
    for origin, sigma, faces in (((20.0, 30.0, -40.0), 0.4, 4), ((-60.0, 200.0, 30.0), 0.9, 3)):
        shown = [
            (n, square_grid(n, c, 35.0, 6) + rng.uniform(-9, 9) * np.cross(n, [0, 0, 1.0]))
            for n, c in zip(normals[:faces], centres, strict=False)
        ]
        views.append(beams_on(shown, sigma, np.array(origin)))
    return views[0], views[1]


def measured_depths(view: Beams, pose: RigidTransform, normals, offsets):
    """Depths along the beams at which rays of a moved view meet planes, beyond the exact points.

    pose moves the view's points; the plane is n . p = offset.
    """
    points, beam = pose.apply(view.points_mm), pose.rotation.apply(view.beam)
    n = normals[view.face]
    return (offsets[view.face] - np.sum(n * points, axis=1)) / np.sum(n * beam, axis=1)


def full_model(target: Beams, source: Beams):
    """Weighted depths of both views as a function of the pose's perturbation and all planes.

    A plane has three free numbers, n_x / n_z, n_y / n_z and offset / n_z: another choice than the
    bound's own.
    """
    faces = int(max(target.face.max(), source.face.max())) + 1
    exact = np.zeros((faces, 3))
    for f in range(faces):
        n = target.normal[target.face == f][0]
        exact[f] = [n[0] / n[2], n[1] / n[2], n @ target.points_mm[target.face == f][0] / n[2]]

    def predict(unknowns):
        planes = unknowns[6:].reshape(-1, 3)
        normals = np.column_stack([planes[:, :2], np.ones(faces)])
        still = RigidTransform.identity()
        moved = perturbed(still, unknowns[:6])
        return np.concatenate(
            [
                measured_depths(view, pose, normals, planes[:, 2]) / np.sqrt(view.variance_mm2)
                for view, pose in ((target, still), (source, moved))
            ]
        )

    return predict, np.concatenate([np.zeros(6), exact.ravel()])


def slopes_of(predict, exact):
    """Central differences of the full model."""
    steps = np.array([1e-5] * 3 + [1e-3] * 3 + [1e-5, 1e-5, 1e-3] * 4)
    return np.column_stack(
        [
            (predict(exact + step * unit) - predict(exact - step * unit)) / (2.0 * step)
            for step, unit in zip(steps, np.eye(len(exact)), strict=True)
        ]
    )


def test_the_bound_is_that_of_the_full_model_with_planes_as_unknowns(tilted_pair) -> None:
    predict, exact = full_model(*tilted_pair)
    assert np.abs(predict(exact)).max() < 1e-9
    jacobian = slopes_of(predict, exact)
    scale = 1.0 / np.linalg.norm(jacobian, axis=0)
    inverse = np.linalg.inv((jacobian * scale).T @ (jacobian * scale)) * np.outer(scale, scale)
    np.testing.assert_allclose(
        pose_covariance(pose_information(*tilted_pair)), inverse[:6, :6], rtol=1e-5, atol=1e-12
    )


def test_maximum_likelihood_attains_the_bound(tilted_pair) -> None:
    predict, exact = full_model(*tilted_pair)
    rng = np.random.default_rng(3)
    trials = 400
    slopes = slopes_of(predict, exact)  # near enough everywhere to lead to the minimum
    errors = np.empty((trials, 6))
    scale = np.array([1e-3] * 3 + [1.0] * 3 + [1e-2, 1e-2, 1.0] * 4)
    for trial in range(trials):
        noise = rng.standard_normal(len(predict(exact)))
        fit = least_squares(
            lambda u, e=noise: predict(u) - e, exact, lambda u: slopes, x_scale=scale, method="lm"
        )
        errors[trial] = fit.x[:6]
    covariance = pose_covariance(pose_information(*tilted_pair))
    # The pose enters as what moves the source's points, whose noise was added with that sign.
    nees = np.einsum("ti,ij,tj->t", errors, np.linalg.inv(covariance), errors)
    # The mean of chi-square with 6 degrees of freedom, within 4 standard errors.
    assert abs(nees.mean() - 6.0) < 4.0 * np.sqrt(12.0 / trials)
    ratio = np.sqrt(np.mean(errors**2, axis=0) / np.diag(covariance))
    np.testing.assert_allclose(ratio, 1.0, atol=4.0 / np.sqrt(2.0 * trials))


def test_moving_the_frame_moves_the_bound_along(tilted_pair) -> None:
    motion = RigidTransform.from_components(
        [40.0, -70.0, 300.0], Rotation.from_rotvec([0.3, -0.8, 0.5])
    )
    moved = [
        Beams(
            motion.apply(view.points_mm), motion.rotation.apply(view.beam),
            motion.rotation.apply(view.normal), view.face, view.variance_mm2,
        )
        for view in tilted_pair
    ]  # fmt: skip
    # (w, t) becomes (R w, R t - (R w) x d).
    turn, shift = motion.rotation.as_matrix(), motion.translation
    cross = np.array([[0, -shift[2], shift[1]], [shift[2], 0, -shift[0]], [-shift[1], shift[0], 0]])
    adjoint = np.block([[turn, np.zeros((3, 3))], [cross @ turn, turn]])
    before = pose_covariance(pose_information(*tilted_pair))
    np.testing.assert_allclose(
        pose_covariance(pose_information(*moved)), adjoint @ before @ adjoint.T, rtol=1e-6
    )


def test_more_points_never_loosen_the_bound(tilted_pair) -> None:
    target, source = tilted_pair
    part = Beams(*(field[::3] for field in source))
    whole, less = pose_information(target, source), pose_information(target, part)
    assert np.linalg.eigvalsh(whole - less).min() > -1e-6 * np.linalg.eigvalsh(whole).max()


def test_two_faces_leave_a_direction_open(tilted_pair) -> None:
    target, source = tilted_pair
    two = Beams(*(field[source.face < 2] for field in source))
    assert pose_covariance(pose_information(target, two)) is None
    none = Beams(*(field[:0] for field in source))
    assert pose_covariance(pose_information(target, none)) is None


def test_deviations_of_the_six_parameters_follow_small_perturbations() -> None:
    rng = np.random.default_rng(11)
    for _ in range(20):
        T = RigidTransform.from_components(
            rng.uniform(-500, 500, 3), Rotation.from_rotvec(rng.uniform(-0.8, 0.8, 3))
        )
        root = rng.standard_normal((6, 6)) * np.array([1e-4] * 3 + [0.1] * 3)[:, None]
        covariance = root @ root.T
        step = 1e-3
        slopes = np.column_stack(
            [
                (six_parameters(perturbed(T, step * column))
                 - six_parameters(perturbed(T, -step * column))) / (2.0 * step)
                for column in root.T
            ]
        )  # fmt: skip
        np.testing.assert_allclose(
            parameter_deviations(covariance, T), np.linalg.norm(slopes, axis=1), rtol=1e-5
        )
