"""The data figures of chapters 4 to 6 by their numbers: what each shows, and of which result."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import NamedTuple

import pandas as pd
from matplotlib.figure import Figure

from experiments import planar_figures as planar
from experiments.profile_figures import SERIES, draw_series
from experiments.profile_pairs import ProfilePair
from harness.figures.matching import (
    FourPatches,
    draw_four_shifts,
    draw_patch_matching,
    telling_patches,
)
from harness.figures.overview import draw_superposed_pairs
from harness.figures.pair_matches import sorted_matches
from harness.figures.pair_view import PairView
from harness.figures.shifts import draw_shifts
from harness.figures.sphere import draw_gauss_spheres
from harness.figures.superposition import draw_superposition
from harness.figures.views import (
    draw_profile_filtering,
    draw_view_compaction,
    draw_view_filtering,
    draw_view_measurements,
    draw_view_patches,
    draw_view_sphere,
    telling_profile,
)
from registration.planar.pipeline import PlanarEvidence
from registration.scan import Scan
from registration.thesis.evidence import ViewEvidence
from registration.thesis.translation import Shifts

Pairs = Mapping[str, PairView]
Draw = Callable[[Pairs, str], Figure]


class MissingEvidenceError(ValueError):
    """The method did not get as far as the figure shows; the message says where it stopped."""


class Numbered(NamedTuple):
    """A figure of the thesis: what ours shows, what to look at, and how it is drawn.

    pairs: names of the pairs, registered by `thesis`, that `draw` takes with a title; raises
        MissingEvidenceError.
    """

    number: str
    shows: str
    look: str
    pairs: tuple[str, ...]
    draw: Draw


class NumberedPlanar(NamedTuple):
    """A figure of registration in the plane: of one pair of profiles, or of all in the rows."""

    number: str
    shows: str
    look: str
    draw: Callable[[ProfilePair, PlanarEvidence, pd.DataFrame, str], Figure]


def _seen(pair: PairView, view: str) -> tuple[Scan, ViewEvidence]:
    """The scan of a view by its name, and what the stages made of it."""
    role = "target" if pair.target_view == view else "source"
    found = pair.result.evidence.get(role)
    if not isinstance(found, ViewEvidence):
        raise MissingEvidenceError(pair.result.reason)
    return (pair.target if role == "target" else pair.source), found


def _filtered(pair: PairView, view: str) -> tuple[Scan, Scan]:
    scan, found = _seen(pair, view)
    if found.scan_filtered is None:
        raise MissingEvidenceError(pair.result.reason)
    return scan, found.scan_filtered


def _shifts(pair: PairView) -> Shifts:
    shifts = pair.result.evidence.get("shifts")
    if not isinstance(shifts, Shifts) or len(shifts.weights) == 0:
        raise MissingEvidenceError(pair.result.reason)
    return shifts


def _four(pair: PairView) -> FourPatches:
    views = (_seen(pair, pair.target_view)[1], _seen(pair, pair.source_view)[1])
    four = telling_patches(views[0].patches, views[1].patches, _shifts(pair))
    if four is None or pair.result.T_target_source is None:
        raise MissingEvidenceError("no two patches of like orientation in both views agree")
    return four


def _profile_filtering(pair: str, view: str) -> Draw:
    def draw(pairs: Pairs, title: str) -> Figure:
        scans = _filtered(pairs[pair], view)
        return draw_profile_filtering(*scans, telling_profile(*scans), title)

    return draw


def _matching(pairs: Pairs, title: str) -> Figure:
    (pair,) = pairs.values()
    four, pose = _four(pair), pair.result.T_target_source
    assert pose is not None
    views = (_seen(pair, pair.target_view)[1], _seen(pair, pair.source_view)[1])
    return draw_patch_matching(views[0].patches, views[1].patches, four, pose.rotation, title)


def _four_shifts(pairs: Pairs, title: str) -> Figure:
    (pair,) = pairs.values()
    four, pose = _four(pair), pair.result.T_target_source
    assert pose is not None
    return draw_four_shifts(four, pose.translation, title)


def _all_shifts(pairs: Pairs, title: str) -> Figure:
    (pair,) = pairs.values()
    return draw_shifts(pair, _shifts(pair), title)


def _view_filtering(pair: str, view: str) -> Draw:
    return lambda pairs, title: draw_view_filtering(*_filtered(pairs[pair], view), title)


def _measurements(pair: str, view: str) -> Draw:
    def draw(pairs: Pairs, title: str) -> Figure:
        seen = pairs[pair]
        scan = seen.target if seen.target_view == view else seen.source
        return draw_view_measurements(scan, title)

    return draw


def _compaction(pair: str, view: str) -> Draw:
    def draw(pairs: Pairs, title: str) -> Figure:
        found = _seen(pairs[pair], view)[1]
        if found.segments is None:
            raise MissingEvidenceError(pairs[pair].result.reason)
        return draw_view_compaction(found.segments, found, title)

    return draw


def _patches(pair: str, view: str) -> Draw:
    return lambda pairs, title: draw_view_patches(_seen(pairs[pair], view)[1], title)


def _sphere(pair: str, view: str) -> Draw:
    def draw(pairs: Pairs, title: str) -> Figure:
        found = _seen(pairs[pair], view)[1]
        return draw_view_sphere(found.sphere, len(found.patches), title)

    return draw


def _both_spheres(pairs: Pairs, title: str) -> Figure:
    (pair,) = pairs.values()
    target, source = (_seen(pair, v)[1].sphere for v in (pair.target_view, pair.source_view))
    found = pair.result.evidence.get("normal_matches")
    if found is None:
        raise MissingEvidenceError(pair.result.reason)
    return draw_gauss_spheres(pair, (target, source), sorted_matches(found, target.weight), title)


def _superposition(pairs: Pairs, title: str) -> Figure:
    (pair,) = pairs.values()
    return draw_superposition(pair, title)


def _all_views(pairs: Pairs, title: str) -> Figure:
    if all(pair.result.T_target_source is None for pair in pairs.values()):
        raise MissingEvidenceError("no pair was answered")
    return draw_superposed_pairs(list(pairs.values()), title)


FOAM, LEFT, RIGHT = ("6.1",), ("6.2",), ("6.3",)
NEAR, FAR = ("6.4",), ("6.5",)
RAW = "The faces that a reader recognises, and where nothing was measured."
PATCHES = "How few patches stand for the thousands of points of the raw view; gaps between them."
SPHERE = "Few heavy normals carry most of the area; the light ones are noise and edges."
SUPERPOSED = "Blue and orange should mix on every face; where one shows alone, it is off or unseen."

FIGURES: tuple[Numbered, ...] = (
    Numbered("5.2", "one profile before and after preprocessing",
             "Crosses: isolated points that are removed; the noise of the rest is less below.",
             NEAR, _profile_filtering("6.4", "left")),
    Numbered("5.7", "patches of both views that match, before and after the rotation",
             "In (b) the step from c to a is the step from d to b; a to d and b to c are not.",
             FAR, _matching),
    Numbered("5.8", "the four shifts between the centroids of figure 5.7",
             "T(ac) and T(bd) fall together, the two false ones lie apart.",
             FAR, _four_shifts),
    Numbered("5.9", "all possible shifts, and the region of maximum occurrence",
             "They scatter over the whole space; the box is where most agree.",
             NEAR, _all_shifts),
    Numbered("6.4", "foam, right view, measurements before and after filtering",
             "Single points between the faces are gone in (b).",
             FOAM, _view_filtering("6.1", "right")),
    Numbered("6.5", "foam, right view, line segments and patches", PATCHES,
             FOAM, _compaction("6.1", "right")),
    Numbered("6.6", "foam, left view, line segments and patches", PATCHES,
             FOAM, _compaction("6.1", "left")),
    Numbered("6.7", "foam, modified Gauss spheres of both views",
             "On the right, circles and diamonds that coincide are normals that agree.",
             FOAM, _both_spheres),
    Numbered("6.8", "foam, occurrence graph of the shifts",
             "Whether the dashed line, the exact shift, lies under the red bars.",
             FOAM, _all_shifts),
    Numbered("6.9", "foam, both views superposed", SUPERPOSED, FOAM, _superposition),
    Numbered("6.12", "desk without noise, left view, measurements", RAW,
             LEFT, _measurements("6.2", "left")),
    Numbered("6.13", "desk without noise, center view, measurements", RAW,
             LEFT, _measurements("6.2", "center")),
    Numbered("6.14", "desk without noise, right view, measurements", RAW,
             RIGHT, _measurements("6.3", "right")),
    Numbered("6.15", "desk without noise, left view, patches", PATCHES,
             LEFT, _patches("6.2", "left")),
    Numbered("6.16", "desk without noise, center view, patches", PATCHES,
             LEFT, _patches("6.2", "center")),
    Numbered("6.17", "desk without noise, right view, patches", PATCHES,
             RIGHT, _patches("6.3", "right")),
    Numbered("6.18", "desk without noise, left view, modified Gauss sphere", SPHERE,
             LEFT, _sphere("6.2", "left")),
    Numbered("6.19", "desk without noise, center view, modified Gauss sphere", SPHERE,
             LEFT, _sphere("6.2", "center")),
    Numbered("6.20", "desk without noise, right view, modified Gauss sphere", SPHERE,
             RIGHT, _sphere("6.3", "right")),
    Numbered("6.21", "desk without noise, left and center", SUPERPOSED,
             LEFT, _superposition),
    Numbered("6.22", "desk without noise, right and center", SUPERPOSED,
             RIGHT, _superposition),
    Numbered("6.23", "desk without noise, three views superposed",
             "Left against right: by the estimates as thin as by the exact poses?",
             LEFT + RIGHT, _all_views),
    Numbered("6.24", "desk with noise, left view, measurements", RAW,
             NEAR, _measurements("6.4", "left")),
    Numbered("6.25", "desk with noise, center view, measurements", RAW,
             NEAR, _measurements("6.4", "center")),
    Numbered("6.26", "desk with noise, right view, measurements", RAW,
             FAR, _measurements("6.5", "right")),
    Numbered("6.27", "desk with noise, left view, patches", PATCHES,
             NEAR, _patches("6.4", "left")),
    Numbered("6.28", "desk with noise, center view, patches", PATCHES,
             NEAR, _patches("6.4", "center")),
    Numbered("6.29", "desk with noise, right view, patches", PATCHES,
             FAR, _patches("6.5", "right")),
    Numbered("6.30", "desk with noise, three views superposed",
             "Left against right: by the estimates as thin as by the exact poses?",
             NEAR + FAR, _all_views),
)  # fmt: skip

PLANAR_FIGURES: tuple[NumberedPlanar, ...] = (
    NumberedPlanar("4.4", "two profiles of one surface from both viewpoints",
                   "The same outline, turned and shifted.",
                   lambda pair, _, __, where: planar.draw_raw(pair, where)),
    NumberedPlanar("4.5", "their straight segments and normals",
                   "Whether both views break the outline at the same corners.",
                   lambda pair, found, _, where: planar.draw_segments(pair, found, where)),
    NumberedPlanar("4.6", "their modified Gauss circles",
                   "The same rays, turned by the angle that is sought.",
                   lambda pair, found, _, where: planar.draw_circles(pair, found, where)),
    NumberedPlanar("4.7", "the source's Gauss circle turned onto the target's",
                   "Rays that lie on each other, and how alike their lengths are.",
                   lambda pair, found, _, where: planar.draw_turned(pair, found, where)),
    NumberedPlanar("4.8", "the shift between the centroids of segments",
                   "All arrows should be alike; a face seen in part has its centroid elsewhere.",
                   lambda pair, found, _, where: planar.draw_shift(pair, found, where)),
    NumberedPlanar("4.9", "both profiles superposed",
                   "The outlines should run into each other.",
                   lambda pair, _, __, where: planar.draw_superposed(pair, where)),
    NumberedPlanar("6.2", "foam, rotation found by each pair of profiles",
                   "Outliers and pairs without an answer among the 44; the mean beside the exact.",
                   lambda _, __, rows, where: draw_series(where, rows, SERIES[:1], "6.2")),
    NumberedPlanar("6.3", "foam, translation found by each pair of profiles",
                   "The pairs that leave the line in 6.2 leave it here.",
                   lambda _, __, rows, where: draw_series(where, rows, SERIES[1:], "6.3")),
)  # fmt: skip
