"""A study without scripts: one still picture, a panel for each key that was swept."""

from __future__ import annotations

import io
from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from harness.studies.figures import colours_of

COLUMNS, WIDE_IN, TALL_IN = 3, 4.2, 2.9
MOST_BARS = 40  # of a panel; more intervals would hide each other


def study_still(study: Mapping[str, Any]) -> bytes:
    """A PNG of the share of right answers along every key; study as studies.study gives it."""
    keys = study["keys"]
    columns = min(COLUMNS, len(keys))
    lines = -(-len(keys) // columns)
    figure = Figure(
        figsize=(columns * WIDE_IN, lines * TALL_IN + 0.5), dpi=80, layout="constrained"
    )
    colours = colours_of(study["methods"])
    for place, key in enumerate(keys):
        ax = figure.add_subplot(lines, columns, place + 1)
        _panel(ax, study, place, colours)
        ax.set_xlabel(key)
        if place % columns == 0:
            ax.set_ylabel(f"share within\n{study['tolerances']['coarse']}")
    handles, names = figure.axes[0].get_legend_handles_labels()
    figure.legend(handles, names, loc="outside upper left", ncols=4, fontsize=9, frameon=False)
    data = io.BytesIO()
    figure.savefig(data, format="png", metadata={"Software": None})
    return data.getvalue()


def _panel(ax: Axes, study: Mapping[str, Any], place: int, colours: Mapping[str, str]) -> None:
    alone = study["design"] == "one_at_a_time"
    points = [p for p in study["points"] if not alone or p["varied"] in ("", study["keys"][place])]
    numbers = all(isinstance(p["values"][place], float) for p in points)
    names = list(dict.fromkeys(str(p["values"][place]) for p in points))
    for shift, (method, colour) in enumerate(colours.items()):
        own = [p for p in points if p["method"] == method]
        x = [p["values"][place] if numbers else names.index(str(p["values"][place])) for p in own]
        order = sorted(range(len(own)), key=lambda i: x[i])
        x, own = [x[i] for i in order], [own[i] for i in order]
        if not alone and len(set(x)) > 1:  # methods beside each other, not on each other
            aside = 0.02 * (max(x) - min(x)) * (shift - 0.5 * (len(colours) - 1))
            x = [v + aside for v in x]
        share = [p["coarse"][0] for p in own]
        # A curve joins values of one key with all else alike; names have no order.
        joined = numbers and (alone or len(study["keys"]) == 1)
        look: dict[str, Any] = {"ls": "-" if joined else "none", "lw": 1.5, "ms": 4.5}
        if len(own) <= MOST_BARS:
            ends = [(p["coarse"][0] - p["coarse"][1], p["coarse"][2] - p["coarse"][0]) for p in own]
            look |= {"yerr": [[max(e[k], 0.0) for e in ends] for k in (0, 1)], "elinewidth": 0.8}
        marker = "osD^vPX*"[shift % 8]
        ax.errorbar(x, share, marker=marker, color=colour, label=method, **look)
    if not numbers:
        size = 8 if len(names) <= 8 else 6
        turn = {"rotation": 30, "ha": "right"} if len(names) <= 8 else {"rotation": 90}
        ax.set_xticks(range(len(names)), [_short(name) for name in names], fontsize=size, **turn)
    ax.margins(x=0.08)
    ax.set_ylim(-0.03, 1.03)
    ax.yaxis.set_major_formatter("{x:.0%}")
    ax.grid(color="#e3e7ea")
    ax.set_axisbelow(True)


def _short(name: str) -> str:
    # A dollar sign would begin a formula.
    text = name if len(name) <= 28 else f"{name[:27]}…"
    return text.replace("$", r"\$")
