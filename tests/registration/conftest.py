from __future__ import annotations

from typing import NamedTuple

import numpy as np
import pytest
from plane_scans import move_plates, random_clutter, random_view, scan_plates
from scipy.spatial.transform import RigidTransform

from registration import Scan


class Pair(NamedTuple):
    target: Scan
    source: Scan
    T_target_source: RigidTransform


def clutter_pair(seed: int, noise: float) -> Pair:
    rng = np.random.default_rng(seed)
    plates = random_clutter(rng)
    T_source_target = random_view(rng)
    return Pair(
        scan_plates(plates, noise=noise, rng=rng),
        scan_plates(move_plates(plates, T_source_target), noise=noise, rng=rng),
        T_source_target.inv(),
    )


@pytest.fixture(scope="session")
def exact_pair() -> Pair:
    """Two noise-free views of boxes in front of a wall."""
    return clutter_pair(seed=1001, noise=0.0)


@pytest.fixture(scope="session")
def noisy_pair() -> Pair:
    """Two views of boxes in front of a wall with 0.3 to 1.5 mm of noise."""
    return clutter_pair(seed=1001, noise=1.0)
