"""The experiment `profiles`: two views registered profile by profile in the plane (section 6.2)."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any, Literal

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from experiments import profile_means
from experiments.profile_means import MOTION, outliers
from harness.config.errors import ConfigError
from harness.config.reading import check_names, dump_yaml, overridden_mapping, validated
from harness.config.resolved import with_defaults
from harness.config.schema import Experiment
from harness.execution import scan_view
from harness.provenance import code_fingerprint, note_run
from harness.report.packing import write_whole
from harness.results import check_folder, results_folder
from harness.scoring import pose_error, six_parameters
from harness.tables.table import Table, write_tables
from harness.tables.views import sensing_tables
from harness.trials.specs import Trial, TrialSpec, build_trials
from harness.workers.pool import MakeExecutor, shutting_down
from registration.methods import METHODS, PROFILE_METHODS, find_method
from registration.result import RegistrationResult
from registration.scan import Scan

KIND = "profiles"
REHEARSED = 5  # pairs of profiles that a dry run times
OWN_CODE = [Path(__file__), Path(profile_means.__file__)]  # what rows depend on
ROWS, TIMES = "profiles.csv", "times.csv"
TIME_COLUMNS = ["pair", "method", "repeat", "profile", "ms"]


class ProfilesExperiment(Experiment):
    """An experiment on pairs of views whose profiles k are registered to each other one by one."""

    experiment: Literal["profiles"]


@dataclass(frozen=True)
class ProfilePair:
    """One pair of profiles as the figures need it, and what a method made of it.

    target, source: scans of one profile. exact: their exact T_target_source.
    """

    trial: Trial
    target_view: str
    source_view: str
    profile: int
    elevation_mm: float
    target: Scan
    source: Scan
    exact: RigidTransform
    result: RegistrationResult


def run_profiles(
    path: Path,
    folder: Path | None,
    overrides: Sequence[str] = (),
    seed: int | None = None,
    make_executor: MakeExecutor | None = None,
) -> tuple[list[Table], Path]:
    """Register all pairs of profiles, write rows, tables and figures; returns tables and folder.

    make_executor: of the processes that register; without it, this one does. Raises ConfigError
    before anything is written. Rows are kept once all are there: the same run of the same code
    takes them again.
    """
    from experiments.profile_figures import draw_profiles
    from experiments.profile_tables import profile_tables

    experiment, trials = load_profiles(path, overrides, seed)
    folder = results_folder(folder, path.stem)
    check_folder(folder)
    rows = kept_rows(experiment, trials, folder)
    if rows is None:
        rows = measure(trials, make_executor)
        _keep(experiment, trials, rows, folder)
    tables = [*profile_tables(experiment, rows), *sensing_tables(trials)]
    write_tables(tables, folder / "tables")
    draw_profiles(experiment, trials, rows, folder / "figures")
    return tables, folder


def rehearse_profiles(
    path: Path, folder: Path | None, overrides: Sequence[str] = (), seed: int | None = None
) -> list[str]:
    """What a run would do and how long it would take, in lines; writes nothing.

    Raises ConfigError.
    """
    experiment, trials = load_profiles(path, overrides, seed)
    folder = results_folder(folder, path.stem)
    pairs = len(trials) * experiment.scan.profiles
    told = f"{experiment.title}: {pairs} pairs of profiles"
    if kept_rows(experiment, trials, folder) is not None:
        return [f"{told}, all at hand in {folder}: only tables and figures would be built again"]
    some = islice(register_profiles(trials[0]), REHEARSED)
    each_ms = float(np.median([pair.result.stage_ms["registration"] for pair in some]))
    return [
        f"{told} to register, about {1e-3 * each_ms * pairs:.0f} s on one core and some 10 s for "
        "the figures",
        f"Would be written to {folder}",
    ]


def check_kept(
    path: Path, folder: Path | None, overrides: Sequence[str] = (), seed: int | None = None
) -> None:
    """Raise ConfigError where a folder has no rows of this very config and code."""
    folder = results_folder(folder, path.stem)
    if kept_rows(*load_profiles(path, overrides, seed), folder) is None:
        message = f"{folder} has no rows of this config and this code; run it without first"
        raise ConfigError("--report-only", (), message)


def load_profiles(
    path: Path, overrides: Sequence[str] = (), seed: int | None = None
) -> tuple[ProfilesExperiment, Sequence[Trial]]:
    """Read and check a config; a trial holds all profiles of a pair. Raises ConfigError."""
    data = overridden_mapping(path, overrides, seed)
    experiment: ProfilesExperiment = validated(ProfilesExperiment, data, path)
    check_names(experiment, path)
    for key in ("sweep", "limits"):
        if data.get(key) is not None:
            raise ConfigError(path, (key,), f"says nothing to an experiment of kind {KIND!r}")
    for index, method in enumerate(experiment.methods):
        if method.name in METHODS:
            raise ConfigError(
                path,
                ("methods", index, "name"),
                f"{method.name!r} registers whole scans; single profiles are registered by "
                f"{', '.join(PROFILE_METHODS)}, or a function of your own",
            )
    return experiment, build_trials(experiment, path)


def kept_rows(
    experiment: ProfilesExperiment, trials: Sequence[Trial], folder: Path
) -> pd.DataFrame | None:
    """The rows that the same code wrote for the same configuration, as of measure; None if none."""
    try:
        config = (folder / "config.yaml").read_text(encoding="utf-8")
        facts = json.loads((folder / "run.json").read_text(encoding="utf-8"))
        rows, times = (pd.read_csv(folder / name) for name in (ROWS, TIMES))
    except (OSError, ValueError):  # ValueError: cut off while writing
        return None
    written = dump_yaml(with_defaults(experiment, trials)), _code(experiment)
    if (config, facts.get("code")) != written or len(rows) != len(times):
        return None
    rows["reason"] = rows["reason"].fillna("")
    return rows.assign(ms=times["ms"])


def measure(trials: Sequence[Trial], make_executor: MakeExecutor | None = None) -> pd.DataFrame:
    """Register every profile of every trial; a row for each, the outliers marked.

    Columns: pair, method, repeat, profile, elevation_mm, status, reason, the MOTION, found and as
    exact_*, rotation_error_deg, translation_error_mm, outlier, ms.
    """
    if make_executor is None:
        return pd.concat([_measure(trial) for trial in trials], ignore_index=True)
    with shutting_down(make_executor()) as executor:
        return pd.concat(list(executor.map(_measure, trials)), ignore_index=True)


def _measure(trial: Trial) -> pd.DataFrame:
    rows = pd.DataFrame([_row(pair) for pair in register_profiles(trial)])
    rows["outlier"] = outliers(rows[list(MOTION)].to_numpy(dtype=np.float64))
    return rows


def register_profiles(trial: Trial) -> Iterator[ProfilePair]:
    """Scan the views of a trial and register their profiles, one after the other."""
    spec = trial.spec
    if not isinstance(spec, TrialSpec):
        raise TypeError(f"{type(spec).__name__} names no views")
    target, source = scan_view(spec, spec.target), scan_view(spec, spec.source)
    target_path, source_path = spec.paths
    exact = target_path.T_world_profile.inv() * source_path.T_world_profile
    elevation_mm = target_path.T_world_profile.translation[:, 2]
    method = find_method(spec.method.name)
    for k in range(spec.profiles):
        profiles = one_profile(target, k), one_profile(source, k)
        start = time.perf_counter()
        result = method.function(*profiles, spec.method.params)
        ms = 1e3 * (time.perf_counter() - start)
        result = dataclasses.replace(result, stage_ms=result.stage_ms | {"registration": ms})
        views = spec.target.name, spec.source.name
        yield ProfilePair(trial, *views, k, float(elevation_mm[k]), *profiles, exact[k], result)


def one_profile(scan: Scan, profile: int) -> Scan:
    """One profile of a scan as a scan of its own, in the sensor frame of that profile."""
    points_mm = scan.in_profiles_mm[profile : profile + 1]
    intensity = None if scan.intensity is None else scan.intensity[profile : profile + 1]
    return Scan.from_points(points_mm, scan.step_mm, intensity, scan.apex_mm, scan.travel)


def _row(pair: ProfilePair) -> dict[str, Any]:
    pose = pair.result.T_target_source
    nothing = dict.fromkeys((*MOTION, "rotation_error_deg", "translation_error_mm"), np.nan)
    row: dict[str, Any] = {
        "pair": pair.trial.pair,
        "method": pair.trial.label,
        "repeat": pair.trial.spec.repeat,
        "profile": pair.profile,
        "elevation_mm": pair.elevation_mm,
        "status": pair.result.status,
        "reason": pair.result.reason,
        **nothing,
        **{f"exact_{name}": value for name, value in _motion(pair.exact).items()},
        "ms": pair.result.stage_ms["registration"],
    }
    if pose is not None:
        error = pose_error(pair.exact, pose)
        row |= _motion(pose)
        row["rotation_error_deg"] = float(np.rad2deg(error.rotation_rad))
        row["translation_error_mm"] = error.translation_mm
    return row


def _motion(pose: RigidTransform) -> dict[str, float]:
    return dict(zip(MOTION, six_parameters(pose)[[0, 4, 5]].tolist(), strict=True))


def _keep(
    experiment: ProfilesExperiment, trials: Sequence[Trial], rows: pd.DataFrame, folder: Path
) -> None:
    """Write the rows and all that says what they are of; the times apart, which never agree."""
    folder.mkdir(parents=True, exist_ok=True)
    (folder / ROWS).unlink(missing_ok=True)  # the last to be written: with it the rest is whole
    config = dump_yaml(with_defaults(experiment, trials))
    (folder / "config.yaml").write_text(config, encoding="utf-8")
    note_run(folder, _code(experiment))
    rows[TIME_COLUMNS].to_csv(folder / TIMES, index=False, lineterminator="\n")
    text = rows.drop(columns="ms").to_csv(index=False, lineterminator="\n")
    write_whole(folder / ROWS, text.encode())


def _code(experiment: ProfilesExperiment) -> str:
    """The fingerprint of the code that computes rows, of these modules too."""
    return code_fingerprint((method.name for method in experiment.methods), OWN_CODE)
