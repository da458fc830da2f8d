"""Planar patches from chains of segments (section 5.4)."""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from registration.scan import BoolArray, FloatArray, IntArray, Scan
from registration.thesis.irregular import covered_points, join_transitions, strip_areas
from registration.thesis.merging import stretch_shared
from registration.thesis.planes import fit_planes
from registration.thesis.segments import Segments
from registration.thesis.triplets import triplet_points
from registration.thesis.view_params import PatchParams

_NO_AREA_MM2 = 1e-6


@dataclass(frozen=True)
class Patches:
    """The planar patches of one view.

    normal: (m, 3) unit, towards the sensor.
    offset_mm: (m,) with normal . p = offset_mm on the plane.
    centroid_mm: (m, 3) mean of the patch's points, as section 5.4 defines it; of an irregular one
        the middle of its area.
    area_mm2: (m,) area swept by the segments on the plane.
    corners_mm: (m, 4, 3) ends of the first segment, then of the last in reverse, on the plane.
    count: (m,) number of segments.
    profile_first, profile_last: (m,) inclusive.
    intermediate: (m,) True for a patch that bridges two groups of profiles.
    points_mm, point_patch: (q, 3), (q,) the points the planes were fitted to, and their patch.
    """

    normal: FloatArray
    offset_mm: FloatArray
    centroid_mm: FloatArray
    area_mm2: FloatArray
    corners_mm: FloatArray
    count: IntArray
    profile_first: IntArray
    profile_last: IntArray
    intermediate: BoolArray
    points_mm: FloatArray
    point_patch: IntArray

    def __len__(self) -> int:
        return len(self.normal)


def build_patches(
    segments: Segments, chain: IntArray, params: PatchParams, scan: Scan | None = None
) -> Patches:
    """Fit a plane to the three points, or to all, that each segment of a chain contributes.

    segments, chain: as of find_segments and merge_profiles.
    scan: where the readings "carried" and "measured" look depths up; not needed for "fitted", nor
        for irregular patches.
    Section 5.4; plane by (5-2), (5-3) or by the centred scatter (corrected). Irregular patches and
    transition zones: chapter 7.
    """
    members = _members(segments, chain, params)
    index = np.array([s for chain_members, _ in members for s in chain_members], dtype=np.int64)
    patch = np.repeat(np.arange(len(members)), [len(c) for c, _ in members])
    if params.shape == "irregular":
        points, point_patch = covered_points(segments, index, patch, scan)
    else:
        points = triplet_points(segments, index, patch, params, scan).reshape(-1, 3)
        point_patch = np.repeat(patch, 3)
    normal, centroid = fit_planes(points, point_patch, len(members), params.plane)
    facing = np.zeros((len(members), 3))
    np.add.at(facing, patch, segments.normal[index])
    normal *= np.where(np.einsum("mj,mj->m", normal, facing) < 0.0, -1.0, 1.0)[:, None]
    starts = np.searchsorted(patch, np.arange(len(members)))
    stops = np.searchsorted(patch, np.arange(len(members)), side="right") - 1
    offset = np.einsum("mj,mj->m", normal, centroid)
    if params.shape == "irregular":
        area, centroid = strip_areas(segments, index, patch, normal, offset)
    else:
        area = _swept_area(segments, index, patch, normal, len(members))
    return Patches(
        normal=normal,
        offset_mm=offset,
        centroid_mm=centroid,
        area_mm2=area,
        corners_mm=_corners(segments, index[starts], index[stops], normal, offset),
        count=stops - starts + 1,
        profile_first=segments.profile[index[starts]],
        profile_last=segments.profile[index[stops]],
        intermediate=np.array([bridge for _, bridge in members], dtype=bool),
        points_mm=points,
        point_patch=point_patch,
    )


def _members(
    segments: Segments, chain: IntArray, params: PatchParams
) -> list[tuple[IntArray, bool]]:
    """Segments of every patch in order of profiles, and whether it is an intermediate one."""
    kept = _kept(segments, chain, params)
    if params.transitions:
        kept = _kept(segments, join_transitions(segments, chain, kept, params.coplanar_mm), params)
    members = [(c, False) for c in kept]
    if params.intermediate:
        members += [(pair, True) for pair in _bridges(segments, kept, params.parallel_th_rad)]
    return members


def _kept(segments: Segments, chain: IntArray, params: PatchParams) -> list[IntArray]:
    """The chains that make a patch: long enough, and not just points."""
    order = np.argsort(chain, kind="stable")
    bounds = np.flatnonzero(np.diff(chain[order], prepend=-1, append=-1))
    chains = [order[a:b] for a, b in pairwise(bounds)]
    return [c for c in chains if len(c) >= params.min_profiles and _sweeps(segments, c)]


def _bridges(segments: Segments, chains: list[IntArray], parallel_th_rad: float) -> list[IntArray]:
    """Pairs of parallel segments where one chain ends and another begins a profile later."""
    begins: dict[int, list[int]] = {}
    for c in chains:
        begins.setdefault(int(segments.profile[c[0]]), []).append(int(c[0]))
    bridges = []
    for c in chains:
        a = int(c[-1])
        neighbours = begins.get(int(segments.profile[a]) + 1, [])
        best, partner = 0.0, -1
        for b in neighbours:
            sine = float(np.linalg.norm(np.cross(segments.direction[a], segments.direction[b])))
            shared = stretch_shared(segments, a, b)
            if sine <= np.sin(parallel_th_rad) and shared > best:
                best, partner = shared, b
        if partner >= 0:
            pair = np.array([a, partner], dtype=np.int64)
            bridges += [pair] if _sweeps(segments, pair) else []
    return bridges


def _sweeps(segments: Segments, chain: IntArray) -> bool:
    """Tell whether segments cover an area: the sensor moved, and they are longer than points."""
    x, length = segments.centroid_mm[chain, 0], segments.length_mm[chain]
    strips = (length[1:] + length[:-1]) * np.abs(np.diff(x))
    return bool(strips.sum() > _NO_AREA_MM2)


def _swept_area(
    segments: Segments, index: IntArray, patch: IntArray, normal: FloatArray, n_patches: int
) -> FloatArray:
    """(m,) sum over neighbouring segments of mean length times their distance on the plane.

    Sections of a plane by planes of constant X, step apart, are step / sqrt(1 - n_x^2) apart.
    """
    same = patch[1:] == patch[:-1]
    length = segments.length_mm[index]
    x = segments.centroid_mm[index, 0]
    spread = np.sqrt(np.maximum(1.0 - normal[patch[1:], 0] ** 2, 1e-12)) if len(patch) else x[1:]
    strip = 0.5 * (length[1:] + length[:-1]) * np.abs(np.diff(x)) / spread
    area = np.zeros(n_patches)
    np.add.at(area, patch[1:][same], strip[same])
    return area


def _corners(
    segments: Segments, first: IntArray, last: IntArray, normal: FloatArray, offset_mm: FloatArray
) -> FloatArray:
    """(m, 4, 3) endpoints of the outer segments, dropped on the plane."""
    ends = np.concatenate(
        [segments.endpoints_mm[first], segments.endpoints_mm[last][:, ::-1]], axis=1
    )
    height = np.einsum("mej,mj->me", ends, normal) - offset_mm[:, None]
    corners: FloatArray = ends - height[..., None] * normal[:, None, :]
    return corners
