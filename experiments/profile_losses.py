"""Why pairs of profiles are left out of the mean of section 6.2: what the exact pose tells."""

from __future__ import annotations

import numpy as np
import pandas as pd

from experiments.profile_pairs import ProfilePair, register_profiles
from experiments.profile_tables import ranges
from harness.scoring import six_parameters
from harness.tables.table import Table
from harness.trials.specs import Trial
from registration.planar.circle import wrapped
from registration.planar.overlap import line_table, total_overlaps
from registration.planar.params import PlanarParams
from registration.planar.pipeline import PlanarEvidence
from registration.planar.search import pair_poses
from registration.scan import FloatArray

LITTLE = 0.25  # share of the shorter profile, as PlanarParams.min_overlap has it
LIKE_TURN_RAD = 0.1  # a candidate farther than this from the exact turn is of other faces
KINDS = ("far", "little", "neither")


def loss_table(trial: Trial, rows: pd.DataFrame) -> Table | None:
    """How many pairs of profiles of a trial are left out, by what made them hard.

    rows: of this trial, as profile_pairs.measure gives them. None for a method that leaves no
    segments of its own.
    """
    params = trial.spec.method.params
    if not isinstance(params, PlanarParams):
        return None
    kinds = [kind_of(pair, params) for pair in register_profiles(trial)]
    left_out = (rows["rotation_x_deg"].isna() | rows["outlier"]).to_numpy()
    names = {
        "far": f"No pair of segments has its centroids within {params.offset_tolerance_mm:g} mm of "
        "where they belong",
        "little": f"Both views share less than {LITTLE:.0%} of the shorter profile",
        "neither": "Neither",
    }
    records = []
    for kind in KINDS:
        of_kind = np.array([each == kind for each in kinds])
        profiles = rows["profile"].to_numpy()[of_kind & left_out].tolist()
        records.append(
            {
                "Under the exact pose": names[kind],
                "Pairs": int(of_kind.sum()),
                "Left out of the mean": len(profiles),
                "Profiles left out": ranges(profiles),
            }
        )
    return Table(
        "section_6.2_left_out",
        f"Section 6.2, what the pairs left out have in common, {trial.label}, repeat 0",
        "The search of section 4.2.2 tries the poses that lay the centroid of one segment on that "
        "of another, (4-1) to (4-3). Where the views see different parts of every face, none of "
        "these is near the exact pose; where they share little, a wrong pose may overlap as much. "
        "The thesis kept 42 of 44 pairs of a piece of foam that it does not describe.",
        pd.DataFrame(records),
        {"Pairs": "d", "Left out of the mean": "d"},
        in_full=True,
    )


def kind_of(pair: ProfilePair, params: PlanarParams) -> str:
    """Which of KINDS a pair of profiles is under its exact pose, by the segments found."""
    found = pair.result.evidence["planar"]
    assert isinstance(found, PlanarEvidence)
    target, source = found.segments
    if len(target) == 0 or len(source) == 0:
        return "little"
    six = six_parameters(pair.exact)
    exact = np.array([-np.deg2rad(six[0]), six[4], six[5]])
    candidates = pair_poses(target, source)
    alike = candidates[np.abs(wrapped(candidates[:, 0] - exact[0])) < LIKE_TURN_RAD]
    middle = source.centroid_mm[:, 1:].mean(axis=0)
    off_mm = np.linalg.norm(_moved(middle, alike) - _moved(middle, exact[None]), axis=1)
    if off_mm.min(initial=np.inf) > params.offset_tolerance_mm:
        return "far"
    lines = line_table(target), line_table(source)
    tolerances = params.angle_tolerance_rad, params.offset_tolerance_mm
    shared_mm = float(total_overlaps(*lines, exact[None], *tolerances)[0][0])
    shorter_mm = min(circle.length_mm.sum() for circle in found.circles)
    return "little" if shared_mm < LITTLE * shorter_mm else "neither"


def _moved(point_mm: FloatArray, poses: FloatArray) -> FloatArray:
    """(h, 2) where each motion (h, 3) of (4-1) to (4-3) takes a point (2,)."""
    cos, sin = np.cos(poses[:, 0]), np.sin(poses[:, 0])
    turned = np.stack(
        [cos * point_mm[0] + sin * point_mm[1], cos * point_mm[1] - sin * point_mm[0]], axis=1
    )
    moved: FloatArray = turned + poses[:, 1:]
    return moved
