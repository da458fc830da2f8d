"""What two views have in common, and the limit that this sets to any registration of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from harness.scoring.bound import beams_of, pose_covariance, pose_information
from harness.scoring.poses import exact_pose
from registration.scan import BoolArray, FloatArray
from scenes.scene import Scene
from sensors.overlap import seen
from sensors.paths import ViewPath
from sensors.sensor import Hits, Sensor
from sensors.sigma import depth_variance_mm2


@dataclass(frozen=True)
class Common:
    """Which points of either view the other sees too, (profiles, pixels), free of noise.

    shares: of the points of the target and of the source; 0 where a view has none.
    """

    target: BoolArray
    source: BoolArray
    shares: tuple[float, float]


def common_points(
    sensor: Sensor, scene: Scene, hits: tuple[Hits, Hits], paths: tuple[ViewPath, ViewPath]
) -> Common:
    """Ask for every point of target and source whether the other view sees it."""
    masks, shares = [], []
    for one in (0, 1):
        measured = hits[one].valid
        points_mm = paths[one].T_world_view.apply(hits[one].points_mm[measured])
        mask = np.zeros(measured.shape, dtype=bool)
        mask[measured] = seen(sensor, scene, paths[1 - one], points_mm, hits[one].surface[measured])
        masks.append(mask)
        shares.append(float(mask.sum() / max(measured.sum(), 1)))
    return Common(masks[0], masks[1], (shares[0], shares[1]))


def pose_bounds(
    sensor: Sensor,
    scene: Scene,
    hits: tuple[Hits, Hits],
    paths: tuple[ViewPath, ViewPath],
    measured: tuple[BoolArray, BoolArray],
    common: Common,
) -> FloatArray | None:
    """Cramer-Rao bounds (2, 6, 6) of a pair: from all points of shared faces, and from common ones.

    measured: which beams of either view really returned, (profiles, pixels). A bound is the least
    covariance of a perturbation (rad, mm) on the left of T_target_source; NaN where the points
    leave a direction open. None where the sensor's noise is not known or is none.
    """
    variances = [depth_variance_mm2(sensor, scene, one) for one in hits]
    poses = RigidTransform.identity(), exact_pose(*paths)
    bounds = np.full((2, 6, 6), np.nan)
    for which, within in enumerate((measured, (common.target, common.source))):
        views = []
        for i, variance in enumerate(variances):
            counted = measured[i] & within[i]
            if variance is None or not (variance[counted & hits[i].valid] > 0.0).all():
                return None
            views.append(beams_of(hits[i], sensor.apex_mm, variance, counted, poses[i]))
        covariance = pose_covariance(pose_information(views[0], views[1]))
        if covariance is not None:
            bounds[which] = covariance
    return bounds
