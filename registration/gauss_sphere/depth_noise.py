"""The noise of a scan's depths, from the scan alone."""

from __future__ import annotations

import numpy as np

from registration.kernels import compiled
from registration.scan import FloatArray, IntArray

DEPTH_BINS = 6
DEPTH_CELLS = 512
NOISE_PROFILES = 16  # enough for the noise to a few percent
MIN_TRIPLES_PER_BIN = 50
MIN_SIGMA_MM = 0.02


@compiled
def depth_noise(depth_mm: FloatArray, slope: FloatArray) -> tuple[float, float]:
    """Estimate the noise of the depths from their neighbours along the profile.

    The second difference of the inverse depth over the slope vanishes on a plane. Its clipped
    spread in bins of depth, from profiles spread over the scan, is fitted by
    sigma = a + b depth^2, both not negative. Returns (a in mm, b in 1/mm).
    """
    depths, sigmas = _noise_by_depth(depth_mm, slope)
    if depths.size == 0:  # as where only every second beam returns
        depths, sigmas = _noise_by_depth(*_closed_up(depth_mm, slope))
    return _growing_noise(depths, sigmas) if depths.size else (MIN_SIGMA_MM, 0.0)


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
    stride = max(1, depth.shape[0] // NOISE_PROFILES)
    middle, error = np.empty(depth.size), np.empty(depth.size)
    off = np.empty(depth.shape[1])
    n = 0
    for p in range(stride // 2, depth.shape[0], stride):
        # First what, then whether: the first loop runs on vectors of points.
        for u in range(1, depth.shape[1] - 1):
            a, b, c = depth[p, u - 1], depth[p, u], depth[p, u + 1]
            share = (slope[p, u] - slope[p, u - 1]) / (slope[p, u + 1] - slope[p, u - 1])
            bend = 1.0 / b - (1.0 - share) / a - share / c
            size = np.sqrt(1.0 + share * share + (1.0 - share) * (1.0 - share))
            off[u] = abs(bend) * b * b / size if 0.2 < share < 0.8 else np.nan
        for u in range(1, depth.shape[1] - 1):
            if np.isfinite(off[u]):
                middle[n], error[n] = depth[p, u], off[u]
                n += 1
    bins = min(DEPTH_BINS, n // MIN_TRIPLES_PER_BIN)
    depths, sigmas = np.empty(bins), np.empty(bins)
    order = _by_depth(middle[:n])
    for i in range(bins):
        chosen = order[i * n // bins : (i + 1) * n // bins]
        depths[i] = middle[chosen].mean()
        sigmas[i] = _clipped_spread(error[chosen])
    return depths, sigmas


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
    return max(spread, MIN_SIGMA_MM)


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
