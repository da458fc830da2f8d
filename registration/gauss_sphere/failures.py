"""Why two scans got no pose, in words that tell what would have worked."""

from __future__ import annotations

import numpy as np

from registration.gauss_sphere.fan.beams import Fan, seems_turned_around
from registration.gauss_sphere.judging.open_directions import sliding
from registration.gauss_sphere.params import PatchParams
from registration.gauss_sphere.view import View
from registration.result import RegistrationResult

ONE_DIRECTION_RAD = 0.1
FARTHEST_MM, NEAREST_MM = 0.9e5, 10.0


def no_plane(name: str, view: View, params: PatchParams) -> RegistrationResult:
    """The result where the view of that name, target or source, shows no plane."""
    returned = np.isfinite(view.fan.depth_mm)
    unmoved = returned.any(axis=1).sum() > 1 and view.fan.gap_mm == 0.0
    reason = (
        f"no plane found in the {name} scan ({returned.sum()} measured points); at least "
        f"{params.min_profiles} profiles with {params.min_points} points on one plane are needed"
    )
    if unmoved:
        reason += (
            "; all profiles lie at one X: points are to stand where the sensor's motion along X "
            "puts them"
        )
    return RegistrationResult(None, "failed", reason, stage="patches" if returned.any() else "scan")


def no_rotation(target: View, source: View) -> RegistrationResult:
    """The result where no two directions of one view subtend the angle of two of the other."""
    one_way = [view for view in (target, source) if _is_of_one_direction(view)]
    if not one_way:
        return RegistrationResult(
            None,
            "failed",
            "no two planes of one view subtend the angle of two planes of the other: the views "
            "may not overlap",
            stage="rotation",
        )
    of_target = one_way[0] is target
    return RegistrationResult(
        None,
        "underdetermined",
        f"the {'target' if of_target else 'source'} scan shows planes of one direction only "
        f"({one_way[0].patches.n_points.size} found): a turn about their normal and shifts along "
        "them stay open; a second plane at an angle is needed",
        undetermined=sliding(target.patches) if of_target else np.zeros((0, 6)),
        stage="scene",
    )


def no_pose() -> RegistrationResult:
    """The result where no rotation and shift lay planes on planes."""
    return RegistrationResult(
        None,
        "failed",
        "no pose lays two planes of one view on planes of the other: the views may not overlap",
        stage="translation",
    )


def oddities(target: View, source: View) -> tuple[str, ...]:
    """What may be wrong with scans whose points lie where no profile scanner sees any."""
    return (*_oddities("target", target.fan), *_oddities("source", source.fan))


def _oddities(name: str, fan: Fan) -> list[str]:
    notes = []
    lean_y, lean_z = fan.lean[:, None, None] * fan.x_mm[:, None]
    depth_mm = fan.depth_mm + fan.apex_mm[2] + lean_z
    aside_mm = fan.slope * fan.depth_mm + fan.apex_mm[1] + lean_y
    returned = np.isfinite(depth_mm).sum()
    near = np.count_nonzero((abs(depth_mm) < NEAREST_MM) & (abs(aside_mm) < NEAREST_MM))
    far = np.count_nonzero(depth_mm > FARTHEST_MM)
    if near:
        notes.append(
            f"{near} of {returned} points of the {name} scan lie within {NEAREST_MM:g} mm of "
            "Y = Z = 0: give NaN where nothing returned, lengths in mm"
        )
    if seems_turned_around(fan):
        notes.append(
            f"the farther away points of the {name} scan lie, the closer together are their "
            "beams, as where Z is height: give depth as Z, which grows away from the sensor"
        )
    if far:
        notes.append(
            f"{far} of {returned} points of the {name} scan lie more than "
            f"{FARTHEST_MM / 1e3:g} m away: where nothing returned, give NaN"
        )
    return notes


def _is_of_one_direction(view: View) -> bool:
    across = np.cross(view.patches.normal, view.patches.normal[0])
    return bool((np.linalg.norm(across, axis=1) < ONE_DIRECTION_RAD).all())
