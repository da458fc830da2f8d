"""The experiment `precision`: chapter 3 on the simulated sensor, and its calibration by a user."""

from __future__ import annotations

import dataclasses
import json
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, get_args

import numpy as np
import pandas as pd
from pydantic import Field

from harness.config.choices import checked_params
from harness.config.errors import ConfigError, nearest
from harness.config.reading import dump_yaml, overridden_mapping, validated
from harness.config.schema import Angle, Choice, Length, ScanSize
from harness.config.strict import Strict
from harness.provenance import code_fingerprint, note_run
from harness.results import check_folder, results_folder
from harness.tables.card import as_table, geometry_table
from harness.tables.table import Table, write_tables
from registration.calibration import Calibration
from registration.calibration_fit import TargetScan, fit_calibration
from registration.scan import FloatArray, Scan
from sensors import SENSORS
from sensors.calibration import OFFSET_Y_MM, OFFSET_Z_MM
from sensors.card import mean_over_profiles, measure_card
from sensors.jupiter import Jupiter, JupiterParams
from sensors.target_scans import as_told, scan_target

KIND = "precision"
Turn = tuple[Angle, Angle]
FACING: Turn = (0.0, 0.0)
REHEARSED = 3  # scans that a dry run times
RAW_Y, RAW_Z = "Y' (mm)", "Z' (mm)"
Turns = Annotated[tuple[Turn, ...], Field(min_length=1)]
Correction = Literal["none", "local slopes", "known plane"]
RawDepths = Annotated[tuple[Length, ...], Field(min_length=2)]


class PrecisionExperiment(Strict):
    """What configs/precision.yaml may say; Z' as in section 3.2.2, turns about X and Y.

    placement_mm, placement_deg: standard deviations of where the calibration is told a target
        stood, in distance and in either turn: of a bench, assumed.
    """

    experiment: Literal["precision"]
    title: str
    description: str = ""
    sensor: Choice
    scan: ScanSize
    raw_depths_mm: RawDepths
    turns_deg: Turns
    unseen_raw_depths_mm: RawDepths
    unseen_turns_deg: Turns
    placement_mm: Annotated[float, Field(ge=0.0, le=100.0)] = 0.1
    placement_deg: Annotated[float, Field(ge=0.0, le=10.0)] = 0.02
    seed: int = Field(default=0, ge=0)


@dataclass(frozen=True)
class Measurements:
    """What was scanned, by raw depth and turn.

    targets: for the calibration, each with the plane that it is told to stand in. unseen: to judge
    the calibration by, each with the plane it stood in.
    """

    params: JupiterParams
    raw_depths_mm: tuple[float, ...]
    targets: dict[tuple[float, Turn], TargetScan]
    unseen: dict[tuple[float, Turn], TargetScan]

    @property
    def facing(self) -> list[TargetScan]:
        """The targets parallel to X and Y, in the order of the raw depths."""
        return [self.targets[depth, FACING] for depth in self.raw_depths_mm]


def raw(scan: Scan) -> tuple[FloatArray, FloatArray]:
    """Y' and Z' of a scan in mm, (3-2) and (3-3) turned round."""
    return OFFSET_Y_MM - scan.points_mm[..., 1], OFFSET_Z_MM - scan.points_mm[..., 2]


def load_precision(
    path: Path, overrides: Sequence[str] = (), seed: int | None = None
) -> tuple[PrecisionExperiment, JupiterParams]:
    """Read and check a config; raises ConfigError."""
    data = overridden_mapping(path, overrides, seed)
    experiment: PrecisionExperiment = validated(PrecisionExperiment, data, path)
    choice = experiment.sensor
    known = [name for name, entry in SENSORS.items() if entry.card is not None]
    if choice.name not in known:
        message = f"no published numbers of sensor {choice.name!r}; {nearest(choice.name, known)}"
        raise ConfigError(path, ("sensor", "name"), message)
    key = ("sensor", "params")
    params = checked_params(SENSORS[choice.name].params_type, choice.params, path, key)
    if FACING not in experiment.turns_deg:
        raise ConfigError(path, ("turns_deg",), "should hold [0, 0], the target parallel to X, Y")
    if len(set(experiment.raw_depths_mm)) < 2:
        raise ConfigError(path, ("raw_depths_mm",), "should hold two different distances at least")
    return experiment, params


def measure(experiment: PrecisionExperiment, params: JupiterParams) -> Measurements:
    """Scan the flat target at all distances and turns."""
    sensor = Jupiter(params)
    scans: list[dict[tuple[float, Turn], TargetScan]] = []
    for which, (depths_mm, turns) in enumerate(
        (
            (experiment.raw_depths_mm, experiment.turns_deg),
            (experiment.unseen_raw_depths_mm, experiment.unseen_turns_deg),
        )
    ):
        scans.append({})
        for i, raw_mm in enumerate(depths_mm):
            for k, turn in enumerate(turns):
                rng = np.random.default_rng([experiment.seed, which, i, k])
                size = experiment.scan.profiles, experiment.scan.step_mm
                angles = np.radians(turn)
                scans[-1][raw_mm, turn] = scan_target(
                    sensor, OFFSET_Z_MM - raw_mm, angles[0], angles[1], *size, rng
                )
    # Streams of their own: where a target is told to stand changes nothing of its scan.
    rng = np.random.default_rng([experiment.seed, len(scans)])
    told = {
        key: as_told(target, experiment.placement_mm, experiment.placement_deg, rng)
        for key, target in scans[0].items()
    }
    return Measurements(params, experiment.raw_depths_mm, told, scans[1])


def calibrate(
    experiment: PrecisionExperiment, measured: Measurements, measured_by: str = ""
) -> Calibration:
    """The calibration from these measurements, on a bench that knows how well it places targets."""
    targets = list(measured.targets.values())
    return fit_calibration(targets, measured_by, experiment.placement_mm, experiment.placement_deg)


def run_precision(
    path: Path, folder: Path | None, overrides: Sequence[str] = (), seed: int | None = None
) -> tuple[list[Table], Path]:
    """Measure, calibrate, write tables, figures and calibration; returns the tables and the folder.

    Raises ConfigError before anything is written.
    """
    from experiments.precision_figures import draw_precision

    experiment, params = load_precision(path, overrides, seed)
    folder = results_folder(folder, path.stem)
    check_folder(folder)
    measured = measure(experiment, params)
    command = f"run-experiment configs/{path.name}, seed {experiment.seed}"
    try:
        calibration = calibrate(experiment, measured, command)
    except ValueError as error:
        key = ("turns_deg",) if set(experiment.turns_deg) == {FACING} else ()
        raise ConfigError(path, key, str(error)) from None
    tables = [
        as_table(measure_card(params, experiment.seed), experiment.sensor.name),
        geometry_table(),
        forms_table(calibration),
        residual_table(measured, calibration),
    ]
    folder.mkdir(parents=True, exist_ok=True)
    resolved: dict[str, Any] = experiment.model_dump(mode="json")
    resolved["sensor"]["params"] = json.loads(json.dumps(dataclasses.asdict(params)))
    (folder / "config.yaml").write_text(dump_yaml(resolved), encoding="utf-8")
    note_run(folder, code_fingerprint(()))
    calibration.write(folder / "calibration.json")
    write_tables(tables, folder / "tables")
    draw_precision(measured, calibration, experiment.seed, folder / "figures")
    return tables, folder


def rehearse_precision(
    path: Path, folder: Path | None, overrides: Sequence[str] = (), seed: int | None = None
) -> list[str]:
    """What a run would do and how long it would take, in lines; writes nothing.

    Raises ConfigError.
    """
    experiment, params = load_precision(path, overrides, seed)
    targets = len(experiment.raw_depths_mm) * len(experiment.turns_deg)
    unseen = len(experiment.unseen_raw_depths_mm) * len(experiment.unseen_turns_deg)
    depth_mm = OFFSET_Z_MM - experiment.raw_depths_mm[0]
    size = experiment.scan.profiles, experiment.scan.step_mm
    times_s = []
    for _ in range(REHEARSED):
        start_s = time.perf_counter()
        scan_target(Jupiter(params), depth_mm, 0.0, 0.0, *size, np.random.default_rng(0))
        times_s.append(time.perf_counter() - start_s)
    return [
        f"{experiment.title}: {targets} scans of a flat target to calibrate by, {unseen} to judge "
        f"the calibration by, of {size[0]} x {params.pixels} points",
        f"About {min(times_s) * (targets + unseen):.0f} s for the scans; the fit, the card and "
        "the figures come on top, some 10 to 20 s",
        f"Would be written to {results_folder(folder, path.stem)}",
    ]


def forms_table(calibration: Calibration) -> Table:
    """What either form of the bias leaves, on the scans it was fitted to."""
    frame = pd.DataFrame(
        {
            "Bias taken to depend on": ["nothing", "incidence", "lateral position"],
            "Residual, rms (mm)": [
                calibration.rms_mm[name] for name in ("uncorrected", "incidence", "lateral")
            ],
            "Chosen": ["", *("yes" if calibration.form == f else "" for f in FORMS)],
        }
    )
    caption = (
        "Over all points of all targets, noise included. On the target parallel to Y both forms "
        "fit alike; the turned ones decide."
    )
    formats = {"Residual, rms (mm)": ".3f"}
    return Table("bias_forms", "What the bias depends on", caption, frame, formats)


FORMS = ("incidence", "lateral")


def residual_table(measured: Measurements, calibration: Calibration) -> Table:
    """Bias on targets the calibration has not seen, without and with it."""
    rows = []
    for (raw_mm, turn), target in measured.unseen.items():
        errors_mm = [beam_errors_mm(target, calibration, how) for how in get_args(Correction)]
        rows.append([raw_mm, *turn, *(rms(error_mm) for error_mm in errors_mm)])
    numbers = [f"{name} (mm)" for name in ("Without", "With, local slopes", "With, known plane")]
    columns = ["Z' (mm)", "Turn about X (°)", "Turn about Y (°)", *numbers]
    formats = dict.fromkeys(numbers, ".2f") | dict.fromkeys(columns[:3], ".0f")
    caption = (
        "Root mean square, over the beams, of the mean error of each beam's depth: the bias, and "
        "what is left of the noise after the mean over the profiles."
    )
    title = "Bias on distances and turns the calibration has not seen"
    frame = pd.DataFrame(rows, columns=columns)
    return Table("residual_bias", title, caption, frame, formats, in_full=True)


def rms(values: FloatArray) -> float:
    """Root mean square of what is not NaN."""
    return float(np.sqrt(np.nanmean(values**2)))


def beam_errors_mm(
    target: TargetScan, calibration: Calibration, correction: Correction = "none"
) -> FloatArray:
    """(pixels,) mean error of each beam's depth over the profiles.

    correction: of the bias, by the calibration: none, with the inclination from the points around
        each one, or with that of the target.
    """
    scan, normal = target.scan, target.normal
    points_mm = scan.points_mm
    if correction == "known plane":
        slope = calibration.slopes(scan)
        cosine = np.abs(normal[1] * slope + normal[2]) / np.sqrt(1.0 + slope**2)
        bias_mm = calibration.bias_mm(points_mm[..., 2], slope, cosine)
        points_mm = points_mm - bias_mm[..., None] * np.stack([0 * slope, slope, 0 * slope + 1], -1)
    elif correction == "local slopes":
        points_mm = calibration.correct(scan).points_mm
    beams = points_mm - calibration.apex_mm
    beams[..., 0] = 0.0
    beams /= beams[..., 2:]
    # Off the plane along its normal; along the beam that is as much longer as it is inclined.
    return mean_over_profiles((points_mm @ normal - target.offset_mm) / (beams @ normal))
