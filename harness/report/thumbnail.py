"""A small still picture of a registered pair, drawn in a moment and without matplotlib."""

from __future__ import annotations

import io
from typing import Any

import numpy as np
from PIL import Image, ImageColor

from harness.figures.looks import FRONT, SOURCE, TARGET, TOP, limits
from harness.figures.pair_view import PairView
from registration.scan import FloatArray

WIDTH, HEIGHT, GAP = 300, 260, 12
Pixels = np.ndarray[Any, np.dtype[np.uint8]]


def thumbnail(pair: PairView) -> bytes:
    """A PNG of both scans, front view beside top view, the source at the estimated pose.

    At the exact pose where the method gave none.
    """
    pose = pair.result.T_target_source
    if pose is None:
        pose = pair.T_target_source_exact
    target = pair.target.points_mm[pair.target.valid]
    source = pair.source.points_mm[pair.source.valid]
    if len(source):
        source = pose.apply(source)
    low, high = limits([target, source])
    page = np.full((HEIGHT, 2 * WIDTH + GAP, 3), 255, dtype=np.uint8)
    for column, projection in enumerate((FRONT, TOP)):
        axes = [projection.right, projection.up]
        span = (high - low)[axes]
        scale = min((WIDTH - 1) / span[0], (HEIGHT - 1) / span[1])
        panel = page[:, column * (WIDTH + GAP) :][:, :WIDTH]
        counts = [_counts((cloud[:, axes] - low[axes]) * scale) for cloud in (target, source)]
        panel[:] = _painted(counts)
    data = io.BytesIO()
    Image.fromarray(page).quantize(64, dither=Image.Dither.NONE).save(data, format="PNG")
    return data.getvalue()


def _counts(places: FloatArray) -> FloatArray:
    """(HEIGHT, WIDTH) points a pixel, the first row at the top."""
    counts, _, _ = np.histogram2d(
        HEIGHT - 1 - places[:, 1], places[:, 0], bins=(HEIGHT, WIDTH),
        range=((-0.5, HEIGHT - 0.5), (-0.5, WIDTH - 0.5)),
    )  # fmt: skip
    return counts


def _painted(counts: list[FloatArray]) -> Pixels:
    """Each pixel in the mixture of the colours of the views that have points there."""
    total = counts[0] + counts[1]
    colours = [np.array(ImageColor.getrgb(colour), float) for colour in (TARGET, SOURCE)]
    mixed = sum(count[..., None] * colour for count, colour in zip(counts, colours, strict=True))
    shown = np.where(total[..., None] > 0, mixed / np.maximum(total, 1)[..., None], 255.0)
    painted: Pixels = np.rint(shown).astype(np.uint8)
    return painted
