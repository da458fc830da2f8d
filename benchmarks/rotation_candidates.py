"""Whether rotation candidates of gauss_sphere gain by weighted SVD, or by how certain normals are.

python benchmarks/rotation_candidates.py [--pairs N] [--seed N]

Pairs are those of refinements.py. By certainty, a patch weighs its area times the chance that its
normal and one of the other view agree to the tolerance that directions must agree to: what area
may be expected to agree. Beside the nearest candidate stands the place, best first, of the first
one that is at most 2 degrees off.
"""

from __future__ import annotations

from harness.workers.threads import limit_threads

limit_threads()

from collections.abc import Callable  # noqa: E402
from typing import NamedTuple  # noqa: E402
from unittest.mock import patch  # noqa: E402

import numpy as np  # noqa: E402
from missing_returns import PARAMS  # noqa: E402
from refinements import drawn_pairs, is_right, normals_by_svd, options_of  # noqa: E402
from scipy.spatial.transform import RigidTransform, Rotation  # noqa: E402
from tabulate import tabulate  # noqa: E402

from harness.scoring.poses import FINE  # noqa: E402
from registration import register  # noqa: E402
from registration.gauss_sphere.candidates.rotation import (  # noqa: E402
    GaussSphere,
    gauss_sphere,
    rotation_candidates,
)
from registration.gauss_sphere.describing import describe  # noqa: E402
from registration.gauss_sphere.evidence import PlaneEvidence  # noqa: E402
from registration.gauss_sphere.params import RotationParams  # noqa: E402
from registration.gauss_sphere.planes.patches import Patches  # noqa: E402
from registration.scan import FloatArray  # noqa: E402

Weigh = Callable[[Patches, float], GaussSphere]
Search = Callable[[GaussSphere, GaussSphere, RotationParams], tuple[FloatArray, FloatArray]]
NEAR_DEG, CERTAIN = 2.0, 0.99


class Way(NamedTuple):
    """A way to find candidates: the weighted directions of a view, and rotations of two of them."""

    name: str
    weigh: Weigh
    find: Search


def certainty(patches: Patches) -> FloatArray:
    """(m,) chance that the noise of each normal and of another like it stay within the tolerance.

    At least: of a face that is long one way, the tilt of its worst direction counts for all.
    """
    variance = np.linalg.eigvalsh(patches.covariance[:, :2, :2])[:, -1]
    chance: FloatArray = -np.expm1(-(PARAMS.rotation.overlap_tolerance_rad**2) / (4.0 * variance))
    return chance


def by_certainty(patches: Patches, close_rad: float) -> GaussSphere:
    """The Gauss sphere of the area that may be expected to agree after the true turn."""
    expected = patches._replace(area_mm2=patches.area_mm2 * certainty(patches))
    return gauss_sphere(expected, close_rad)


def refined(
    target: GaussSphere, source: GaussSphere, params: RotationParams
) -> tuple[FloatArray, FloatArray]:
    """Candidates, each by weighted SVD over all directions that it lays on each other."""
    rotations, area = rotation_candidates(target, source, params)
    for n, turn in enumerate(rotations):
        cosine = target.direction @ (source.direction @ turn.T).T
        i, k = np.nonzero(cosine > np.cos(params.overlap_tolerance_rad))
        if i.size > 1:
            weight = np.minimum(target.weight[i], source.weight[k])
            found = normals_by_svd(target.direction[i], source.direction[k], weight)
            rotations[n] = found.as_matrix()
    return rotations, area


WAYS = (
    Way("as found", gauss_sphere, rotation_candidates),
    Way("by weighted SVD", gauss_sphere, refined),
    Way("weighted by area and certainty", by_certainty, rotation_candidates),
)


def away_deg(way: Way, seen: PlaneEvidence, T_exact: RigidTransform) -> FloatArray:
    """(n,) angles between the true rotation and the candidates, best first; one of inf for none."""
    target, source = (
        way.weigh(view.patches, seen.params.rotation.close_rad)
        for view in (seen.target, seen.source)
    )
    rotations, _ = way.find(target, source, seen.params.rotation)
    if len(rotations) == 0:
        return np.array([np.inf])
    away = Rotation.from_matrix(rotations) * T_exact.rotation.inv()
    return np.rad2deg(away.magnitude())


def first_near(away: FloatArray) -> float:
    """The place, from 1, of the first candidate that is near, infinite if none is."""
    near = np.flatnonzero(away <= NEAR_DEG)
    return float(near[0] + 1) if near.size else np.inf


def main() -> None:
    options = options_of(__doc__)
    drawn = drawn_pairs(options.pairs, options.seed)
    rows = []
    for way in WAYS:
        with (
            patch("registration.gauss_sphere.candidates.rotation.gauss_sphere", way.weigh),
            patch("registration.gauss_sphere.candidates.rotation.rotation_candidates", way.find),
        ):
            results = [register(*pair.scans, params=PARAMS) for pair in drawn]
        right = sum(is_right(r, pair.T_exact, FINE) for r, pair in zip(results, drawn, strict=True))
        away = [
            away_deg(way, result.evidence["planes"], pair.T_exact)
            for result, pair in zip(results, drawn, strict=True)
        ]
        nearest, place = [a.min() for a in away], [first_near(a) for a in away]
        rows.append(
            [
                way.name,
                *(f"{np.quantile(nearest, q):.2f}" for q in (0.5, 0.9, 1.0)),
                *(_place(np.quantile(place, q, method="higher")) for q in (0.5, 0.9, 1.0)),
                f"{right} of {len(drawn)}",
            ]
        )
    headers = [
        "rotation candidates", "nearest, median (°)", "90 %", "most",
        f"first within {NEAR_DEG:g}°, median", "90 %", "last", "within 1°, 5 mm",
    ]  # fmt: skip
    print(tabulate(rows, headers, "github", disable_numparse=True))
    print(_uncertain([describe(scan, PARAMS).patches for pair in drawn for scan in pair.scans]))


def _uncertain(views: list[Patches]) -> str:
    """What share of the normals, and of the area, is not quite certain."""
    certain = np.concatenate([certainty(patches) for patches in views])
    area = np.concatenate([patches.area_mm2 for patches in views])
    share = area[certain < CERTAIN].sum() / area.sum()
    return (
        f"{(certain < CERTAIN).mean():.1%} of {certain.size} normals, of {share:.2%} of the area, "
        f"are less than {CERTAIN:.0%} certain"
    )


def _place(place: float) -> str:
    return f"{place:.0f}" if np.isfinite(place) else "none"


if __name__ == "__main__":
    main()
