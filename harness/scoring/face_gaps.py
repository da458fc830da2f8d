"""How far apart two views see the middle of the same face: what shifts of centroids cannot undo."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.spatial.transform import RigidTransform

from harness.scoring.diagnosis import only, true_patches
from registration.scan import FloatArray
from registration.thesis.params import ThesisParams
from sensors.sensor import Hits

AXES = ("X (motion)", "Y (lateral)", "Z (depth)")


@dataclass(frozen=True)
class FaceGaps:
    """Of one pair of views, target's centroid less source's of the same face, mm, target's frame.

    visible_mm: (n, 3) of all that each view sees of the n faces that have a patch in both.
    shared_mm: (k, 3) of what both views see of a face.
    """

    visible_mm: FloatArray
    shared_mm: FloatArray


def centroid_gaps(
    target: Hits,
    source: Hits,
    T_target_source: RigidTransform,
    apex_mm: FloatArray,
    params: ThesisParams,
) -> FloatArray:
    """(n, 3) mm from the source's to the target's centroid of each face, under the exact pose.

    Centroids are those of the exact patches, as the method takes them (section 5.4); of a face in
    several parts, the two that lie nearest to each other. Faces without a patch in either view are
    left out.
    """
    gaps = []
    for face in np.intersect1d(target.surface[target.valid], source.surface[source.valid]):
        seen_at, taken_to = (
            true_patches(only(hits, hits.surface == face), apex_mm, params).centroid_mm
            for hits in (target, source)
        )
        if len(seen_at) == 0 or len(taken_to) == 0:
            continue
        between = seen_at[:, None] - T_target_source.apply(taken_to)[None]
        between = between.reshape(-1, 3)
        gaps.append(between[np.linalg.norm(between, axis=1).argmin()])
    return np.array(gaps).reshape(-1, 3)


def gaps_in_words(gaps: FaceGaps) -> str:
    """What the gaps of a pair mean, in one sentence; nothing where no face has two patches."""
    n = len(gaps.visible_mm)
    if n == 0:
        return ""
    apart_mm = float(np.median(np.linalg.norm(gaps.visible_mm, axis=1)))
    axis = AXES[int(np.median(np.abs(gaps.visible_mm), axis=0).argmax())]
    faces = f"{n} faces that both views see lie a median of" if n > 1 else "one shared face lie"
    text = (
        f"the centroids of the {faces} {apart_mm:.1f} mm apart under the exact pose, mostly along "
        f"{axis}, as each view sees another part of a face"
    )
    if len(gaps.shared_mm):
        shared_mm = float(np.median(np.linalg.norm(gaps.shared_mm, axis=1)))
        text += f"; cut to what both see, {shared_mm:.1f} mm"
    return text + "."
