"""Scans as point clouds in binary PLY files, in mm."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from scipy.spatial.transform import RigidTransform

from harness.figures.pair_view import PairView
from harness.file_names import file_slug
from harness.report.packing import write_whole
from registration.scan import FloatArray, Scan

TARGET_RGB = (31, 119, 180)
SOURCE_RGB = (255, 127, 14)


def write_clouds(pair: PairView, folder: Path) -> list[Path]:
    """Write both scans of a pair, and merged by the estimate where there is one.

    The scans are in their own frames, the merged cloud in the target's: target blue, source
    orange. Returns the files.
    """
    folder.mkdir(parents=True, exist_ok=True)
    files = []
    for view, scan, rgb in (
        (pair.target_view, pair.target, TARGET_RGB),
        (pair.source_view, pair.source, SOURCE_RGB),
    ):
        if scan.n_valid:
            path = folder / f"{file_slug(view)}.ply"
            files.append(write_cloud(path, [scan.points_mm[scan.valid]], [rgb]))
    pose = pair.result.T_target_source
    if pose is not None and pair.target.n_valid and pair.source.n_valid:
        path = folder / f"{pair.slug}_merged.ply"
        files.append(write_merged(path, pair.target, pair.source, pose))
    return files


def write_merged(path: Path, target: Scan, source: Scan, pose: RigidTransform) -> Path:
    """Write both scans as one cloud in the target's frame, target blue, source orange.

    pose: T_target_source. Returns the path.
    """
    points_mm = [target.points_mm[target.valid], pose.apply(source.points_mm[source.valid])]
    return write_cloud(path, points_mm, [TARGET_RGB, SOURCE_RGB])


def write_cloud(path: Path, points_mm: list[FloatArray], rgb: list[tuple[int, int, int]]) -> Path:
    """Write clouds (n, 3) in mm, each in its colour, as one binary PLY file; returns the path."""
    path.parent.mkdir(parents=True, exist_ok=True)
    colours = np.repeat(np.array(rgb, dtype=np.uint8), [len(p) for p in points_mm], axis=0)
    cloud = trimesh.PointCloud(np.concatenate(points_mm), colors=colours)
    write_whole(path, trimesh.exchange.ply.export_ply(cloud, encoding="binary"))
    return path
