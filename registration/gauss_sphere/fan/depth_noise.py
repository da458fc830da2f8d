"""The noise of a scan's depths, from the scan alone."""

from __future__ import annotations

import numpy as np

from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

DEPTH_BINS = 6
DEPTH_CELLS = 512
NOISE_PROFILES = 16  # at most, enough for the noise to a few percent
FEW_PROFILES, MAYBE = 3, 1.15  # at first: by how much noise must seem to grow to look at more
MIN_TRIPLES_PER_BIN = 50
MIN_SIGMA_MM = 0.02
# A sensor that smooths its profiles is believed to where noise seems larger by SMOOTHED between
# points two pixels apart than side by side: other scans reached 1.11, medians of three pixels 1.26.
# Where it is no larger a pixel further (SETTLED), or MOST_LAG apart, it is independent. It grows by
# ever less, but for what STEADY allows; faces that end within so few pixels make it jump. And as
# many differences side by side change sign: of independent noise 73 %, of round surfaces few.
SMOOTHED, SETTLED, STEADY, MOST_LAG, INDEPENDENT = 1.22, 1.1, 1.15, 8, 0.57
FAINT_MM = 1e-3  # no noise of a sensor, or hidden, as most depths are rounded to the same number


@compiled
def depth_noise(depth_mm: FloatArray, slope: FloatArray) -> tuple[float, float]:
    """Estimate the noise of the depths from their neighbours along the profile.

    The second difference of the inverse depth over the slope vanishes on a plane. Its clipped
    spread in bins of depth, from profiles spread over the scan, is fitted by
    sigma = a + b depth^2, both not negative. Returns (a in mm, b in 1/mm).
    """
    depths, sigmas, smoothed_by = *_noise_by_depth(depth_mm, slope), 1.0
    if depths.size == 0:  # as where only every second beam returns
        depths, sigmas = _noise_by_depth(*_closed_up(depth_mm, slope))
    else:
        smoothed_by = _smoothed_by(depth_mm, slope)
    if depths.size == 0:
        return MIN_SIGMA_MM, 0.0
    sigmas = np.maximum(sigmas * smoothed_by, MIN_SIGMA_MM)
    return _growing_noise(depths, sigmas)


@compiled
def _closed_up(depth: FloatArray, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
    """The same points, those of each profile side by side."""
    depths, slopes = np.full(depth.shape, np.nan), np.zeros(depth.shape)
    for p in range(depth.shape[0]):
        measured = np.isfinite(depth[p])
        n = np.count_nonzero(measured)
        depths[p, :n], slopes[p, :n] = depth[p][measured], slope[p][measured]
    return depths, slopes


@compiled
def _noise_by_depth(depth: FloatArray, slope: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean depth and spread of the second differences in bins of depth, equally filled."""
    middle, error = _all_bends(depth, slope, 1, NOISE_PROFILES)
    n = error.size
    bins = min(DEPTH_BINS, n // MIN_TRIPLES_PER_BIN)
    depths, sigmas = np.empty(bins), np.empty(bins)
    order = _by_depth(middle)
    for i in range(bins):
        chosen = order[i * n // bins : (i + 1) * n // bins]
        depths[i] = middle[chosen].mean()
        sigmas[i] = _clipped_spread(error[chosen])
    return depths, sigmas


@compiled
def _all_bends(
    depth: FloatArray, slope: FloatArray, lag: int, profiles: int
) -> tuple[FloatArray, FloatArray]:
    """Depth (n,) and size (n,) of the second differences of some profiles all over the scan."""
    stride = -(-depth.shape[0] // profiles)
    middle, error = np.empty(depth.size), np.empty(depth.size)
    bend, n = np.empty(depth.shape[1]), 0
    for p in range(stride // 2, depth.shape[0], stride):
        # First what, then whether: the first loop runs on vectors of points.
        _bends(depth[p], slope[p], lag, bend)
        for u in range(depth.shape[1]):
            if np.isfinite(bend[u]):
                middle[n], error[n] = depth[p, u], abs(bend[u])
                n += 1
    return middle[:n], error[:n]


@compiled
def _bends(depth: FloatArray, slope: FloatArray, lag: int, bend: FloatArray) -> None:
    """Second differences of a profile between points so many pixels apart, as errors of a depth.

    bend: (pixels,) out, in mm, NaN where there is none.
    """
    bend[:lag], bend[depth.size - lag :] = np.nan, np.nan
    for u in range(lag, depth.size - lag):
        a, b, c = depth[u - lag], depth[u], depth[u + lag]
        share = (slope[u] - slope[u - lag]) / (slope[u + lag] - slope[u - lag])
        off = 1.0 / b - (1.0 - share) / a - share / c
        size = np.sqrt(1.0 + share * share + (1.0 - share) * (1.0 - share))
        bend[u] = off * b * b / size if 0.2 < share < 0.8 else np.nan


@compiled
def _smoothed_by(depth: FloatArray, slope: FloatArray) -> float:
    """How many times as large the noise was before the sensor smoothed it, 1 if it did not.

    Second differences of smoothed noise grow with the distance of the points, by ever less, up to
    where it is independent. So do those of a round surface, but those side by side are alike. From
    their variance, v(l) = 6 g(0) - 8 g(l) + 2 g(2 l), follow the covariances g(l) of the noise, the
    farthest first. All of them together are the variance by which means over many points differ:
    that of the noise before it was smoothed.
    """
    side_by_side = _all_bends(depth, slope, 1, FEW_PROFILES)[1]
    apart = _all_bends(depth, slope, 2, FEW_PROFILES)[1]
    if min(side_by_side.size, apart.size) < MIN_TRIPLES_PER_BIN:
        return 1.0
    if np.median(apart) <= MAYBE * np.median(side_by_side):
        return 1.0
    variance, lag, last = np.empty(MOST_LAG + 1), 1, np.inf
    variance[1] = _clipped_spread(_all_bends(depth, slope, 1, NOISE_PROFILES)[1]) ** 2
    if variance[1] <= FAINT_MM**2:
        return 1.0
    while lag < MOST_LAG:
        further = _all_bends(depth, slope, lag + 1, NOISE_PROFILES)[1]
        if further.size < MIN_TRIPLES_PER_BIN:
            return 1.0
        variance[lag + 1] = _clipped_spread(further) ** 2
        growth = variance[lag + 1] / variance[lag]
        if growth <= (SETTLED if lag > 1 else SMOOTHED) ** 2:
            break
        if growth > min(((lag + 1) / lag) ** 4, STEADY**2 * last):  # of a bend it is the former
            return 1.0
        last = growth
        lag += 1
    if lag == 1 or _share_of_turns(depth, slope, lag) < INDEPENDENT:
        return 1.0
    shared, total = np.zeros(2 * lag), variance[lag]
    for k in range(lag - 1, 0, -1):
        shared[k] = (6.0 * (variance[lag] - variance[k]) + 2.0 * shared[2 * k]) / 8.0
        total += 2.0 * shared[k]
    return float(np.sqrt(total / variance[1]))


@compiled
def _share_of_turns(depth: FloatArray, slope: FloatArray, lag: int) -> float:
    """How many of the second differences that lie side by side have opposite signs."""
    stride = -(-depth.shape[0] // NOISE_PROFILES)
    bend, turns, all_of_them = np.empty(depth.shape[1]), 0, 0
    for p in range(stride // 2, depth.shape[0], stride):
        _bends(depth[p], slope[p], lag, bend)
        for u in range(depth.shape[1] - lag):
            product = bend[u] * bend[u + lag]
            turns += product < 0.0
            all_of_them += product != 0.0 and np.isfinite(product)
    return turns / all_of_them if all_of_them else 0.0


@compiled
def _by_depth(depth: FloatArray) -> IntArray:
    """The order of depths, sorted only as finely as the noise needs."""
    order, low, high = np.empty(depth.size, np.int64), np.inf, -np.inf
    for d in depth:
        low, high = min(low, d), max(high, d)
    scale = (DEPTH_CELLS - 1) / (high - low) if high > low else 0.0
    filled = np.zeros(DEPTH_CELLS + 1, np.int64)
    for d in depth:
        filled[int((d - low) * scale) + 1] += 1
    for i in range(DEPTH_CELLS):
        filled[i + 1] += filled[i]
    for j in range(depth.size):
        cell = int((depth[j] - low) * scale)
        order[filled[cell]] = j
        filled[cell] += 1
    return order


@compiled
def _clipped_spread(error: FloatArray) -> float:
    # Creases and edges make a heavy tail; three rounds of clipping leave the noise. The factor
    # undoes what clipping a normal distribution at three sigma removes.
    spread = 1.4826 * float(np.median(error))
    for _ in range(3):
        total, n = 0.0, 0
        for e in error:
            if e <= 3.0 * spread:
                total += e * e
                n += 1
        if n > 0:
            spread = float(np.sqrt(total / n)) * 1.0135
    return spread


@compiled
def _growing_noise(depths: FloatArray, sigmas: FloatArray) -> tuple[float, float]:
    squares = depths**2
    mean_square, mean = squares.mean(), sigmas.mean()
    spread, shared = 0.0, 0.0
    for i in range(squares.size):
        spread += (squares[i] - mean_square) ** 2
        shared += (squares[i] - mean_square) * (sigmas[i] - mean)
    if spread == 0.0:
        return mean, 0.0
    b = shared / spread
    a = mean - b * mean_square
    if a < 0.0:
        return 0.0, (sigmas * squares).sum() / (squares**2).sum()
    return (a, b) if b > 0.0 else (mean, 0.0)
