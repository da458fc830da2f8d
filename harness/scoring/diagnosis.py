"""The thesis method entered with the truth, to find the stage where accuracy is lost.

Truth comes from the rays of a view without noise, which know the surface that each one met.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy import ndimage
from scipy.spatial.transform import RigidTransform

from registration.result import RegistrationResult
from registration.scan import BoolArray, FloatArray, IntArray, Scan
from registration.thesis.outcome import decide
from registration.thesis.params import ThesisParams
from registration.thesis.patches import Patches, build_patches
from registration.thesis.pipeline import register_patches, register_scans, register_segments
from registration.thesis.rotation import RotationSearch
from registration.thesis.segments import Segments
from registration.thesis.view_params import PatchParams
from sensors.sensor import Hits

TOUCHING = np.ones((3, 3), dtype=bool)  # pixels of a face that meet at a corner are connected


def register_with_true_segments(
    target: Hits, source: Hits, step_mm: float, apex_mm: FloatArray, params: ThesisParams
) -> RegistrationResult:
    """Enter `thesis` after segmentation, with the exact lines that every profile has on a face."""
    minimum = params.segments.min_points
    return register_segments(
        true_segments(target, apex_mm, minimum)[0],
        true_segments(source, apex_mm, minimum)[0],
        params,
        Scan.from_points(target.points_mm, step_mm, apex_mm=apex_mm),
        Scan.from_points(source.points_mm, step_mm, apex_mm=apex_mm),
    )


def register_with_true_patches(
    target: Hits, source: Hits, step_mm: float, apex_mm: FloatArray, params: ThesisParams
) -> RegistrationResult:
    """Enter `thesis` after patch segmentation, with the exact visible part of every face."""
    return register_patches(
        true_patches(target, apex_mm, params),
        true_patches(source, apex_mm, params),
        params,
    )


def register_with_true_rotation(
    target: Scan, source: Scan, T_target_source: RigidTransform, params: ThesisParams
) -> RegistrationResult:
    """Run `thesis` on scans, with the exact rotation in place of the one it finds."""
    found = register_scans(target, source, params)
    target_view, source_view = found.evidence["target"], found.evidence["source"]
    if len(target_view.patches) == 0 or len(source_view.patches) == 0:
        return found
    search = RotationSearch(T_target_source.rotation.as_matrix()[None], np.ones(1))
    return decide(target_view, source_view, search, params)


def true_segments(hits: Hits, apex_mm: FloatArray, min_points: int) -> tuple[Segments, IntArray]:
    """The runs of neighbouring pixels that meet one face, as exact segments.

    Returns them in the order of profiles and pixels, and with each the connected visible part of
    a face that it belongs to: (n,) numbered from 0.
    """
    part = visible_parts(hits.surface)
    profile, first, last = _runs(part)
    long = last - first + 1 >= max(min_points, 2)
    profile, first, last = profile[long], first[long], last[long]
    ends = hits.points_mm[profile[:, None], np.stack([first, last], axis=1)]
    span = ends[:, 1] - ends[:, 0]
    length = np.linalg.norm(span, axis=1)
    direction = span / length[:, None]
    total = np.concatenate([np.zeros((part.shape[0], 1, 3)),
                            np.cumsum(np.nan_to_num(hits.points_mm), axis=1)], axis=1)  # fmt: skip
    count = last - first + 1
    centroid = (total[profile, last + 1] - total[profile, first]) / count[:, None]
    normal = np.stack([np.zeros(len(span)), direction[:, 2], -direction[:, 1]], axis=1)
    normal /= np.linalg.norm(normal, axis=1, keepdims=True)
    apex = apex_mm + hits.origins_mm[profile]
    normal[np.einsum("nj,nj->n", normal, apex - centroid) < 0.0] *= -1.0
    segments = Segments(
        profile, first, last, centroid, direction, normal, length, ends, count.astype(np.int64)
    )
    return segments, part[profile, first]


def true_patches(hits: Hits, apex_mm: FloatArray, params: ThesisParams) -> Patches:
    """The connected visible parts of the faces, as exact patches."""
    segments, part = true_segments(hits, apex_mm, params.segments.min_points)
    exact = PatchParams(triplets="fitted", min_profiles=params.patches.min_profiles)
    return build_patches(segments, part, exact)


def only(hits: Hits, kept: BoolArray) -> Hits:
    """The hits of the chosen beams, (profiles, pixels); the others return nothing."""
    return replace(
        hits,
        points_mm=np.where(kept[..., None], hits.points_mm, np.nan),
        surface=np.where(kept, hits.surface, -1),
        normal=np.where(kept[..., None], hits.normal, np.nan),
    )


def visible_parts(surface: IntArray) -> IntArray:
    """(profiles, pixels) number of the connected part of a face at each pixel, -1 for none."""
    part = np.full(surface.shape, -1, dtype=np.int64)
    found = 0
    for index in np.unique(surface[surface >= 0]):
        labels, n_labels = ndimage.label(surface == index, structure=TOUCHING)
        inside = labels > 0
        part[inside] = labels[inside] - 1 + found
        found += n_labels
    return part


def _runs(part: IntArray) -> tuple[IntArray, IntArray, IntArray]:
    """Profile, first and last pixel of every run of one part."""
    edge = np.full((part.shape[0], 1), -2, dtype=np.int64)
    change = np.diff(np.hstack([edge, part, edge]), axis=1) != 0
    profile, boundary = np.nonzero(change)
    same = profile[1:] == profile[:-1]
    profile, first, last = profile[:-1][same], boundary[:-1][same], boundary[1:][same] - 1
    kept = part[profile, first] >= 0
    return profile[kept], first[kept], last[kept]
