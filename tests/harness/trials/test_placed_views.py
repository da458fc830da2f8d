"""Views that a config places by another: where they are then."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from shipped_configs import OF_TRIALS

from harness.config.reading import load_experiment
from harness.config.schema import PrintedPose
from harness.scoring.poses import encoder_pose, exact_pose, pose_error, six_parameters
from harness.trials.specs import build_trials
from harness.trials.views import relabelled


def trials_of(file: Path, *overrides: str):
    return build_trials(load_experiment(file, overrides), file)


@pytest.mark.parametrize("labels", ["printed", "swapped", "cyclic"])
def test_a_placed_view_has_the_printed_pose(small_file: Path, labels: str) -> None:
    spec = trials_of(small_file, f"rotation_labels={labels}")[0].spec
    exact = six_parameters(exact_pose(spec.path(spec.target), spec.path(spec.source)))
    turns = {"printed": [1, 2, 12], "swapped": [12, 2, 1], "cyclic": [12, 1, 2]}[labels]
    np.testing.assert_allclose(exact, [*turns, 5.0, -140.0, 10.0], atol=1e-9)


def test_a_relative_view_has_the_pose_it_is_given(small_file: Path) -> None:
    spec = trials_of(small_file)[1].spec
    exact = six_parameters(exact_pose(spec.path(spec.target), spec.path(spec.source)))
    np.testing.assert_allclose(exact, [4.0, 0.0, 0.0, 0.0, -50.0, 0.0], atol=1e-9)


@pytest.mark.parametrize("file", OF_TRIALS, ids=lambda file: file.stem)
def test_configured_pairs_are_commanded_to_the_poses_of_the_thesis(file: Path) -> None:
    """And the encoders say so too, but for the rounding of their counts."""
    experiment = load_experiment(file)
    for trial in {trial.pair: trial for trial in build_trials(experiment, file)}.values():
        printed = experiment.pairs[trial.pair].printed
        if printed is None:
            continue
        spec = trial.spec
        T_target, T_source = (
            view.commanded(spec.profiles, spec.step_mm) for view in (spec.target, spec.source)
        )
        rotation_deg, translation_mm = relabelled(printed, experiment.rotation_labels)
        asked = six_parameters(T_target.inv() * T_source)
        np.testing.assert_allclose(asked, [*rotation_deg, *translation_mm], atol=1e-9)
        told = encoder_pose(spec.path(spec.target), spec.path(spec.source))
        assert told is not None
        off = pose_error(T_target.inv() * T_source, told)
        assert np.rad2deg(off.rotation_rad) < 0.01
        assert off.translation_mm < 0.1


def test_relabelling_moves_the_angles_only() -> None:
    pose = PrintedPose(rotation_deg=(1.0, 2.0, 3.0), translation_mm=(4.0, 5.0, 6.0))
    assert relabelled(pose, "swapped") == ((3.0, 2.0, 1.0), (4.0, 5.0, 6.0))
    assert relabelled(pose, "cyclic") == ((3.0, 1.0, 2.0), (4.0, 5.0, 6.0))
