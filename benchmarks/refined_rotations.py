"""Whether rotation candidates of gauss_sphere gain by weighted SVD over all directions they match.

python benchmarks/refined_rotations.py [--pairs N] [--seed N]

Pairs are those of refinements.py.
"""

from __future__ import annotations

from harness.threads import limit_threads

limit_threads()

from collections.abc import Callable  # noqa: E402
from unittest.mock import patch  # noqa: E402

import numpy as np  # noqa: E402
from missing_returns import PARAMS  # noqa: E402
from numpy.typing import NDArray  # noqa: E402
from refinements import drawn_pairs, is_right, normals_by_svd, options_of  # noqa: E402
from scipy.spatial.transform import RigidTransform, Rotation  # noqa: E402
from tabulate import tabulate  # noqa: E402

from harness.scoring import FINE  # noqa: E402
from registration import register  # noqa: E402
from registration.gauss_sphere.evidence import PlaneEvidence  # noqa: E402
from registration.gauss_sphere.params import RotationParams  # noqa: E402
from registration.gauss_sphere.rotation import (  # noqa: E402
    GaussSphere,
    gauss_sphere,
    rotation_candidates,
)

FloatArray = NDArray[np.float64]
Search = Callable[[GaussSphere, GaussSphere, RotationParams], tuple[FloatArray, FloatArray]]


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


def nearest_deg(find: Search, seen: PlaneEvidence, T_exact: RigidTransform) -> float:
    """Angle between the true rotation and the nearest candidate, infinite if there is none."""
    target, source = (
        gauss_sphere(view.patches, seen.params.rotation.close_rad)
        for view in (seen.target, seen.source)
    )
    rotations, _ = find(target, source, seen.params.rotation)
    if len(rotations) == 0:
        return np.inf
    away = Rotation.from_matrix(rotations) * T_exact.rotation.inv()
    return float(np.rad2deg(away.magnitude().min()))


def main() -> None:
    options = options_of(__doc__)
    drawn = drawn_pairs(options.pairs, options.seed)
    rows = []
    for name, find in (("as found", rotation_candidates), ("by weighted SVD", refined)):
        with patch("registration.gauss_sphere.pipeline.rotation_candidates", find):
            results = [register(*pair.scans, params=PARAMS) for pair in drawn]
        right = sum(is_right(r, pair.T_exact, FINE) for r, pair in zip(results, drawn, strict=True))
        away = [
            nearest_deg(find, result.evidence["planes"], pair.T_exact)
            for result, pair in zip(results, drawn, strict=True)
        ]
        quantiles = (f"{np.quantile(away, q):.2f}" for q in (0.5, 0.9, 1.0))
        rows.append([name, *quantiles, f"{right} of {len(drawn)}"])
    headers = ["rotation candidates", "nearest, median (°)", "90 %", "most", "within 1°, 5 mm"]
    print(tabulate(rows, headers, "github", disable_numparse=True))


if __name__ == "__main__":
    main()
