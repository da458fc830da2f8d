"""Parameters that no compiled loop could run with are refused, each in one line."""

from __future__ import annotations

from dataclasses import fields, replace

import pytest

from registration.gauss_sphere.params import (
    DecisionParams,
    GaussSphereParams,
    MatchParams,
    OutlineParams,
    RefineParams,
    RotationParams,
    SegmentParams,
    VerificationParams,
    WideParams,
)

STAGES = [f.name for f in fields(GaussSphereParams) if f.name != "calibration"]


@pytest.mark.parametrize(
    ("stage", "arguments", "message"),
    [
        (SegmentParams, {"min_points": 0}, "SegmentParams.min_points is 0; must be a whole number"),
        (SegmentParams, {"min_points": 6.0}, "min_points is 6.0; must be a whole number"),
        (RotationParams, {"kept": 0}, "RotationParams.kept is 0; must be a whole number"),
        (WideParams, {"kept_per_rotation": -1}, "WideParams.kept_per_rotation is -1"),
        (VerificationParams, {"samples": True}, "samples is True; must be a whole number"),
        (OutlineParams, {"cell_mm": 0.0}, "OutlineParams.cell_mm is 0.0; must be above 0"),
        (DecisionParams, {"open_mm": "wide"}, "DecisionParams.open_mm is 'wide'; must be above 0"),
        (DecisionParams, {"rival_share": -0.1}, "rival_share is -0.1; must be at least 0"),
        (RefineParams, {"tail": float("nan")}, "RefineParams.tail is nan; must be above 0"),
        (
            RefineParams,
            {"floors_mm": ()},
            "floors_mm is \\(\\); must be a tuple of numbers",
        ),
        (RefineParams, {"floors_mm": (0.0, 1.0)}, "must be a tuple of numbers above 0"),
        (MatchParams, {"strides": (4, 4, 0, 1)}, "strides .* must be a tuple of whole numbers"),
        (MatchParams, {"strides": (4, 1)}, "tolerances_mm 4, floors_mm 4, strides 2 numbers"),
        (MatchParams, {"tolerances_mm": 5.0}, "tolerances_mm is 5.0; must be a tuple"),
    ],
)
def test_what_cannot_be_is_refused_in_one_line(stage: type, arguments: dict, message: str) -> None:
    with pytest.raises(ValueError, match=message) as caught:
        stage(**arguments)
    assert "\n" not in str(caught.value)


def test_whole_numbers_stand_for_others() -> None:
    assert isinstance(SegmentParams(cliff_mm=8).cliff_mm, float)
    assert all(isinstance(one, float) for one in RefineParams(floors_mm=(1, 2)).floors_mm)


@pytest.mark.parametrize("stage", STAGES)
def test_every_number_is_checked(stage: str) -> None:
    params = getattr(GaussSphereParams(), stage)
    for field in fields(params):
        with pytest.raises(ValueError, match=f"{field.name} is"):
            replace(params, **{field.name: -1})


def test_what_leaves_a_part_out_is_allowed() -> None:
    assert WideParams(starts=0).starts == 0
    assert DecisionParams(turned_planes=0).turned_planes == 0
    assert VerificationParams(contradiction_weight=0).contradiction_weight == 0
