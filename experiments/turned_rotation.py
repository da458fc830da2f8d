"""What an error of the rotation does to the translation that is estimated on it (section 6.6)."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform, Rotation

from harness.config.schema import AimedView
from harness.execution import scan_view
from harness.scoring import exact_pose
from harness.trials.specs import Trial, TrialSpec, keyed_rng
from registration.gauss_sphere.candidates.translation import pose_candidates
from registration.gauss_sphere.describing import describe
from registration.gauss_sphere.params import GaussSphereParams
from registration.scan import FloatArray, Scan
from registration.thesis.outcome import decide
from registration.thesis.params import ThesisParams
from registration.thesis.pipeline import register_scans
from registration.thesis.rotation import RotationSearch


@dataclass(frozen=True)
class Turning:
    """A trial whose rotation is given: the true one, turned by these angles about random axes."""

    trial: Trial
    angles_deg: tuple[float, ...]
    axes: int


def middle_mm(spec: TrialSpec) -> FloatArray:
    """(3,) what the views of a trial look at, in the target's frame."""
    aim = spec.target.aim
    assert isinstance(aim, AimedView)  # discussion_trials lets no others in
    world_mm = np.asarray(aim.aim_mm, dtype=np.float64)
    middle: FloatArray = spec.path(spec.target).T_world_view.inv().apply(world_mm)
    return middle


def turn(turning: Turning) -> list[dict[str, Any]]:
    """Estimate the translation for every turned rotation; a row for each. Runs in a worker.

    Columns: pair, method, repeat, axis, angle_deg; translation_error_mm, NaN without an estimate;
    middle_error_mm, how far the middle of the scene is off; lever_mm, how far the turn moves it
    about the source's origin, which the best translation makes up for.
    """
    spec = turning.trial.spec
    assert isinstance(spec, TrialSpec)
    target, source = scan_view(spec, spec.target), scan_view(spec, spec.source)
    exact = exact_pose(*spec.paths)
    middle = middle_mm(spec)
    source_middle = exact.inv().apply(middle)
    rotations, labels = [], []
    for axis, direction in enumerate(_axes(spec, turning.axes)):
        for angle_deg in turning.angles_deg:
            turned = Rotation.from_rotvec(np.radians(angle_deg) * direction) * exact.rotation
            rotations.append(turned)
            labels.append((axis, angle_deg))
    rows = []
    for (axis, angle_deg), rotation, shift_mm in zip(
        labels, rotations, _shifts(target, source, spec, rotations), strict=True
    ):
        error = middle_error = np.nan
        if shift_mm is not None:
            pose = RigidTransform.from_components(shift_mm, rotation)
            error = float(np.linalg.norm(shift_mm - exact.translation))
            middle_error = float(np.linalg.norm(pose.apply(source_middle) - middle))
        lever = rotation.apply(source_middle) - exact.rotation.apply(source_middle)
        rows.append(
            {
                "pair": turning.trial.pair,
                "method": turning.trial.label,
                "repeat": spec.repeat,
                "axis": axis,
                "angle_deg": angle_deg,
                "translation_error_mm": error,
                "middle_error_mm": middle_error,
                "lever_mm": float(np.linalg.norm(lever)),
            }
        )
    return rows


def _axes(spec: TrialSpec, count: int) -> FloatArray:
    """(count, 3) unit axes, keyed by the pair and the repeat: the same for every method."""
    rng = keyed_rng(spec.pair_key() + f"{spec.repeat} {spec.seed}")
    axes = rng.normal(size=(count, 3))
    unit: FloatArray = axes / np.linalg.norm(axes, axis=1, keepdims=True)
    return unit


def _shifts(
    target: Scan, source: Scan, spec: TrialSpec, rotations: Sequence[Rotation]
) -> Iterator[FloatArray | None]:
    """The translation that the method's own stage finds for each rotation, or None."""
    params = spec.method.params
    if isinstance(params, ThesisParams):
        # Whether it is believed is another question: any translation counts.
        found = register_scans(target, source, params).evidence
        for rotation in rotations:
            search = RotationSearch(rotation.as_matrix()[None], np.ones(1))
            answer = decide(found["target"], found["source"], search, params)
            poses = [answer.T_target_source, *(c.T_target_source for c in answer.candidates)]
            known = [pose for pose in poses if pose is not None]
            yield known[0].translation if known else None
        return
    assert isinstance(params, GaussSphereParams)
    views = [describe(scan, params) for scan in (target, source)]
    for rotation in rotations:
        _, shifts_mm, _ = pose_candidates(
            views[0].patches, views[1].patches, rotation.as_matrix()[None], params.translation
        )
        yield shifts_mm[0] if len(shifts_mm) else None
