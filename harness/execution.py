"""One trial from its spec to its row: scan both views, register them, score the estimate."""

from __future__ import annotations

import dataclasses
import time
import traceback
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.figures.pair_view import PairView
from harness.recent import Recent
from harness.scoring import diagnosis
from harness.scoring.common_points import Common, common_points, pose_bounds
from harness.scoring.face_gaps import FaceGaps, centroid_gaps
from harness.scoring.poses import encoder_pose, exact_pose, pose_error
from harness.store import Row, RowStatus
from harness.trials.random_pairs import NoPairError, RandomSpec, drawn_spec
from harness.trials.specs import Trial, TrialSpec
from harness.trials.views import ViewSpec
from registration.methods import register
from registration.result import RegistrationResult
from registration.scan import FloatArray, Scan
from registration.thesis.evidence import ViewEvidence
from scenes import SCENES
from scenes.scene import Scene
from sensors import SENSORS
from sensors.sensor import Hits, Sensor

# Below this share of common points two views have nothing to be registered by; it prints as 0 %.
NO_OVERLAP = 0.005

_scenes, _scans, _hits, _commons = Recent(4), Recent(12), Recent(8), Recent(64)
_bounds, _pairs = Recent(64), Recent(256)


@dataclass(frozen=True)
class Outcome:
    """The row of a trial; the pair for the figures, where there is one to draw."""

    row: Row
    pair: PairView | None = None


def perform(trial: Trial) -> Outcome:
    """Run one trial; an exception becomes a row of status "error" with its traceback."""
    try:
        return _perform(trial)
    except Exception as error:
        return _failed({"id": trial.id, "spec": trial.spec.text}, error)


def _failed(row: dict[str, Any], error: Exception) -> Outcome:
    """The row of a trial in which an exception was raised, with what was known before."""
    reason = f"{type(error).__name__}: {error}".splitlines()[0]
    return Outcome(Row(**row, status="error", reason=reason, traceback=traceback.format_exc()))


def scan_view(spec: TrialSpec, view: ViewSpec) -> Scan:
    """The scan of one view of a trial, made once for all trials of a process that share it."""
    return _scans.get(
        spec.view_key(view),
        lambda: sensor_of(spec).scan(scene_of(spec), spec.path(view), spec.view_rng(view)),
    )


def _perform(trial: Trial) -> Outcome:
    spec = full_spec(trial)
    start = time.perf_counter()
    target, source = scan_view(spec, spec.target), scan_view(spec, spec.source)
    scanned = time.perf_counter()
    shares = common(spec).shares
    bounds = _pose_bounds(spec, target, source)
    measured = time.perf_counter()
    T_exact = exact_pose(*spec.paths)
    stage_ms = {"scan": 1e3 * (scanned - start), "overlap": 1e3 * (measured - scanned)}
    row: dict[str, Any] = {
        "id": trial.id,
        "spec": spec.text,
        "T_exact": T_exact,
        "T_theoretical": encoder_pose(*spec.paths),
        "overlap_target": shares[0],
        "overlap_source": shares[1],
        "bounds": bounds,
    }
    if max(shares) < NO_OVERLAP:
        reason = (
            f"views {spec.source.name} and {spec.target.name} overlap by {max(shares):.0%}: "
            "neither sees what the other measured, so no method can register them"
        )
        for view, scan in ((spec.source, source), (spec.target, target)):
            if scan.n_valid == 0:
                reason += f"; {view.name} measures no point, no surface lies in its field and range"
        counts = {"points_target": target.n_valid, "points_source": source.n_valid}
        return Outcome(
            Row(**row, status="no_overlap", reason=reason, counts=counts, stage_ms=stage_ms)
        )
    try:
        result = _register(spec, target, source)
    except Exception as bug:
        return _failed(row, bug)  # a failure of its method, on a pair of known overlap
    stage_ms |= result.stage_ms | {"registration": 1e3 * (time.perf_counter() - measured)}
    error = None
    if result.T_target_source is not None:
        error = pose_error(T_exact, result.T_target_source)
    status: RowStatus = result.status
    return Outcome(
        Row(
            **row,
            status=status,
            reason=result.reason,
            T_estimated=result.T_target_source,
            rotation_error_deg=None if error is None else float(np.rad2deg(error.rotation_rad)),
            translation_error_mm=None if error is None else error.translation_mm,
            covariance=result.covariance,
            undetermined=result.undetermined,
            counts=_counts(target, source, result),
            stage_ms=stage_ms,
            stage=result.stage,
            notes=tuple(result.notes),
        ),
        PairView(
            pair=trial.pair,
            scene=spec.scene.name,
            target_view=spec.target.name,
            source_view=spec.source.name,
            method=trial.label,
            repeat=spec.repeat,
            target=target,
            source=source,
            T_target_source_exact=T_exact,
            overlap=shares[1],
            result=result,
        ),
    )


def _register(spec: TrialSpec, target: Scan, source: Scan) -> RegistrationResult:
    """Register by the method, or by `thesis` with the truth in place of one stage's result."""
    if not spec.given:
        return register(target, source, spec.method.name, spec.method.params)
    if spec.given == "rotation":
        T_exact = exact_pose(*spec.paths)
        return diagnosis.register_with_true_rotation(target, source, T_exact, spec.method.params)
    hits = _both_hits(spec)
    if spec.given == "shared_patches":
        hits = _both_shared(spec)
    enter = diagnosis.register_with_true_patches
    if spec.given == "segments":
        enter = diagnosis.register_with_true_segments
    return enter(*hits, spec.step_mm, sensor_of(spec).apex_mm, spec.method.params)


def full_spec(trial: Trial) -> TrialSpec:
    """The spec of a trial; the pair of a random one is drawn, for every method the same."""
    spec = trial.spec
    if isinstance(spec, RandomSpec):
        pair = _pairs.get(spec.pair_key(), lambda: _drawn(spec))
        if isinstance(pair, NoPairError):
            raise NoPairError(str(pair))  # anew, or each trial's traceback would grow by the last
        return dataclasses.replace(
            pair,
            sensor=spec.sensor,
            profiles=spec.profiles,
            step_mm=spec.step_mm,
            method=spec.method,
        )
    if not isinstance(spec, TrialSpec):
        raise TypeError(f"{type(spec).__name__} is no spec of a trial")
    return spec


def _drawn(spec: RandomSpec) -> TrialSpec | NoPairError:
    """The pair of a spec, or why there is none: the other methods need not search again."""
    try:
        return drawn_spec(spec, lambda drawn: common(drawn).shares)
    except NoPairError as error:
        return error.with_traceback(None)


def common(spec: TrialSpec) -> Common:
    """Which points of either view the other sees too."""
    return _commons.get(
        spec.pair_key(),
        lambda: common_points(sensor_of(spec), scene_of(spec), _both_hits(spec), spec.paths),
    )


def face_gaps(spec: TrialSpec) -> FaceGaps:
    """How far apart both views of a trial of `thesis` see the middles of the same faces."""
    T_exact, apex_mm = exact_pose(*spec.paths), sensor_of(spec).apex_mm

    def gaps(one: Hits, other: Hits) -> FloatArray:
        return centroid_gaps(one, other, T_exact, apex_mm, spec.method.params)

    return FaceGaps(gaps(*_both_hits(spec)), gaps(*_both_shared(spec)))


def _pose_bounds(spec: TrialSpec, target: Scan, source: Scan) -> FloatArray | None:
    """The Cramer-Rao bounds of the pair, from the beams that returned in these scans."""
    measured = target.valid, source.valid
    return _bounds.get(
        spec.view_key(spec.target) + spec.view_key(spec.source),
        lambda: pose_bounds(
            sensor_of(spec), scene_of(spec), _both_hits(spec), spec.paths, measured, common(spec)
        ),
    )


def _both_hits(spec: TrialSpec) -> tuple[Hits, Hits]:
    return _view_hits(spec, spec.target), _view_hits(spec, spec.source)


def _both_shared(spec: TrialSpec) -> tuple[Hits, Hits]:
    """The hits of either view that the other view sees too."""
    (target, source), both = _both_hits(spec), common(spec)
    return diagnosis.only(target, both.target), diagnosis.only(source, both.source)


def _view_hits(spec: TrialSpec, view: ViewSpec) -> Hits:
    return _hits.get(
        spec.place_key(view), lambda: sensor_of(spec).hits(scene_of(spec), spec.path(view))
    )


def scene_of(spec: TrialSpec) -> Scene:
    """The scene of a trial, built once for all trials of a process that share it."""
    chosen = spec.scene
    return _scenes.get(chosen.text, lambda: SCENES[chosen.name].builder(chosen.params))


def sensor_of(spec: TrialSpec) -> Sensor:
    """The sensor of a trial."""
    sensor: Sensor = SENSORS[spec.sensor.name].factory(spec.sensor.params)
    return sensor


def _counts(target: Scan, source: Scan, result: RegistrationResult) -> dict[str, int]:
    """How much each stage was left with, where the method says so."""
    counts = {"points_target": target.n_valid, "points_source": source.n_valid}
    for role in ("target", "source"):
        view = result.evidence.get(role)
        if isinstance(view, ViewEvidence):
            if view.segments is not None:
                counts[f"segments_{role}"] = len(view.segments)
            counts[f"patches_{role}"] = len(view.patches)
            counts[f"normals_{role}"] = len(view.sphere)
    return counts
