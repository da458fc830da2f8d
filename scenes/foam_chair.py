"""The piece of foam of figure 3.3 that looks like a little chair."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from scenes.scene import Scene
from scenes.solids import assemble, box, frustum, prism, turned


@dataclass(frozen=True)
class FoamChairParams:
    """covered: with white paper, as for the experiments of sections 6.2 and 6.3, or bare foam."""

    covered: bool = True


@lru_cache(maxsize=2)
def foam_chair(params: FoamChairParams) -> Scene:
    """Stand the chair on a table; the world's origin is under the middle of its seat, it faces -X.

    The thesis shows a photograph and gives no measures. The sizes are guesses; the slopes of the
    back, the armrests and the seat are what lets two views fix all six parameters.
    """
    material = "white_paper" if params.covered else "rough_foam"
    seat = prism(
        "seat",
        [(-0.07, 0.0), (0.09, 0.0), (0.09, 0.06), (-0.09, 0.085)],
        0.13,
        [0.0, 0.0, 0.0],
        material=material,
        labels=["bottom", "back", "top", "front"],
    )
    # The back is bent in the middle: two wings that face inwards and lean backwards.
    wings = [
        prism(
            f"{side}_wing",
            [(-0.02, 0.0), (0.04, 0.0), (0.075, 0.20), (0.035, 0.20)],
            0.095,
            [0.075, sign * 0.045, 0.04],
            turned(-sign * 20.0),
            material,
            ["bottom", "back", "top", "front"],
        )
        for side, sign in (("left", 1.0), ("right", -1.0))
    ]
    # Mirrored outlines would run the other way round, so the corners of the right arm are reversed.
    outline = [(-0.10, -0.020), (0.08, -0.025), (0.08, 0.028), (-0.065, 0.028)]
    labels = ["inner", "back", "outer", "front"]
    arms = [
        frustum(
            f"{side}_arm",
            corners,
            0.14,
            [0.0, sign * 0.085, 0.0],
            material=material,
            labels=faces,
            top_scale=0.75,
            top_shift_m=(0.02, sign * 0.004),
        )
        for side, sign, corners, faces in (
            ("left", 1.0, outline, labels),
            (
                "right",
                -1.0,
                [(x_m, -y_m) for x_m, y_m in reversed(outline)],
                ["outer", "back", "inner", "front"],
            ),
        )
    ]
    table = box("table", [0.40, 0.50, 0.03], [0.05, 0.0, -0.03], material="wood")
    return assemble("foam_chair", [table, seat, *wings, *arms])
