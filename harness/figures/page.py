"""What all figures share: style, colours, the two views of a drawing, and how a file is written."""

from __future__ import annotations

import io
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.cm import ScalarMappable
from matplotlib.colorbar import Colorbar
from matplotlib.colors import to_rgb
from matplotlib.figure import Figure
from PIL import Image

from harness.figures.looks import FRONT, GREY, INK, TOP, Projection, limits
from harness.figures.pair_view import PairView
from harness.report.packing import write_whole
from registration.scan import FloatArray, IntArray, Scan

AXES = ("X, motion (mm)", "Y, lateral (mm)", "Z, depth (mm)")
WIDTH_IN = 9.0  # a page's width at this font size
DPI = 120
NOTE_CHARACTERS = 120  # a line of a page's width
HEAD_IN, LEFT_IN, GAP_IN = 0.95, 0.85, 0.2  # title and column titles; labels; between panels
TALLEST_IN = 12.0
MAX_POINTS = 10_000  # a panel; more hide each other and only fill the file

STYLE: Any = {
    "font.family": "DejaVu Sans",
    "font.size": 9.0,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9.0,
    "axes.edgecolor": GREY,
    "axes.linewidth": 0.8,
    "axes.axisbelow": True,
    "axes.grid": True,
    "grid.color": "#E6E6E6",
    "grid.linewidth": 0.6,
    "xtick.labelsize": 8.0,
    "ytick.labelsize": 8.0,
    "legend.fontsize": 8.5,
    "legend.frameon": False,
}


@contextmanager
def page_style() -> Iterator[None]:
    """The style of every figure, whatever the user's matplotlibrc says."""
    with matplotlib.rc_context():
        matplotlib.rcdefaults()
        matplotlib.rcParams.update(STYLE)
        yield


def projections(
    title: str,
    columns: Sequence[str],
    points_mm: Sequence[FloatArray],
    note: str = "",
    bar: bool = False,
) -> tuple[Figure, list[list[Axes]]]:
    """Make a page of front views above top views, all to one scale.

    columns: title of each. points_mm: arrays (n, 3) that every panel has to have room for.
    note: text under the panels. bar: leave room for a colour bar.
    Returns the figure and its axes, [front, top][column].
    """
    low, high = limits(points_mm)
    spans = [high[projection.up] - low[projection.up] for projection in (FRONT, TOP)]
    right_in = 1.05 if bar else 0.2
    lines = textwrap.wrap(note, NOTE_CHARACTERS)
    foot_in = 0.55 + 0.16 * len(lines) + (0.1 if lines else 0.0)
    wide_in = (WIDTH_IN - LEFT_IN - right_in - GAP_IN * (len(columns) - 1)) / len(columns)
    edges_in = HEAD_IN + foot_in + GAP_IN
    mm_per_in = max((high[1] - low[1]) / wide_in, sum(spans) / (TALLEST_IN - edges_in))
    wide_in = (high[1] - low[1]) / mm_per_in
    tall_in = [span / mm_per_in for span in spans]
    figure = new_figure(title, edges_in + sum(tall_in), note)
    axes: list[list[Axes]] = []
    for projection, tall, bottom in zip(
        (FRONT, TOP), tall_in, (foot_in + tall_in[1] + GAP_IN, foot_in), strict=True
    ):
        axes.append([])
        for column, name in enumerate(columns):
            left = LEFT_IN + column * (wide_in + GAP_IN)
            ax = add_axes(figure, left, bottom, wide_in, tall)
            to_scale(ax, projection, low, high)
            if projection is FRONT:
                ax.set_title(name)
                ax.set_xlabel("")
                ax.tick_params(labelbottom=False)
            if column > 0:
                ax.set_ylabel("")
                ax.tick_params(labelleft=False)
            else:
                ax.set_ylabel(f"{projection.name}\n{AXES[projection.up]}")
            axes[-1].append(ax)
    return figure, axes


def add_bar(figure: Figure, axes: list[list[Axes]], shown: ScalarMappable, label: str) -> Colorbar:
    """A colour bar beside the lower right panel of a page that was made with room for it."""
    corner = axes[1][-1].get_position()
    width_in, height_in = figure.get_size_inches()
    left = corner.x1 + 0.12 / width_in
    height = min(corner.height, 3.0 / height_in)
    place = figure.add_axes((left, corner.y1 - height, 0.12 / width_in, height))
    return figure.colorbar(shown, cax=place, label=label)


def add_axes(
    figure: Figure, left_in: float, bottom_in: float, wide_in: float, tall_in: float, **kind: Any
) -> Axes:
    """Axes at a place of the page given in inches; fixed places draw in half the time."""
    width, height = figure.get_size_inches()
    place = (left_in / width, bottom_in / height, wide_in / width, tall_in / height)
    return figure.add_axes(place, **kind)


def to_scale(ax: Axes, projection: Projection, low: FloatArray, high: FloatArray) -> None:
    """Set limits, labels and equal aspect of one panel."""
    ax.set_xlim(float(low[projection.right]), float(high[projection.right]))
    ax.set_ylim(float(low[projection.up]), float(high[projection.up]))
    ax.set_aspect("equal")
    ax.set_xlabel(AXES[projection.right])
    ax.set_ylabel(AXES[projection.up])


def new_figure(title: str, height_in: float, note: str = "") -> Figure:
    """An empty page with a title, and a note of any length at its foot."""
    figure = Figure(figsize=(WIDTH_IN, height_in), dpi=DPI, facecolor="white")
    edge = 0.15 / WIDTH_IN
    figure.text(edge, 1.0 - 0.1 / height_in, title, va="top", size=11.0, weight="bold")
    lines = "\n".join(textwrap.wrap(note, NOTE_CHARACTERS))
    figure.text(edge, 0.1 / height_in, lines, va="bottom", size=8.5, color=INK)
    return figure


def roles(pair: PairView) -> tuple[tuple[str, str, Scan], tuple[str, str, Scan]]:
    """Role, name and scan of the two views, the target first."""
    return ("Target", pair.target_view, pair.target), ("Source", pair.source_view, pair.source)


def scatter_mixed(
    ax: Axes, clouds_mm: Sequence[FloatArray], colours: Sequence[str], projection: Projection
) -> None:
    """Clouds (n, 3), each in its colour, their points mixed so that none lies on top of another."""
    points = np.concatenate(clouds_mm)
    paint = np.repeat([to_rgb(c) for c in colours], [len(cloud) for cloud in clouds_mm], axis=0)
    mixed = mixed_order(len(points))
    ax.scatter(
        points[mixed, projection.right], points[mixed, projection.up], c=paint[mixed], s=1.3, lw=0
    )


def name_clouds(figure: Figure, ax: Axes, colours: Mapping[str, str]) -> None:
    """A legend of clouds by the names and colours given, at the top right of the page.

    On the second line of the title, which is short, whatever the names in the first are.
    """
    for name, colour in colours.items():
        ax.scatter([], [], s=24, lw=0, c=colour, label=name)
    figure.legend(
        *ax.get_legend_handles_labels(), loc="upper right", ncols=len(colours), borderaxespad=0.2,
        bbox_to_anchor=(1.0, 1.0 - 0.17 / figure.get_figheight()),
    )  # fmt: skip


def thinned(points_mm: FloatArray) -> FloatArray:
    """At most MAX_POINTS of the points (n, 3), in an order that hides no part behind another."""
    thin: FloatArray = points_mm[mixed_order(len(points_mm))[:MAX_POINTS]]
    return thin


def mixed_order(count: int) -> IntArray:
    """The indices 0 to count - 1, shuffled, the same way each time."""
    return np.random.default_rng(0).permutation(count).astype(np.int64)


def amount(count: int, noun: str) -> str:
    """A number with its noun, thousands apart: "32 365 points", "1 patch"."""
    many = noun + ("es" if noun.endswith("ch") else "s")
    return f"{thousands_apart(count)} {noun if count == 1 else many}"


def thousands_apart(count: int) -> str:
    """A whole number with its thousands apart."""
    return f"{count:,}".replace(",", "\N{NO-BREAK SPACE}")


def save(figure: Figure, path: Path) -> Path:
    """Write a PNG of few colours, the same bytes for the same figure; replaces an older file."""
    pixels = io.BytesIO()
    figure.savefig(pixels, format="rgba", dpi=DPI)
    image = Image.frombytes("RGBA", FigureCanvasAgg(figure).get_width_height(), pixels.getvalue())
    # A page of dots and lines looks no different in 255 colours and takes a third of the space.
    image = image.convert("RGB").quantize(
        255, method=Image.Quantize.FASTOCTREE, dither=Image.Dither.NONE
    )
    data = io.BytesIO()
    image.save(data, format="PNG", compress_level=7)
    write_whole(path, data.getvalue())
    return path
