"""Figures 3.11 to 3.16: how far apart points and depths are, over the field."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from experiments.precision import FACING, RAW_Y, RAW_Z, Measurements, raw
from harness.figures.looks import GREY, MARK, TARGET
from harness.figures.page import LEFT_IN, WIDTH_IN, add_axes, new_figure
from registration.scan import FloatArray
from sensors.calibration import OFFSET_Z_MM, SPACINGS, fit_geometry
from sensors.card import depth_steps_mm, spacings_mm
from sensors.jupiter import Jupiter
from sensors.target_scans import scan_target

WIDE_IN = WIDTH_IN - LEFT_IN - 0.3


def draw_mean_spacing(measured: Measurements) -> Figure:
    """Figure 3.11: mean spacing along Y' by distance, the published two beside."""
    note = (
        "The published field of view and the published spacings contradict each other; the sensor "
        "keeps the one, the dashed line is the fit that keeps the other."
    )
    figure, ax = _page("Figure 3.11 on the simulated sensor: mean spacing along Y'", 4.6, note)
    means = [float(np.nanmean(spacings_mm(target.scan))) for target in measured.facing]
    ax.plot(measured.raw_depths_mm, means, "o-", color=TARGET, label="measured")
    depths = np.linspace(150.0, 1150.0, 50)
    other = fit_geometry("spacings").width_mm(OFFSET_Z_MM - depths) / 255.0
    scale = 255.0 / (measured.params.pixels - 1)
    ax.plot(depths, other * scale, "--", color=GREY, label="fit to the published spacings")
    shown = [n for n in SPACINGS if n.quantity == "mean spacing"]
    ax.plot(
        [OFFSET_Z_MM - n.depth_mm for n in shown], [n.value_mm for n in shown], "X", ms=9,
        color=MARK, label="published, 256 points",
    )  # fmt: skip
    ax.set(xlabel=RAW_Z, ylabel="mean spacing along Y' (mm)", xlim=(150, 1150), ylim=(0, None))
    ax.legend()
    return figure


def draw_fan(measured: Measurements) -> Figure:
    """Figure 3.12: the beams, and their spacing on a plane of constant depth."""
    fan, pixels = measured.params.fan, measured.params.pixels
    slopes, depth_mm = fan.slopes(pixels), OFFSET_Z_MM - 200.0
    figure, ax = _page(f"Figure 3.12 on the simulated sensor: 32 of the {pixels} beams", 8.6)
    shown = slopes[np.linspace(0, pixels - 1, 32).round().astype(int)]
    ends_mm = np.array([-fan.apex_depth_mm, depth_mm])
    ax.plot(np.outer(ends_mm + fan.apex_depth_mm, shown), ends_mm, color=GREY, lw=0.6)
    y_mm = slopes * (depth_mm + fan.apex_depth_mm)
    ax.plot(shown * (depth_mm + fan.apex_depth_mm), np.full(32, depth_mm), ".", color=TARGET)
    gaps = {r"$\Delta y_{e1}$": 0, r"$\Delta y_m$": pixels // 2 - 1, r"$\Delta y_{e2}$": -2}
    for name, k in gaps.items():
        text = f"{name}\n{y_mm[k + 1] - y_mm[k]:.2f} mm"
        ax.text(y_mm[k], depth_mm + 20.0, text, ha="center", va="bottom", color=MARK)
    ax.axhline(0.0, color=GREY, lw=0.8, ls=":")
    ax.text(-395, 8, "front of the sensor", color=GREY, size=8)
    ax.set(xlabel="Y (mm)", ylabel="Z (mm)", xlim=(-400, 400), ylim=(-90, depth_mm + 140))
    ax.set_aspect("equal")
    return figure


def draw_spacing(measured: Measurements, raw_mm: float, number: str) -> Figure:
    """Figures 3.13 and 3.14: spacing along one profile, by index."""
    depths = np.array(measured.raw_depths_mm)
    nearest = float(depths[np.abs(depths - raw_mm).argmin()])
    target = measured.targets[nearest, FACING]
    spacing = spacings_mm(target.scan)
    single = np.diff(target.scan.points_mm[0, :, 1])
    title = f"Figure {number} on the simulated sensor: spacing along Y' at Z' = {nearest:.0f} mm"
    note = "Published numbers are of 256 points; the quantised depth makes single profiles jump."
    figure, ax = _page(title, 4.4, note)
    index = np.arange(len(spacing))
    ax.plot(index, single, ".", ms=2, color=GREY, label="one profile")
    ax.plot(index, spacing, color=TARGET, label=f"mean over {len(target.scan.valid)} profiles")
    scale = 255.0 / len(spacing)
    for n in SPACINGS:
        if n.depth_mm != OFFSET_Z_MM - nearest or n.quantity == "mean spacing":
            continue
        centre = n.quantity == "centre spacing"
        spots = [len(spacing) / 2.0] if centre else [0.0, float(len(spacing) - 1)]
        ax.plot(spots, [n.value_mm * scale] * len(spots), "X", ms=9, color=MARK,
                label="published" if centre else None)  # fmt: skip
    top = 1.35 * float(np.nanmax(spacing))
    ax.set(xlabel="index of the gap between points", ylabel="spacing (mm)", ylim=(0, top))
    ax.legend(loc="lower center", ncols=3)
    return figure


def draw_spacing_map(measured: Measurements) -> Figure:
    """Figure 3.15: spacing along Y' over the field."""
    y, z, values = [], [], []
    for raw_mm, target in zip(measured.raw_depths_mm, measured.facing, strict=True):
        raw_y, _ = raw(target.scan)
        gap_y = np.nanmean(0.5 * (raw_y[:, 1:] + raw_y[:, :-1]), axis=0)
        spacing, gap_y = (_windows(c).mean(axis=1) for c in (spacings_mm(target.scan), gap_y))
        y.append(gap_y)
        z.append(np.full(len(spacing), raw_mm))
        values.append(spacing)
    return _map(
        "Figure 3.15 on the simulated sensor: spacing along Y' over the field",
        y, z, values, r"spacing $\Delta y$ (mm), mean of 15 neighbours",
    )  # fmt: skip


def draw_step_map(measured: Measurements, seed: int) -> Figure:
    """Figure 3.16: step of the depth over the field, from the depths that occurred."""
    sensor = Jupiter(measured.params)
    y, z, values = [], [], []
    for k, raw_mm in enumerate(measured.raw_depths_mm):
        rng = np.random.default_rng([seed, 316, k])
        tilt = np.radians(2.0)
        scan = scan_target(sensor, OFFSET_Z_MM - raw_mm, 0.0, tilt, 120, 3.0, rng).scan
        raw_y, _ = raw(scan)
        steps = depth_steps_mm(scan)
        # Neighbouring beams have nearly the same step: their median is steadier.
        y.append(_windows(np.nanmean(raw_y, axis=0)).mean(axis=1))
        values.append(np.nanmedian(_windows(steps), axis=1))
        z.append(np.full(len(values[-1]), raw_mm))
    return _map(
        "Figure 3.16 on the simulated sensor: step of the depth over the field",
        y, z, values, r"step $\Delta z$ (mm), median of 15 neighbours",
    )  # fmt: skip


def _page(title: str, height_in: float, note: str = "") -> tuple[Figure, Axes]:
    """A page with one panel."""
    figure = new_figure(title, height_in, note)
    foot_in = 0.65 if not note else 1.0
    return figure, add_axes(figure, LEFT_IN, foot_in, WIDE_IN, height_in - foot_in - 0.6)


def _windows(values: FloatArray) -> FloatArray:
    """Each 15 successive values in a row."""
    windows: FloatArray = np.lib.stride_tricks.sliding_window_view(values, 15)
    return windows


def _map(
    title: str,
    y: list[FloatArray],
    z: list[FloatArray],
    values: list[FloatArray],
    label: str,
) -> Figure:
    figure = new_figure(title, 5.6)
    ax = add_axes(figure, LEFT_IN, 0.65, WIDE_IN - 1.0, 4.35)
    colour = np.array(values)
    shown = ax.pcolormesh(
        np.array(y), np.array(z), colour, shading="gouraud", cmap="viridis",
        vmin=float(np.nanmin(colour)), vmax=float(np.nanmax(colour)),
    )  # fmt: skip
    lines = ax.contour(np.array(y), np.array(z), colour, levels=8, colors="white", linewidths=0.6)
    ax.clabel(lines, fmt="%.2f", fontsize=7.5)
    ax.set(xlabel=RAW_Y, ylabel=RAW_Z)
    bar = add_axes(figure, LEFT_IN + WIDE_IN - 0.85, 0.65, 0.15, 4.35)
    figure.colorbar(shown, cax=bar, label=label)
    return figure
