from __future__ import annotations

import pytest
from plane_scans import Pair, clutter_pair


@pytest.fixture(scope="session")
def exact_pair() -> Pair:
    """Two noise-free views of boxes in front of a wall."""
    return clutter_pair(seed=1001, noise=0.0)


@pytest.fixture(scope="session")
def noisy_pair() -> Pair:
    """Two views of boxes in front of a wall with 0.3 to 1.5 mm of noise."""
    return clutter_pair(seed=1001, noise=1.0)
