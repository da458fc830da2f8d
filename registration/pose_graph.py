"""The poses of many views from their pairwise registrations: by a chain, or all loops closed.

Beyond the thesis, which multiplies two registrations (section 6.4). Poses are in mm; every
covariance (6, 6) is of (rotation vector rad, translation mm) of a perturbation D applied on the
left, T = D T_estimated, as in RegistrationResult.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.spatial.transform import RigidTransform, Rotation
from scipy.stats import chi2

from registration.scan import FloatArray

# A residual beyond what chance allows once in 20 is on its way out.
CAUCHY2 = float(chi2.ppf(0.95, 6))
ROUNDS = 50


class PoseGraphError(ValueError):
    """Relative poses that cannot be a graph; the message says which and why."""


@dataclass(frozen=True)
class RelativePose:
    """One registration: p_target = T_target_source p_source, and how sure it is."""

    target: str
    source: str
    T_target_source: RigidTransform
    covariance: FloatArray


@dataclass(frozen=True)
class ViewPoses:
    """The pose of every view in the frame of the reference view, and how well the edges agree.

    views: (n,) names, the reference first. T_reference_view: (n,) poses.
    covariance: (n, 6, n, 6) of all poses together; zero for the reference.
    distance2: (edges,) squared Mahalanobis distance between each relative pose as it was given and
        as it is now. weight: (edges,) 1 for a relative pose that is believed, towards 0 for one
        that contradicts the others.
    p_value: how often chance alone would make the edges disagree more, by the chi-squared
        distribution of the weights at 1; 1 without a loop. Below 0.01 some edge is wrong: which
        one, the weights tell only where every edge lies in two loops or more.
    """

    views: tuple[str, ...]
    T_reference_view: RigidTransform
    covariance: FloatArray
    distance2: FloatArray
    weight: FloatArray
    p_value: float

    def relative(self, target: str, source: str) -> RelativePose:
        """The pose between any two views, with its covariance; raises PoseGraphError."""
        t, s = (self._index(name) for name in (target, source))
        T_target_reference = self.T_reference_view[t].inv()
        joint = self.covariance
        apart = joint[s, :, s] + joint[t, :, t] - joint[s, :, t] - joint[t, :, s]
        carried = adjoint(T_target_reference)
        pose = T_target_reference * self.T_reference_view[s]
        return RelativePose(target, source, pose, carried @ apart @ carried.T)

    def _index(self, name: str) -> int:
        if name not in self.views:
            raise PoseGraphError(f"unknown view {name!r}; known are {', '.join(self.views)}")
        return self.views.index(name)


def chain_poses(edges: Sequence[RelativePose], reference: str) -> ViewPoses:
    """Multiply relative poses from each view to the reference, along the fewest.

    Of equally short chains the one whose edges come first is taken; what closes a loop is not used.
    Raises PoseGraphError.
    """
    views, starts, paths = _spanning_tree(edges, reference)
    whitening = _whitening(edges)
    jacobian = _slopes(edges, views, starts)
    used = sorted({edge for path in paths for edge in path})
    whitened = np.einsum("eij,ejvk->eivk", whitening, jacobian)[used]
    covariance = _joint_covariance(whitened, len(views))
    distance2 = _distances2(edges, views, starts, whitening)
    weight = np.isin(np.arange(len(edges)), used).astype(np.float64)
    return ViewPoses(views, starts, covariance, distance2, weight, 1.0)


def close_loops(edges: Sequence[RelativePose], reference: str, robust: bool = True) -> ViewPoses:
    """Find the poses that agree best with all relative poses, each weighted by its covariance.

    Least squares of the rotation vectors and translations that are left between the given and the
    resulting relative poses, whitened. robust: weigh an edge by 1 / (1 + d^2 / 12.6), d its
    Mahalanobis distance (Cauchy's function by iterated weights; 12.6 is exceeded once in 20).
    Raises PoseGraphError.
    """
    views, poses, _ = _spanning_tree(edges, reference)
    whitening = _whitening(edges)
    weight = np.ones(len(edges))
    poses = _least_squares(edges, views, poses, whitening, weight)
    distance2 = _distances2(edges, views, poses, whitening)
    freedom = 6 * (len(edges) - len(views) + 1)
    p_value = float(chi2.sf(distance2.sum(), freedom)) if freedom else 1.0
    for _ in range(ROUNDS if robust and freedom else 0):
        before, weight = weight, 1.0 / (1.0 + distance2 / CAUCHY2)
        # Where an edge is far off, all weights are tiny at first: only their ratios matter.
        if np.abs(weight - before).max() < 1e-5 * weight.max():
            break
        poses = _least_squares(edges, views, poses, whitening, weight)
        distance2 = _distances2(edges, views, poses, whitening)
    jacobian = _slopes(edges, views, poses)
    whitened = np.einsum("e,eij,ejvk->eivk", np.sqrt(weight), whitening, jacobian)
    covariance = _joint_covariance(whitened, len(views))
    return ViewPoses(views, poses, covariance, distance2, weight, p_value)


def adjoint(pose: RigidTransform) -> FloatArray:
    """(..., 6, 6) that carries a small perturbation D to T D T^-1, rotation vector first."""
    R, t = pose.rotation.as_matrix(), np.asarray(pose.translation)
    carried = np.zeros((*R.shape[:-2], 6, 6))
    carried[..., :3, :3] = carried[..., 3:, 3:] = R
    carried[..., 3:, :3] = _cross(t) @ R
    return carried


def _spanning_tree(
    edges: Sequence[RelativePose], reference: str
) -> tuple[tuple[str, ...], RigidTransform, list[list[int]]]:
    """All views, their poses along the fewest edges, and which edges those are."""
    if not edges:
        raise PoseGraphError("no relative pose is given")
    for edge in edges:
        if edge.target == edge.source:
            raise PoseGraphError(f"a relative pose leads from view {edge.target!r} to itself")
    names = dict.fromkeys(name for edge in edges for name in (edge.target, edge.source))
    if reference not in names:
        raise PoseGraphError(f"unknown reference {reference!r}; known are {', '.join(names)}")
    found: dict[str, tuple[RigidTransform, list[int]]] = {
        reference: (RigidTransform.identity(), [])
    }
    waiting = deque([reference])
    while waiting:
        here = waiting.popleft()
        pose, path = found[here]
        for index, edge in enumerate(edges):
            if edge.target == here and edge.source not in found:
                found[edge.source] = (pose * edge.T_target_source, [*path, index])
                waiting.append(edge.source)
            elif edge.source == here and edge.target not in found:
                found[edge.target] = (pose * edge.T_target_source.inv(), [*path, index])
                waiting.append(edge.target)
    lost = [name for name in names if name not in found]
    if lost:
        raise PoseGraphError(
            f"no chain of relative poses links {', '.join(map(repr, lost))} to {reference!r}"
        )
    views = tuple(found)
    poses = RigidTransform.concatenate([found[name][0] for name in views])
    return views, poses, [found[name][1] for name in views]


def _whitening(edges: Sequence[RelativePose]) -> FloatArray:
    """(edges, 6, 6) W, with W^T W the information of each; raises PoseGraphError."""
    whitening = np.empty((len(edges), 6, 6))
    for edge, upper in zip(edges, whitening, strict=True):
        matrix = np.asarray(edge.covariance)
        good = matrix.shape == (6, 6) and np.isfinite(matrix).all()
        covariance = 0.5 * (matrix + matrix.T) if good else np.zeros((6, 6))
        if np.linalg.eigvalsh(covariance)[0] <= 0.0:
            raise PoseGraphError(
                f"the covariance from {edge.source!r} to {edge.target!r} is no positive definite "
                "(6, 6) matrix; a pose that is open in some direction cannot be an edge"
            )
        upper[:] = np.linalg.cholesky(np.linalg.inv(covariance)).T
    return whitening


def _ends(edges: Sequence[RelativePose], views: tuple[str, ...]) -> tuple[list[int], list[int]]:
    place = {name: index for index, name in enumerate(views)}
    return [place[edge.target] for edge in edges], [place[edge.source] for edge in edges]


def _residual_poses(
    edges: Sequence[RelativePose], views: tuple[str, ...], poses: RigidTransform
) -> RigidTransform:
    """(edges,) the perturbation on the left of each given relative pose that makes it the found."""
    target, source = _ends(edges, views)
    given = RigidTransform.concatenate([edge.T_target_source for edge in edges])
    return poses[target].inv() * poses[source] * given.inv()


def _residuals(
    edges: Sequence[RelativePose], views: tuple[str, ...], poses: RigidTransform
) -> FloatArray:
    """(edges, 6) rotation vectors in rad and translations in mm."""
    left = _residual_poses(edges, views, poses)
    return np.concatenate([left.rotation.as_rotvec(), left.translation], axis=1)


def _distances2(
    edges: Sequence[RelativePose],
    views: tuple[str, ...],
    poses: RigidTransform,
    whitening: FloatArray,
) -> FloatArray:
    white = np.einsum("eij,ej->ei", whitening, _residuals(edges, views, poses))
    squared: FloatArray = np.sum(white**2, axis=1)
    return squared


def _slopes(
    edges: Sequence[RelativePose], views: tuple[str, ...], poses: RigidTransform
) -> FloatArray:
    """Derivative (edges, 6, views, 6) of the residuals by perturbations on the left of poses."""
    target, source = _ends(edges, views)
    left = _residual_poses(edges, views, poses)
    to_residual = np.tile(np.eye(6), (len(edges), 1, 1))
    to_residual[:, :3, :3] = _turn_to_rotvec(left.rotation.as_rotvec())
    to_residual[:, 3:, :3] = -_cross(np.asarray(left.translation))
    # A perturbation of the source's pose arrives on the left of the residual pose.
    arriving = to_residual @ adjoint(poses[target].inv())
    jacobian = np.zeros((len(edges), 6, len(views), 6))
    every = np.arange(len(edges))
    jacobian[every, :, source] += arriving
    jacobian[every, :, target] -= arriving
    return jacobian


def _turn_to_rotvec(rotvec: FloatArray) -> FloatArray:
    """(..., 3, 3) change of a rotation vector by a small turn on its left."""
    angle = np.linalg.norm(rotvec, axis=-1)
    cross = _cross(rotvec)
    large = np.maximum(angle, 1e-4)
    factor = (1.0 - 0.5 * large / np.tan(0.5 * large)) / large**2
    factor = np.where(angle < 1e-4, 1.0 / 12.0, factor)[..., None, None]
    changed: FloatArray = np.eye(3) - 0.5 * cross + factor * (cross @ cross)
    return changed


def _least_squares(
    edges: Sequence[RelativePose],
    views: tuple[str, ...],
    start: RigidTransform,
    whitening: FloatArray,
    weight: FloatArray,
) -> RigidTransform:
    """Poses of the smallest weighted sum of squared whitened residuals; the reference stays."""
    root = np.sqrt(weight)[:, None, None] * whitening
    free = 6 * (len(views) - 1)

    def moved(x: FloatArray, about: RigidTransform) -> RigidTransform:
        step = np.concatenate([np.zeros((1, 6)), x.reshape(-1, 6)])
        turn = Rotation.from_rotvec(step[:, :3])
        return RigidTransform.from_components(step[:, 3:], turn) * about

    def residuals(x: FloatArray, about: RigidTransform) -> FloatArray:
        white = np.einsum("eij,ej->ei", root, _residuals(edges, views, moved(x, about)))
        return np.asarray(white.ravel())

    def slopes(x: FloatArray, about: RigidTransform) -> FloatArray:
        jacobian = _slopes(edges, views, moved(x, about))
        # By x itself, not by a perturbation of moved(x): a change of a rotation vector turns less
        # and less like itself the longer the vector is.
        step = x.reshape(-1, 6)
        to_left = np.tile(np.eye(6), (len(step), 1, 1))
        to_left[:, :3, :3] = np.linalg.inv(_turn_to_rotvec(step[:, :3]))
        to_left[:, 3:, :3] = _cross(step[:, 3:]) @ to_left[:, :3, :3]
        jacobian[:, :, 1:] = np.einsum("eivk,vkl->eivl", jacobian[:, :, 1:], to_left)
        white = np.einsum("eij,ejvk->eivk", root, jacobian)[:, :, 1:]
        return np.asarray(white.reshape(6 * len(edges), free))

    found = least_squares(
        residuals, np.zeros(free), jac=slopes, args=(start,), x_scale="jac",
        ftol=1e-13, xtol=1e-13, gtol=1e-13,
    )  # fmt: skip
    return moved(found.x, start)


def _joint_covariance(whitened: FloatArray, n_views: int) -> FloatArray:
    """(n, 6, n, 6) inverse of the information; the reference, which comes first, is exact."""
    slope = whitened[:, :, 1:].reshape(-1, 6 * (n_views - 1))
    # By singular values of the slope itself: squared first, rad and mm would lose half the digits.
    _, values, axes = np.linalg.svd(slope, full_matrices=False)
    half = axes.T / values
    covariance = np.zeros((n_views, 6, n_views, 6))
    covariance[1:, :, 1:] = (half @ half.T).reshape(n_views - 1, 6, n_views - 1, 6)
    return covariance


def _cross(vector: FloatArray) -> FloatArray:
    """(..., 3, 3) that multiplies by a vector (..., 3) as the cross product does."""
    matrix = np.zeros((*vector.shape, 3))
    for i, j, k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
        matrix[..., k, j] = vector[..., i]
        matrix[..., j, k] = -vector[..., i]
    return matrix
