from __future__ import annotations

from dataclasses import FrozenInstanceError, fields

import pytest

from registration.thesis import params as p


@pytest.mark.parametrize(
    ("build", "message"),
    [
        (lambda: p.SegmentParams(warp_mm=-4.0), "SegmentParams.warp_mm is -4.0; must be above 0"),
        (lambda: p.SegmentParams(cliff_mm=float("nan")), "SegmentParams.cliff_mm is nan"),
        (lambda: p.SegmentParams(seed="best"), "one of first_points, running"),
        (lambda: p.SegmentParams(seed_points=1), "must be a whole number, at least 2"),
        (lambda: p.SegmentParams(min_points=2.5), "must be a whole number, at least 2"),
        (lambda: p.SegmentParams(warp_mm="4"), "SegmentParams.warp_mm is '4'"),
        (lambda: p.MergeParams(overlap_th=20), "must be at least 0 and at most 1"),
        (lambda: p.MergeParams(rule="all"), "one of literal, global, segments"),
        (lambda: p.PatchParams(min_profiles=1), "PatchParams.min_profiles is 1"),
        (lambda: p.PreprocessParams(median_width=4), "must be an odd number"),
        (lambda: p.SphereParams(close_normal=3.0), "at most 2"),
        (lambda: p.RotationParams(zero_rotation="x"), "one of none, z"),
        (lambda: p.TranslationParams(window_mm=0), "must be above 0"),
        (lambda: p.BeliefParams(min_shifts=0), "at least 1"),
    ],
)
def test_a_wrong_value_is_refused_in_one_line(build, message: str) -> None:
    with pytest.raises(ValueError, match=message.replace(".", r"\.")) as caught:
        build()
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("preset", [p.ThesisParams(), p.ThesisParams.literal()])
def test_the_thesiss_printed_parameters_are_in_every_preset(preset: p.ThesisParams) -> None:
    assert (preset.segments.warp_mm, preset.segments.cliff_mm) == (4.0, 10.0)
    assert (preset.merge.rotation_th_rad, preset.merge.overlap_th) == (0.025, 0.20)
    assert preset.sphere.close_normal == 0.025
    assert preset.preprocess.median_width == 5
    for stage in fields(preset):
        with pytest.raises(FrozenInstanceError):
            setattr(preset, stage.name, None)
