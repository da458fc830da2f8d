"""The computer desk of figure 6.11: a monitor, a computer case, a keyboard and some blocks."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from scenes.scene import Scene
from scenes.solids import assemble, box, frustum, prism, turned


@dataclass(frozen=True)
class DeskParams:
    """The desk has nothing to choose."""


@lru_cache(maxsize=1)
def desk(params: DeskParams) -> Scene:
    """Lay the desk out; the world's origin lies on the desk top, the wall stands towards +X.

    The thesis gives a photograph and no measures: the sizes are those of small office equipment,
    laid out so that the views of tables 6.2 to 6.5 cover it. Everything but the desk top, the
    keyboard and the wall is turned by a yaw of its own.
    """
    return assemble(
        "desk",
        [
            box("desk", [0.70, 1.00, 0.03], [-0.15, 0.0, -0.03], material="wood"),
            box("wall", [0.03, 1.00, 0.53], [0.215, 0.0, -0.03], material="white_paper"),
            box("case", [0.26, 0.13, 0.27], [0.03, -0.225, 0.0], turned(-22.0)),
            box("foot", [0.14, 0.16, 0.015], [0.05, 0.045, 0.0], turned(12.0)),
            box("stem", [0.03, 0.06, 0.12], [0.07, 0.049, 0.015], turned(12.0)),
            box(
                "monitor",
                [0.035, 0.24, 0.18],
                [0.03, 0.042, 0.085],
                turned(12.0, 14.0),
                "specular_plastic",
            ),
            prism(
                "left_speaker",
                [(-0.06, 0.0), (0.06, 0.0), (0.06, 0.24), (0.0, 0.24)],
                0.10,
                [0.09, 0.235, 0.0],
                turned(27.0),
                labels=["bottom", "back", "top", "front"],
            ),
            frustum(
                "right_speaker",
                [(-0.055, -0.055), (0.055, -0.055), (0.055, 0.055), (-0.055, 0.055)],
                0.27,
                [0.085, -0.118, 0.0],
                turned(-52.0),
                labels=["right", "back", "left", "front"],
                top_scale=0.35,
            ),
            prism(
                "keyboard",
                [(-0.07, 0.0), (0.07, 0.0), (0.07, 0.036), (-0.07, 0.012)],
                0.36,
                [-0.21, 0.03, 0.0],
                turned(4.0),
                labels=["bottom", "back", "top", "front"],
            ),
            prism(
                "lectern",
                [(-0.07, 0.0), (0.05, 0.0), (0.05, 0.11)],
                0.13,
                [-0.075, -0.085, 0.0],
                turned(24.0),
                "wood",
                labels=["bottom", "back", "slope"],
            ),
            prism(
                "roof",
                [(-0.06, 0.0), (0.06, 0.0), (0.0, 0.10)],
                0.14,
                [-0.05, 0.20, 0.0],
                turned(-52.0),
                "fabric",
                labels=["bottom", "back", "front"],
            ),
            prism(
                "parcel",
                [(-0.07, 0.0), (0.06, 0.0), (0.06, 0.03), (-0.01, 0.09)],
                0.12,
                [0.005, -0.21, 0.27],
                turned(27.0),
                "white_paper",
                labels=["bottom", "back", "top", "front"],
            ),
        ],
    )
