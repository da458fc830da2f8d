"""The planes of a method that labels points: every point coloured by the match of its plane."""

from __future__ import annotations

import numpy as np
from matplotlib.figure import Figure

from harness.figures.looks import FRONT, NORMAL_COLOURS, PALE, TOP
from harness.figures.page import amount, mixed_order, projections, roles
from harness.figures.pair_view import PairView
from harness.figures.planes import normal_colours
from registration.gauss_sphere.evidence import PlaneEvidence, patch_of_points

MAX_POINTS = 12000


def draw_labelled_points(pair: PairView, planes: PlaneEvidence, title: str) -> Figure:
    """Both views in their own frames, a colour for each pair of matched planes."""
    views = (planes.target, planes.source)
    columns = [
        f"{role}: {view} view\n{amount(seen.patches.n_points.size, 'plane')} through "
        f"{amount(int((seen.patches.label >= 0).sum()), 'point')}"
        for (role, view, _), seen in zip(roles(pair), views, strict=True)
    ]
    note = (
        f"{amount(len(planes.pairs), 'pair')} of planes matched; the largest "
        f"{len(NORMAL_COLOURS)} have a colour each, the same in both views. Grey: other planes. "
        "Points on no plane are left out."
    )
    scans = [scan for _, _, scan in roles(pair)]
    points = [scan.points_mm for scan in scans]
    figure, axes = projections(f"{title}\nPlanes", columns, points, note)
    for column, (view, scan) in enumerate(zip(views, scans, strict=True)):
        label = patch_of_points(scan, view).ravel()
        colours = np.array(
            [*normal_colours(view.patches.n_points.size, planes.pairs[:, column]), PALE]
        )
        on = np.flatnonzero(label >= 0)
        on = on[mixed_order(on.size)[:MAX_POINTS]]
        for row, projection in enumerate((FRONT, TOP)):
            shown = scan.points_mm.reshape(-1, 3)[on]
            axes[row][column].scatter(
                shown[:, projection.right], shown[:, projection.up], s=1.6,
                c=colours[label[on]], lw=0, rasterized=True,
            )  # fmt: skip
    return figure
