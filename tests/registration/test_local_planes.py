import numpy as np
import pytest

from registration.local_planes import local_planes
from registration.scan import FloatArray


def _grid(profiles: int = 12, pixels: int = 40) -> tuple[FloatArray, FloatArray]:
    return np.meshgrid(5.0 * np.arange(profiles), np.linspace(-40.0, 40.0, pixels), indexing="ij")


@pytest.mark.parametrize("slopes", [(0.0, 0.0), (0.3, -1.2), (-2.0, 0.5)])
def test_a_plane_has_its_inclination_everywhere(slopes: tuple[float, float]) -> None:
    x, y = _grid()
    planes = local_planes(np.stack([x, y, 700.0 + slopes[0] * x + slopes[1] * y], axis=2))
    assert planes.along == pytest.approx(slopes[0], abs=1e-6)
    assert planes.across == pytest.approx(slopes[1], abs=1e-6)
    # In the middle neighbours lie alike on both sides; at the rim on one.
    assert planes.middle_mm[6, 20] == pytest.approx(0.0, abs=0.3)
    assert planes.middle_mm[6, 0] > 5.0


def test_noise_and_a_depth_step_do_not_spoil_it() -> None:
    x, y = _grid(30, 80)
    rng = np.random.default_rng(0)
    z = 700.0 + 0.4 * x + np.where(y > 0.0, 60.0, 0.0) + rng.normal(0.0, 0.8, x.shape)
    planes = local_planes(np.stack([x, y, z], axis=2))
    assert np.abs(planes.along - 0.4).max() < 0.15
    assert np.abs(planes.across).max() < 0.15
    assert (planes.along - 0.4).std() < 0.03


def test_holes_and_lonely_points() -> None:
    x, y = _grid()
    points = np.stack([x, y, 700.0 + 0.5 * y], axis=2)
    points[3:6, 10:20] = np.nan
    planes = local_planes(points)
    assert np.isnan(planes.along[4, 15])
    assert planes.across[np.isfinite(points[..., 2])] == pytest.approx(0.5, abs=1e-6)
    lonely = np.full_like(points, np.nan)
    lonely[0, 0] = [0.0, 0.0, 700.0]
    assert local_planes(lonely).across[0, 0] == 0.0


def test_one_profile_tells_nothing_of_the_motion() -> None:
    y = np.linspace(-40.0, 40.0, 40)
    planes = local_planes(np.stack([np.zeros(40), y, 700.0 - 0.7 * y], axis=1)[None])
    assert planes.along == pytest.approx(0.0, abs=1e-12)
    assert planes.across == pytest.approx(-0.7, abs=1e-6)
