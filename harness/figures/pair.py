"""The figures of a registered pair, as chapter 6 of the thesis shows them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from harness.figures.measurements import draw_filtering, draw_measurements
from harness.figures.page import page_style, save
from harness.figures.pair_matches import sorted_matches, spheres_of
from harness.figures.pair_view import PairView
from harness.figures.planes import draw_patches, draw_segments
from harness.figures.point_labels import draw_labelled_points
from harness.figures.shifts import draw_shifts
from harness.figures.sphere import draw_gauss_spheres
from harness.figures.superposition import draw_superposition
from registration.gauss_sphere.evidence import PlaneEvidence
from registration.thesis.evidence import ViewEvidence
from registration.thesis.translation import Shifts

KINDS = (
    "measurements",
    "filtering",
    "segments",
    "patches",
    "gauss_spheres",
    "shifts",
    "superposition",
)


def draw_pair(pair: PairView, folder: Path) -> list[Path]:
    """Draw all that a method left to be seen of a pair; returns the files, PNG.

    Every method gets its measurements and their superposition. The stages in between are drawn
    where the result has evidence of them, as far as it got; files of an earlier
    drawing of the same pair and method that no longer apply are removed.
    """
    folder.mkdir(parents=True, exist_ok=True)
    figures = dict(_figures(pair))
    files = []
    for place, kind in enumerate(KINDS, start=1):
        path = folder / f"{pair.slug}_{place}_{kind}.png"
        if kind in figures:
            with page_style():
                files.append(save(figures[kind](), path))
        else:
            path.unlink(missing_ok=True)
    return files


def _figures(pair: PairView) -> Iterator[tuple[str, Callable[[], Figure]]]:
    """What there is to draw, by kind."""
    title = (
        f"{pair.scene}, pair {pair.pair}: {pair.source_view} to {pair.target_view}, "
        f"method {pair.method}"
    )
    yield "measurements", lambda: draw_measurements(pair, title)
    yield "superposition", lambda: draw_superposition(pair, title)
    planes = pair.result.evidence.get("planes")
    if isinstance(planes, PlaneEvidence):
        yield "patches", lambda: draw_labelled_points(pair, planes, title)
        both, same = spheres_of(planes)
        yield "gauss_spheres", lambda: draw_gauss_spheres(pair, both, same, title)
        return
    target, source = (pair.result.evidence.get(role) for role in ("target", "source"))
    if not (isinstance(target, ViewEvidence) and isinstance(source, ViewEvidence)):
        return
    if target.scan_filtered is not None and source.scan_filtered is not None:
        filtered = (target.scan_filtered, source.scan_filtered)
        yield "filtering", lambda: draw_filtering(pair, filtered, title)
    if target.segments is not None and source.segments is not None:
        segments = (target.segments, source.segments)
        yield "segments", lambda: draw_segments(pair, segments, title)
    if len(target.patches) + len(source.patches) > 0:
        views = (target, source)
        found = pair.result.evidence.get("normal_matches", np.zeros((0, 2), dtype=np.int64))
        matches = sorted_matches(found, target.sphere.weight)
        yield "patches", lambda: draw_patches(pair, views, matches, title)
        spheres = (target.sphere, source.sphere)
        yield "gauss_spheres", lambda: draw_gauss_spheres(pair, spheres, matches, title)
    shifts = pair.result.evidence.get("shifts")
    if isinstance(shifts, Shifts) and len(shifts.weights) > 0:
        yield "shifts", lambda: draw_shifts(pair, shifts, title)
