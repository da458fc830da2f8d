"""Registers two scans of the user's own from files, and tells how it went."""

from __future__ import annotations

import dataclasses
import json
import shlex
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console

from experiments.cli import EXIT_FAILED, EXIT_OK
from experiments.terminal import make_console
from harness.config.errors import ConfigError
from harness.figures.clouds import write_merged
from harness.provenance import run_facts
from harness.report.own_page import write_own_page
from harness.results import check_folder, results_folder
from harness.scoring import six_parameters
from registration.calibration import CalibrationError, read_calibration
from registration.methods import UnknownMethodError, find_method, register
from registration.peers import MissingPeerError
from registration.result import RegistrationResult
from registration.scan import FloatArray
from sensors.scan_files import ScanFileError, read_scan


def register_files(
    target_file: Path,
    source_file: Path,
    calibration_file: Path | None,
    step_mm: float | None,
    travel: Sequence[float] | None,
    method: str,
    folder: Path | None,
) -> int:
    """Register the source to the target, print the result, write page and merged cloud.

    Returns the exit status: EXIT_FAILED without an estimate. Raises ConfigError, one line, before
    anything is written.
    """
    folder = results_folder(folder, f"{target_file.stem}_{source_file.stem}")
    check_folder(folder)
    try:
        params = _params(method, calibration_file)
        moved = None if travel is None else np.array(travel)
        target, source = (read_scan(file, step_mm, moved) for file in (target_file, source_file))
        result = register(target, source, method, params)
    except (ScanFileError, UnknownMethodError, MissingPeerError) as error:
        raise ConfigError("--register", (), str(error)) from None
    console = make_console()
    _tell(console, result)
    if not (target.n_valid and source.n_valid):
        return EXIT_FAILED
    pose = result.T_target_source
    made = run_facts("")
    facts = {
        "target": str(target_file),
        "source": str(source_file),
        "method": method,
        "calibration": None if calibration_file is None else str(calibration_file),
        "status": result.status,
        "reason": result.reason,
        "notes": list(result.notes),
        "stage": result.stage,
        "T_target_source": None if pose is None else pose.as_matrix().tolist(),
        "covariance": None if result.covariance is None else result.covariance.tolist(),
        **{key: made[key] for key in ("commit", "python", "libraries")},
    }
    try:
        folder.mkdir(parents=True, exist_ok=True)
        answer = folder / "registration.json"
        answer.write_text(json.dumps(facts, indent=2) + "\n", encoding="utf-8")
        page = write_own_page(
            folder, (target_file, source_file), (target, source), method, result,
            answer.read_text(encoding="utf-8"), shlex.join(["run-experiment", *sys.argv[1:]]),
        )  # fmt: skip
        written = [f"{page}  the pair in 3D, opens in any browser", str(answer)]
        if pose is not None:
            cloud = write_merged(folder / "merged.ply", target, source, pose)
            written.insert(1, f"{cloud}  target blue, source orange, in mm")
    except OSError as error:
        message = f"{folder} cannot be a results folder: {error.strerror}; give another"
        raise ConfigError("--out", (), message) from None
    console.print("\n  ".join(["Written:", *written]), soft_wrap=True)
    return EXIT_OK if result.status == "ok" else EXIT_FAILED


def _params(method: str, calibration_file: Path | None) -> Any:
    """The method's parameters with this calibration, or None; a wrong file is told at once."""
    params_type = find_method(method).params_type
    if calibration_file is None:
        return None
    takes = dataclasses.is_dataclass(params_type) and any(
        field.name == "calibration" for field in dataclasses.fields(params_type)
    )
    if not takes:
        message = f"method {method!r} takes none; gauss_sphere does"
        raise ConfigError("--calibration", (), message)
    try:
        read_calibration(calibration_file)
    except OSError as error:
        message = f"{calibration_file}: {error.strerror}; configs/precision.yaml makes one"
        raise ConfigError("--calibration", (), message) from None
    except CalibrationError as error:
        raise ConfigError("--calibration", (), str(error)) from None
    return params_type(calibration=str(calibration_file))


def _tell(console: Console, result: RegistrationResult) -> None:
    """Status, notes, pose as matrix and six parameters, and how sure the method is of it."""
    reason = f": {result.reason}" if result.reason else ""
    lines = [f"Status: {result.status}{reason}", *(f"Note: {note}." for note in result.notes)]
    pose = result.T_target_source
    if pose is not None:
        six = six_parameters(pose)
        lines += ["T_target_source, p_target = R p_source + T, in mm:"]
        lines += ["  " + " ".join(f"{value:12.6f}" for value in row) for row in pose.as_matrix()]
        lines += [
            f"  rotation X, Y, Z     {_row(six[:3], 4)} deg, R = Rz Ry Rx",
            f"  translation X, Y, Z  {_row(six[3:], 3)} mm",
        ]
        if result.covariance is None:
            lines += ["The method does not say how sure it is."]
        else:
            spread = np.sqrt(np.diagonal(result.covariance))
            lines += [
                "Standard deviations of a small motion in the target's frame:",
                f"  about X, Y, Z        {_row(np.rad2deg(spread[:3]), 4)} deg",
                f"  along X, Y, Z        {_row(spread[3:], 3)} mm",
            ]
    for direction in result.undetermined:
        turn, shift = (_row(part, 3) for part in (direction[:3], direction[3:]))
        lines += [f"Left open by the scans: turn {turn}, shift {shift} (rad and mm alike)"]
    console.print("\n".join(lines), soft_wrap=True)


def _row(values: FloatArray, decimals: int) -> str:
    return " ".join(f"{value:10.{decimals}f}" for value in values)
