"""The planes of a scan: profiles cut to segments, these grown to patches, and planes fitted."""

from __future__ import annotations

from registration.gauss_sphere.beams import Fan
from registration.gauss_sphere.calibrated import Known
from registration.gauss_sphere.growing import Growing, growing, grown
from registration.gauss_sphere.params import GaussSphereParams
from registration.gauss_sphere.patches import Fitting, Patches, fit_patches, fitting
from registration.gauss_sphere.segments import Cutting, cutting, find_segments
from registration.gauss_sphere.straightening import straightened
from registration.kernels import compiled


def planes_of(measured: Fan, known: Known, params: GaussSphereParams) -> tuple[Fan, Patches]:
    """The planes of a scan, and the scan with what is known of its sensor taken into account."""
    how = params.patches
    return _planes_of(
        measured, known, cutting(params.segments), growing(how), fitting(how), how.bias_rounds
    )


@compiled
def _planes_of(
    measured: Fan, known: Known, cuts: Cutting, joins: Growing, fit: Fitting, bias_rounds: int
) -> tuple[Fan, Patches]:
    # In one loop, because to hand a scan's arrays from one to the next through Python costs time.
    fan = measured
    if known.given:
        pieces = grown(measured, find_segments(measured, cuts), joins)
        fan = straightened(measured, pieces, known, bias_rounds)
    points = grown(fan, find_segments(fan, cuts), joins)
    return fan, fit_patches(fan, measured.depth_mm, points, known, fit)
