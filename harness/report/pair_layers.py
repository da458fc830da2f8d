"""One registered pair as the layers and stages that the page shows in 3D."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull, QhullError
from scipy.spatial.transform import RigidTransform

from harness.figures.pair_matches import palette_places, sorted_matches, spheres_of
from harness.figures.pair_view import PairView
from harness.report.nearness import surface_distance
from harness.report.packing import packed
from registration.gauss_sphere.evidence import (
    PlaneEvidence,
    patch_of_points,
    segment_ends,
    shifts_of_middle,
)
from registration.gauss_sphere.view import View
from registration.scan import FloatArray, IntArray, Scan
from registration.thesis.evidence import ViewEvidence
from registration.thesis.gauss_sphere import GaussSphere
from registration.thesis.translation import Shifts

SHOWN_POINTS = 12_000  # of a scan, on a grid of profiles and pixels
SHOWN_SEGMENTS = 2_500  # of a view
SHOWN_SHIFTS = 4_000
POINT_STEP_MM = 0.1

Colours = IntArray  # as of palette_places


@dataclass(frozen=True)
class Surroundings:
    """What only a simulation knows of a pair, in world coordinates in mm.

    surfaces_mm: the exact faces, polygons (k, 3). outlines: by role, the line that the sensor
    travels and the borders of its field, polylines. T_world_target: of the first profile.
    """

    surfaces_mm: tuple[FloatArray, ...]
    outlines: dict[str, tuple[FloatArray, ...]]
    T_world_target: RigidTransform


def scan_layer(scan: Scan) -> dict[str, Any]:
    """The points of a scan on a coarser grid of profiles and pixels."""
    return {"points": packed(shown(scan), POINT_STEP_MM)}


def shown(scan: Scan) -> FloatArray:
    """(profiles, pixels, 3) the part of a scan that the page shows, every k-th of both."""
    strides = [1, 1]
    while True:
        rows, pixels = (-(-n // k) for n, k in zip(scan.points_mm.shape, strides, strict=False))
        if rows * pixels <= SHOWN_POINTS:
            return scan.points_mm[:: strides[0], :: strides[1]]
        strides[0 if rows > pixels else 1] += 1


def view_layers(pair: PairView) -> dict[str, Any]:
    """What the method found in both views, in the frame of each, by role; and its spheres."""
    evidence = pair.result.evidence
    planes = evidence.get("planes")
    if isinstance(planes, PlaneEvidence):
        return _plane_layers(pair, planes)
    return _thesis_layers(pair)


def _plane_layers(pair: PairView, planes: PlaneEvidence) -> dict[str, Any]:
    spheres, matches = spheres_of(planes)
    layers = {}
    for column, (role, scan, view) in enumerate(
        (("target", pair.target, planes.target), ("source", pair.source, planes.source))
    ):
        places = palette_places(len(view.patches.normal), planes.pairs[:, column])
        layers[role] = {
            "patches": _hulls(scan, view, places),
            "normals": _normals(view.patches.centroid_mm, view.patches.normal, places),
            "sphere": _sphere(spheres[column], matches[:, column]),
            "segments": _ends(segment_ends(view.fan, planes.params)),
        }
    return layers


def _thesis_layers(pair: PairView) -> dict[str, Any]:
    views = {role: pair.result.evidence.get(role) for role in ("target", "source")}
    target = views["target"]
    matches = pair.result.evidence.get("normal_matches", np.zeros((0, 2), dtype=np.int64))
    if isinstance(target, ViewEvidence) and len(matches):
        matches = sorted_matches(matches, target.sphere.weight)
    layers: dict[str, Any] = {}
    for column, (role, view) in enumerate(views.items()):
        if not isinstance(view, ViewEvidence):
            layers[role] = {}
            continue
        layer: dict[str, Any] = {}
        if view.scan_filtered is not None:
            layer["filtered"] = packed(shown(view.scan_filtered), POINT_STEP_MM)
        if view.segments is not None:
            layer["segments"] = _ends(view.segments.endpoints_mm)
        if len(view.patches):
            places = palette_places(len(view.sphere), matches[:, column])[view.sphere.member]
            outlines = _polygons(list(view.patches.corners_mm))
            layer["patches"] = {**outlines, "colour": places.tolist()}
            layer["normals"] = _normals(view.patches.centroid_mm, view.patches.normal, places)
            layer["sphere"] = _sphere(view.sphere, matches[:, column])
        layers[role] = layer
    return layers


def shift_layer(pair: PairView) -> dict[str, Any] | None:
    """The shifts that were considered, and the chosen region."""
    planes = pair.result.evidence.get("planes")
    if isinstance(planes, PlaneEvidence):
        return _proposed(pair, planes)
    shifts = pair.result.evidence.get("shifts")
    if not isinstance(shifts, Shifts) or len(shifts.weights) == 0:
        return None
    order = np.argsort(~shifts.chosen, kind="stable")[:SHOWN_SHIFTS]
    box = shifts.box_mm if np.isfinite(shifts.box_mm).all() else np.zeros((0, 3))
    return {
        "values": packed(shifts.values_mm[order], POINT_STEP_MM),
        "chosen": int(shifts.chosen[order].sum()),
        "total": len(shifts.weights),
        "box": box.tolist(),
        "text": f"{len(shifts.weights)} shifts between the centroids of patches of like normals; "
        f"{shifts.chosen.sum()} lie in the densest region (box), whose mean is the translation.",
    }


def _proposed(pair: PairView, planes: PlaneEvidence) -> dict[str, Any] | None:
    """What the translation stage of gauss_sphere proposed, about the middle of the source."""
    pose = pair.result.T_target_source
    if pose is None:
        return None
    values, turned_rad, _ = shifts_of_middle(planes, pose.rotation.as_matrix())
    if not len(values):
        return None
    same = planes.params.decision
    away = values - pose.translation
    chosen = (turned_rad < same.distinct_rad) & (np.abs(away) < same.distinct_mm).all(axis=1)
    order = np.argsort(~chosen, kind="stable")[:SHOWN_SHIFTS]
    box = pose.translation + same.distinct_mm * np.array([[-1.0] * 3, [1.0] * 3])
    return {
        "values": packed(values[order], POINT_STEP_MM),
        "chosen": int(chosen[order].sum()),
        "total": len(values),
        "box": box.tolist(),
        "text": f"{len(values)} shifts that pairs of planes agree on under the rotations tried, as "
        f"they move the middle of the source; {chosen.sum()} are of one pose with the estimate: "
        f"within {same.distinct_mm:g} mm along every axis (box) and "
        f"{np.rad2deg(same.distinct_rad):.1f}° of its rotation.",
    }


def surroundings_layer(known: Surroundings) -> dict[str, Any]:
    """The exact surfaces and both sensors' fields, in the frame of the target."""
    T_target_world = known.T_world_target.inv()
    faces = [T_target_world.apply(face) for face in known.surfaces_mm]
    return {
        "surfaces": _polygons(faces),
        "outlines": {
            role: [packed(T_target_world.apply(line), POINT_STEP_MM) for line in lines]
            for role, lines in known.outlines.items()
        },
    }


def distances(pair: PairView) -> dict[str, Any] | None:
    """Distances of the shown points of each view to the other's surface, by the estimate."""
    pose = pair.result.T_target_source
    if pose is None or not (pair.target.n_valid and pair.source.n_valid):
        return None
    clouds = {
        "target": (shown(pair.target), pair.target.points_mm[pair.target.valid]),
        "source": (_moved(shown(pair.source), pose),
                   pose.apply(pair.source.points_mm[pair.source.valid])),
    }  # fmt: skip
    found = {}
    for role, other in (("target", "source"), ("source", "target")):
        grid = clouds[role][0]
        valid = np.isfinite(grid[..., 2])
        away = np.full(valid.shape, np.nan)
        away[valid] = surface_distance(grid[valid], clouds[other][1])
        found[role] = packed(away, 0.02)
    return found


def _moved(grid_mm: FloatArray, pose: RigidTransform) -> FloatArray:
    moved = np.full_like(grid_mm, np.nan)
    valid = np.isfinite(grid_mm[..., 2])
    moved[valid] = pose.apply(grid_mm[valid])
    return moved


def _ends(ends_mm: FloatArray) -> dict[str, Any]:
    stride = -(-len(ends_mm) // SHOWN_SEGMENTS) or 1
    return {"ends": packed(ends_mm[::stride], POINT_STEP_MM), "total": len(ends_mm)}


def _normals(centroid_mm: FloatArray, normal: FloatArray, places: Colours) -> dict[str, Any]:
    return {
        "from": packed(centroid_mm, POINT_STEP_MM),
        "direction": packed(normal, 1e-4),
        "colour": places.tolist(),
    }


def _hulls(scan: Scan, view: View, places: Colours) -> dict[str, Any]:
    """The convex hulls of the points of every plane, laid on it."""
    outlines, colours = [], []
    points, labels = scan.points_mm.reshape(-1, 3), patch_of_points(scan, view).ravel()
    planes = view.patches
    order = np.argsort(labels, kind="stable")
    starts = np.searchsorted(labels[order], np.arange(len(planes.normal) + 1))
    for index, (first, last) in enumerate(pairwise(starts)):
        centroid, basis = planes.centroid_mm[index], planes.basis[index]
        flat = (points[order[first:last]] - centroid) @ basis.T
        flat = flat[np.isfinite(flat).all(axis=1)]
        try:
            corners = flat[ConvexHull(flat).vertices]
        except (QhullError, ValueError):  # too few points, or all on a line
            continue
        outlines.append(centroid + corners @ basis)
        colours.append(int(places[index]))
    return {**_polygons(outlines), "colour": colours}


def _polygons(polygons: Sequence[FloatArray]) -> dict[str, Any]:
    corners = np.concatenate([np.zeros((0, 3)), *polygons])
    return {"corners": packed(corners, POINT_STEP_MM), "sizes": [len(p) for p in polygons]}


def _sphere(sphere: GaussSphere, matched: IntArray) -> dict[str, Any]:
    return {
        "direction": packed(sphere.direction, 1e-4),
        "area_cm2": [round(0.01 * float(weight), 2) for weight in sphere.weight],
        "colour": palette_places(len(sphere), matched).tolist(),
    }
