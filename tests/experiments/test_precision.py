"""The precision experiment: small by the command, and the shipped calibration by itself."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from experiments.cli import main
from experiments.precision import calibrate, load_precision, measure
from registration.calibration import read_calibration
from sensors.jupiter import JupiterParams
from sensors.noise import bulge_mm

ROOT = Path(__file__).parents[2]
CONFIG = ROOT / "configs" / "precision.yaml"
SHIPPED = ROOT / "configs" / "calibration" / "jupiter.json"
FIGURES = {f"figure_3_{n:02d}.png" for n in (8, *range(10, 18))} | {"bias.png"}


def test_the_command_writes_tables_figures_and_a_calibration(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    small = ["--set", "scan.profiles=12", "--set", "unseen_turns_deg=[[0, 0]]"]
    assert main([str(CONFIG), "--out", str(out), *small]) == 0
    shown = capsys.readouterr().out
    assert "Card of the sensor jupiter" in shown
    assert "calibration.json" in shown
    assert {path.name for path in (out / "figures").iterdir()} == FIGURES
    card = pd.read_csv(out / "tables" / "sensor_card.csv")
    assert card["Difference (%)"].abs().max() < 10.0
    fits = pd.read_csv(out / "tables" / "geometry_fits.csv")
    assert fits["Keeping the field (%)"].abs().max() < 10.0
    assert fits["Keeping the spacings (%)"].abs().max() < 10.0
    forms = pd.read_csv(out / "tables" / "bias_forms.csv").set_index("Bias taken to depend on")
    assert forms.loc["incidence", "Chosen"] == "yes"
    residual = pd.read_csv(out / "tables" / "residual_bias.csv")
    for column in ("With, local slopes (mm)", "With, known plane (mm)"):
        assert (residual[column] < 0.2 * residual["Without (mm)"]).all()
    assert (out / "config.yaml").exists()
    assert (out / "run.json").exists()
    assert read_calibration(out / "calibration.json").form == "incidence"


def test_a_dry_run_says_what_would_be_measured(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main([str(CONFIG), "--dry-run", "--out", str(out), "--set", "scan.profiles=4"]) == 0
    shown = capsys.readouterr().out
    assert "60 scans of a flat target to calibrate by, 20 to judge" in shown
    assert not out.exists()


def test_the_fit_is_told_places_that_are_off_by_what_the_config_says() -> None:
    off = ["scan.profiles=4", "placement_mm=2", "placement_deg=0.5"]
    exact = ["scan.profiles=4", "placement_mm=0", "placement_deg=0"]
    told, true = (measure(*load_precision(CONFIG, o)) for o in (off, exact))
    turns_deg, shifts_mm = [], []
    for key, target in told.targets.items():
        stood = true.targets[key]
        np.testing.assert_array_equal(target.scan.points_mm, stood.scan.points_mm)
        turn = np.arccos(np.clip(target.normal @ stood.normal, -1.0, 1.0))
        turns_deg.append(np.rad2deg(turn))
        # Along its normal, where the sensor's Z meets it.
        middle_mm = np.array([0.0, 0.0, stood.offset_mm / stood.normal[2]])
        shifts_mm.append(target.offset_mm - target.normal @ middle_mm)
    n = len(shifts_mm)
    assert n == 60
    assert np.sqrt(np.mean(np.square(shifts_mm))) == pytest.approx(2.0, rel=0.3)
    assert np.sqrt(np.mean(np.square(turns_deg))) == pytest.approx(0.5 * np.sqrt(2.0), rel=0.3)
    for key, target in told.unseen.items():
        assert target.offset_mm == true.unseen[key].offset_mm


def test_the_shipped_calibration_is_what_the_command_measures() -> None:
    experiment, params = load_precision(CONFIG)
    measured = measure(experiment, params)
    again = calibrate(experiment, measured)
    shipped = read_calibration(SHIPPED)
    assert shipped.form == again.form
    assert "run-experiment configs/precision.yaml" in shipped.measured_by
    for table in ("bias", "sigma"):
        one, two = getattr(shipped, table), getattr(again, table)
        assert one.depth_mm == pytest.approx(two.depth_mm, abs=1e-2)
        assert one.value_mm == pytest.approx(two.value_mm, abs=5e-3)


def test_the_shipped_calibration_knows_the_bias_it_was_never_told() -> None:
    experiment, params = load_precision(CONFIG)
    exactly = experiment.model_copy(update={"placement_mm": 0.0, "placement_deg": 0.0})
    placed = calibrate(exactly, measure(exactly, params))
    # A bench that places its targets to 0.1 mm costs little: where they stood off is found as well.
    for calibration, largest_mm, rms_mm in (
        (placed, 0.25, 0.03),
        (read_calibration(SHIPPED), 0.3, 0.06),
    ):
        depth_mm = np.linspace(310.0, 1170.0, 20)[:, None]
        tangent = np.linspace(0.0, 1.7, 80)
        fitted = calibration.bias_mm(depth_mm, 0.0, 1.0 / np.sqrt(1.0 + tangent**2))
        true = bulge_mm(depth_mm, tangent, JupiterParams().edge_slope, params.noise)
        assert np.abs(fitted - true).max() < largest_mm
        assert np.sqrt(np.mean((fitted - true) ** 2)) < rms_mm
        assert np.abs(true).max() > 8.0


def test_a_bias_by_place_is_told_from_one_by_incidence() -> None:
    overrides = ["sensor.params.noise={bulge: lateral}", "scan.profiles=10"]
    overrides.append("turns_deg=[[0, 0], [20, 0]]")
    experiment, params = load_precision(CONFIG, overrides)
    calibration = calibrate(experiment, measure(experiment, params))
    assert calibration.form == "lateral"
    depth_mm, slope = np.linspace(320.0, 1150.0, 9)[:, None], np.linspace(-0.22, 0.22, 45)
    true = bulge_mm(depth_mm, slope, params.edge_slope, params.noise)
    assert np.abs(calibration.bias_mm(depth_mm, slope, 0.5) - true).max() < 0.5


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["--set", "sensor.name=jupyter"], "did you mean 'jupiter'?"),
        (["--set", "sensor.params.noise.buldge=none"], "sensor.params.noise.buldge: unknown key"),
        (["--set", "turns_deg=[[0, 0]]"], "turns_deg: no target is tilted"),
        (["--set", "turns_deg=[[20, 0]]"], "turns_deg: should hold [0, 0]"),
        (["--set", "raw_depths_mm=[200]"], "raw_depths_mm: needs at least 2 entries"),
        (["--set", "raw_depths_mm=[300, 300]"], "raw_depths_mm: "),
        (["--report-only"], "--report-only: "),
        (["--trial", "ab"], "--trial: "),
    ],
)
def test_a_wrong_request_gets_one_line(
    arguments: list[str], told: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    assert main([str(CONFIG), "--out", str(out), "--set", "scan.profiles=4", *arguments]) == 2
    lines = capsys.readouterr().err.splitlines()
    assert len(lines) == 1
    assert told in lines[0]
    assert not out.exists()
