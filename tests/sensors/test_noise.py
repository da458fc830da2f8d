import numpy as np
import pytest

from sensors.noise import NoiseParams, measured_depth, square_law

LIMITS_MM = (170.0, 1175.0)
OFF = NoiseParams(gaussian=False, quantised=False)


def test_without_effects_the_depth_is_exact() -> None:
    depth_mm = np.array([170.0, 500.123, np.nan, 1175.0])
    measured = measured_depth(depth_mm, LIMITS_MM, OFF, np.random.default_rng(0))
    np.testing.assert_array_equal(measured, depth_mm)


def test_the_square_law_meets_its_ends_and_is_a_square() -> None:
    law = square_law(LIMITS_MM, (0.3, 2.0))
    depth_mm = np.array([170.0, 672.5, 1175.0])
    near, middle, far = np.sqrt(law.at(depth_mm))
    assert [near**2, far**2] == pytest.approx([0.3, 2.0], rel=1e-12)
    assert middle == pytest.approx((near + far) / 2.0, rel=1e-12)


@pytest.mark.parametrize(("depth_mm", "sigma_mm"), [(170.0, 0.3), (1175.0, 1.5)])
def test_the_random_error_has_the_spread_asked_for(depth_mm: float, sigma_mm: float) -> None:
    params = NoiseParams(quantised=False)
    n = 40_000
    error = measured_depth(np.full(n, depth_mm), LIMITS_MM, params, np.random.default_rng(1))
    error -= depth_mm
    # Four standard errors of a mean and of a standard deviation.
    assert abs(error.mean()) < 4.0 * sigma_mm / np.sqrt(n)
    assert abs(error.std() / sigma_mm - 1.0) < 4.0 / np.sqrt(2.0 * n)


def test_quantised_depths_are_as_far_apart_as_the_published_resolution() -> None:
    params = NoiseParams(gaussian=False)
    depth_mm = np.linspace(*LIMITS_MM, 200_001)
    measured = measured_depth(depth_mm, LIMITS_MM, params, np.random.default_rng(0))
    levels = np.unique(measured)
    steps = np.diff(levels)
    assert steps[0] == pytest.approx(0.3, rel=0.01)
    assert steps[-1] == pytest.approx(2.0, rel=0.01)
    assert (np.diff(steps) > 0.0).all()
    step = square_law(LIMITS_MM, (0.3, 2.0)).at(depth_mm)
    assert (np.abs(measured - depth_mm) <= 0.505 * step).all()
    # A level is its own measurement.
    again = measured_depth(levels, LIMITS_MM, params, np.random.default_rng(0))
    assert again == pytest.approx(levels, abs=1e-9)


def test_a_beam_keeps_its_noise_whatever_the_others_meet() -> None:
    depth_mm = np.full((4, 5), 800.0)
    holes = depth_mm.copy()
    holes[1, :3] = np.nan
    full, partial = (
        measured_depth(d, LIMITS_MM, NoiseParams(), np.random.default_rng(5))
        for d in (depth_mm, holes)
    )
    assert np.isnan(partial[1, :3]).all()
    kept = ~np.isnan(holes)
    np.testing.assert_array_equal(partial[kept], full[kept])


@pytest.mark.parametrize(
    "wrong",
    [
        {"sigma_near_mm": 0.0},
        {"sigma_far_mm": 0.2},
        {"step_near_mm": -1.0},
        {"step_far_mm": np.inf},
    ],
)
def test_impossible_noise_is_refused(wrong: dict) -> None:
    with pytest.raises(ValueError, match="expected lengths above 0 mm, the far one larger"):
        NoiseParams(**wrong)
