"""A scan described: its beams, the planes that it shows, and samples of them."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from registration.gauss_sphere.fan.beams import Measured, fan_of, measured
from registration.gauss_sphere.fan.calibrated import Known, read_known
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.planes.growing import Growing, growing, grown
from registration.gauss_sphere.planes.patches import Fitting, fit_patches, fitting
from registration.gauss_sphere.planes.segments import Cutting, cutting, find_segments
from registration.gauss_sphere.planes.straightening import straightened
from registration.gauss_sphere.view import View, places_of_samples, view_of
from registration.kernels import compiled
from registration.scan import IntArray, Scan


def describe(scan: Scan, params: GaussSphereParams) -> View:
    """Planes of a scan, with what is needed to compare it with another.

    Raises CalibrationError or OSError where params name a calibration that cannot be read.
    """
    how, known = params.patches, read_known(params.calibration)
    return _described(
        measured(scan, known.apex_mm),
        known,
        cutting(params.segments),
        growing(how),
        fitting(how),
        how.bias_rounds,
        *_places(params.verification.samples, params.strides),
    )


@lru_cache(maxsize=8)
def _places(n: int, strides: tuple[int, ...]) -> tuple[IntArray, IntArray]:
    looked_at = np.array(strides)
    return places_of_samples(n, looked_at), looked_at


@compiled
def _described(
    scan: Measured,
    known: Known,
    cuts: Cutting,
    joins: Growing,
    fit: Fitting,
    bias_rounds: int,
    place: IntArray,
    strides: IntArray,
) -> View:
    # In one call, because to hand a scan's arrays from one to the next through Python costs time.
    fan = fan_of(scan)
    measured_mm = fan.depth_mm
    if known.given:
        pieces = grown(fan, find_segments(fan, cuts), joins)
        fan = straightened(fan, pieces, known, bias_rounds)
    points = grown(fan, find_segments(fan, cuts), joins)
    patches = fit_patches(fan, measured_mm, points, known, fit)
    return view_of(fan, patches, place, strides, cuts.max_gap_pixels)
