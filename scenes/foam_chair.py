"""The piece of foam of figure 3.3 that looks like a little chair."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

from scenes.scene import Scene
from scenes.solids import Solid, assemble, box, frustum, prism, turned


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
    # Corners of the left half, inner front first; the back is bent in the middle, so that its two
    # wings face inwards, and all of it leans backwards.
    wing = [(0.060, 0.0), (0.100, 0.0), (0.075, 0.090), (0.028, 0.090)]
    arm = [(-0.065, 0.065), (0.080, 0.060), (0.080, 0.113), (-0.100, 0.113)]
    halves = [
        half
        for side, sign in (("left", 1), ("right", -1))
        for half in (
            _half(f"{side}_wing", wing, sign, 0.24, (0.055, 0.0), material),
            _half(f"{side}_arm", arm, sign, 0.145, (0.030, 0.012), material),
        )
    ]
    table = box("table", [0.40, 0.44, 0.03], [0.05, 0.0, -0.03], material="wood")
    return assemble("foam_chair", [table, seat, *halves])


def _half(
    name: str,
    outline_m: list[tuple[float, float]],
    sign: int,
    height_m: float,
    lean_m: tuple[float, float],
    material: str,
) -> Solid:
    """A frustum on the left (sign 1), or its mirror image on the right (-1).

    The outline's edges are the inner, back, outer and front face; lean_m shifts its top backwards
    and outwards.
    """
    corners_m = [(x_m, sign * y_m) for x_m, y_m in outline_m]
    labels = ["inner", "back", "outer", "front"]
    if sign < 0:  # a mirror image runs the other way round
        corners_m = [corners_m[0], *reversed(corners_m[1:])]
        labels.reverse()
    shift_m = (lean_m[0], sign * lean_m[1])
    origin_m = (0.0, 0.0, 0.0)
    return frustum(
        name, corners_m, height_m, origin_m, turned(), material, labels, top_shift_m=shift_m
    )
