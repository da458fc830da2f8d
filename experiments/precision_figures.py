"""The figures of chapter 3 (3.8, 3.10 to 3.17) of the simulated sensor and of its calibration."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
from matplotlib.figure import Figure

from experiments import precision_spacing as spacing
from experiments.precision import (
    FACING,
    RAW_Y,
    RAW_Z,
    Correction,
    Measurements,
    beam_errors_mm,
    raw,
)
from experiments.precision_spacing import WIDE_IN
from harness.figures.looks import MARK, SOURCE, TARGET
from harness.figures.page import LEFT_IN, add_axes, new_figure, page_style, save
from registration.calibration import Calibration
from registration.scan import Scan
from scenes.profile_samples import piece_of_foam, steps_before_a_glossy_box
from scenes.scene import Scene
from sensors import threedx
from sensors.calibration import OFFSET_Z_MM
from sensors.card import mean_depths_mm
from sensors.jupiter import Jupiter
from sensors.paths import aimed_view, straight_line


def draw_precision(
    measured: Measurements, calibration: Calibration, seed: int, folder: Path
) -> list[Path]:
    """Draw every figure; returns the files, PNG."""
    folder.mkdir(parents=True, exist_ok=True)
    figures: dict[str, Callable[[], Figure]] = {
        "figure_3_08": lambda: draw_one_profile(measured, seed),
        "figure_3_10": lambda: draw_raw_profiles(measured),
        "figure_3_11": lambda: spacing.draw_mean_spacing(measured),
        "figure_3_12": lambda: spacing.draw_fan(measured),
        "figure_3_13": lambda: spacing.draw_spacing(measured, 200.0, "3.13"),
        "figure_3_14": lambda: spacing.draw_spacing(measured, 700.0, "3.14"),
        "figure_3_15": lambda: spacing.draw_spacing_map(measured),
        "figure_3_16": lambda: spacing.draw_step_map(measured, seed),
        "figure_3_17": lambda: draw_foam(measured, seed),
        "bias": lambda: draw_bias(measured, calibration),
    }
    files = []
    for name, draw in figures.items():
        with page_style():
            files.append(save(draw(), folder / f"{name}.png"))
    return files


def profile_of(measured: Measurements, scene: Scene, distance_mm: float, seed: int) -> Scan:
    """A single profile across the middle of a scene."""
    view = aimed_view([0.0, 0.0, 0.0], distance_mm, 0.0, 0.0, 0.0, 1, 5.0)
    path = straight_line(view, 1, 5.0)
    return Jupiter(measured.params).scan(scene, path, np.random.default_rng([seed, 38]))


def draw_one_profile(measured: Measurements, seed: int) -> Figure:
    """Figure 3.8: one profile, raw and in the sensor's frame; overlapping points marked."""
    scan = profile_of(measured, steps_before_a_glossy_box(), 750.0, seed)
    raw_file = threedx.from_scan(scan)
    kept = raw_file.z_tenth_mm[0] != threedx.NO_MEASUREMENT
    y, z = raw_file.y_tenth_mm[0][kept].astype(float), raw_file.z_tenth_mm[0][kept].astype(float)
    # A later beam that lies further back along Y' than an earlier one overlaps it.
    overlapping = (np.maximum.accumulate(-y) > -y + 1.0) | (
        np.minimum.accumulate(-y[::-1])[::-1] < -y - 1.0
    )
    note = (
        f"Wood before the inclined, reflective face of a box; {int(kept.sum())} of {len(kept)} "
        f"beams measured. Beside the large depth step {int(overlapping.sum())} points of both "
        "surfaces overlap along Y'."
    )
    figure = new_figure("Figure 3.8 on the simulated sensor: one profile", 7.6, note)
    panels = [add_axes(figure, LEFT_IN, bottom, WIDE_IN, 2.6) for bottom in (4.25, 0.95)]
    points = scan.points_mm[0][kept]
    for ax, right, up in ((panels[0], y, z), (panels[1], points[:, 1], points[:, 2])):
        ax.plot(right, up, ".", ms=3.5, color=TARGET, label="measured")
        ax.plot(
            right[overlapping], up[overlapping], "o", ms=5, mfc="none", color=MARK,
            label="overlapping along Y'",
        )  # fmt: skip
    panels[0].set(xlabel="Y' (0.1 mm)", ylabel="Z' (0.1 mm)", title="(a) raw, as in the .3dx file")
    panels[1].set(xlabel="Y (mm)", ylabel="Z (mm)", title="(b) in the frame of the sensor")
    panels[1].invert_yaxis()
    panels[1].invert_xaxis()
    panels[0].legend(loc="best")
    return figure


def draw_raw_profiles(measured: Measurements) -> Figure:
    """Figure 3.10: the flat target at ten distances, one raw profile each."""
    rows = -(-len(measured.raw_depths_mm) // 2)
    note = (
        "Every panel spans 26 mm of depth. Dots: one profile. Line: mean over the profiles. A "
        "larger Z' is nearer to the sensor."
    )
    figure = new_figure(
        "Figure 3.10 on the simulated sensor: raw profiles of a flat target",
        1.5 * rows + 1.15,
        note,
    )
    wide_in = 0.5 * (WIDE_IN - 0.7)
    for index, (raw_mm, target) in enumerate(
        zip(measured.raw_depths_mm, measured.facing, strict=True)
    ):
        row, column = divmod(index, 2)
        bottom = 0.9 + 1.5 * (rows - 1 - row)
        ax = add_axes(figure, LEFT_IN + column * (wide_in + 0.7), bottom, wide_in, 1.0)
        y, z = raw(target.scan)
        ax.plot(y[0], z[0], ".", ms=2, color=TARGET)
        mean = OFFSET_Z_MM - mean_depths_mm(target.scan)
        ax.plot(np.nanmean(y, axis=0), mean, color=SOURCE, lw=1.4)
        ax.set_ylim(raw_mm - 9.0, raw_mm + 17.0)
        ax.set_xlim(-350.0, 280.0)
        ax.set_title(f"({chr(ord('a') + index)}) Z' = {raw_mm:.0f} mm", pad=3)
        if column == 0:
            ax.set_ylabel(RAW_Z)
        if row == rows - 1:
            ax.set_xlabel(RAW_Y)
    return figure


def draw_foam(measured: Measurements, seed: int) -> Figure:
    """Figure 3.17: the same piece of foam, bare and covered with white paper."""
    figure = new_figure("Figure 3.17 on the simulated sensor: profiles of two pieces of foam", 7.2)
    panels = [add_axes(figure, LEFT_IN, bottom, WIDE_IN, 2.45) for bottom in (3.95, 0.65)]
    for ax, covered, letter, name in zip(
        panels, (False, True), "ab", ("rough grey foam", "covered with white paper"), strict=True
    ):
        scan = profile_of(measured, piece_of_foam(covered), 700.0, seed)
        y, z = (values[0] for values in raw(scan))
        ax.plot(y, z, ".", ms=3.5, color=TARGET)
        lost = int((~scan.valid).sum())
        ax.set(xlim=(-200, 120), ylim=(620, 740), xlabel=RAW_Y, ylabel=RAW_Z)
        ax.set_title(f"({letter}) {name}: {lost} of {scan.valid.size} points lost")
    return figure


CORRECTIONS: tuple[Correction, ...] = ("none", "local slopes")


def draw_bias(measured: Measurements, calibration: Calibration) -> Figure:
    """How the calibration was found: bias of targets by beam, fitted, and what is left."""
    turned = [turn for _, turn in measured.targets if turn[0] != 0.0][:1]
    depends = "the incidence" if calibration.form == "incidence" else "the place in the field"
    note = (
        "Dots: mean error of each beam's depth over the profiles, negative towards the sensor. "
        "Lines: the fitted bias, which was found to go with "
        f"{depends}: on the turned target its peak "
        + ("moves to the beams that meet it head-on." if "inc" in depends else "stays.")
        + " Right: distances that the fit has not seen."
    )
    figure = new_figure("Bias of the depth, and the calibration", 7.9, note)
    wide_in = 0.5 * (WIDE_IN - 0.75)
    left, right = LEFT_IN, LEFT_IN + wide_in + 0.75
    places = [(left, 4.6), (left, 1.15), (right, 4.6), (right, 1.15)]
    axes = [add_axes(figure, x, y, wide_in, 2.55) for x, y in places]
    for ax, turn in zip(axes[:2], [FACING, *turned], strict=False):
        for raw_mm, shade in zip(measured.raw_depths_mm[::3], _shades(), strict=False):
            target = measured.targets[raw_mm, turn]
            slope = calibration.slopes(target.scan)
            ahead = target.normal[1] * slope + target.normal[2]
            fitted = calibration.bias_mm(
                target.scan.points_mm[..., 2], slope, np.abs(ahead) / np.sqrt(1.0 + slope**2)
            )
            across = np.nanmean(slope, axis=0)
            ax.plot(across, beam_errors_mm(target, calibration), ".", ms=2, color=shade)
            ax.plot(across, np.nanmean(fitted, axis=0), color=shade, label=f"Z' = {raw_mm:.0f} mm")
        ax.set_title(f"Target turned by {turn[0]:.0f}° about X" if turn[0] else "Target facing")
    for ax, corrected in zip(axes[2:], CORRECTIONS, strict=True):
        unseen = [(raw_mm, t) for (raw_mm, turn), t in measured.unseen.items() if turn == FACING]
        for (raw_mm, target), shade in zip(unseen, _shades(), strict=False):
            across = np.nanmean(calibration.slopes(target.scan), axis=0)
            errors_mm = beam_errors_mm(target, calibration, corrected)
            ax.plot(across, errors_mm, ".", ms=2.5, color=shade, label=f"Z' = {raw_mm:.0f} mm")
        ax.set_title("Unseen distances, " + ("as measured" if corrected == "none" else "corrected"))
    for ax in axes:
        ax.set(xlabel="slope of the beam, Y over depth from the apex", ylim=(-11, 3))
        ax.set_ylabel("error of the depth (mm)")
        ax.legend(loc="lower left", fontsize=7, markerscale=2)
    return figure


def _shades() -> list[str]:
    return ["#440154", "#31688E", "#35B779", "#C9A800", "#D55E00"]
