"""Objects for single profiles, as in figures 3.7 and 3.17 of the thesis."""

from __future__ import annotations

from functools import lru_cache

from scenes.scene import Scene
from scenes.solids import assemble, box, frustum, turned


@lru_cache(maxsize=1)
def steps_before_a_glossy_box() -> Scene:
    """Wood before the inclined, reflective face of a box, other things beside it (figure 3.7).

    The thesis shows a photograph; sizes are guesses. Everything is upright, the sensor looks
    along the world's X.
    """
    return assemble(
        "steps_before_a_glossy_box",
        [
            box("wall", [0.03, 1.0, 0.6], [0.20, 0.0, -0.3], material="white_paper"),
            box("flat_box", [0.06, 0.16, 0.5], [0.06, 0.035, -0.25], turned(28.0), "metal"),
            box("wood", [0.04, 0.05, 0.5], [-0.10, 0.110, -0.25], material="wood"),
            box("case", [0.08, 0.09, 0.5], [-0.02, -0.120, -0.25], turned(-14.0), "matt_plastic"),
        ],
    )


@lru_cache(maxsize=2)
def piece_of_foam(covered: bool) -> Scene:
    """A piece of foam with a seat between two arms, bare and grey or covered with white paper.

    The profile of figure 3.17 runs across it.
    """
    material = "white_paper" if covered else "rough_foam"
    left = [(0.0, 0.02), (0.06, 0.03), (0.06, 0.075), (-0.03, 0.075)]
    right = [(x, -y) for x, y in reversed(left)]
    seat = [(0.03, -0.03), (0.06, -0.03), (0.06, 0.03), (0.03, 0.03)]
    upright = [
        frustum(name, outline, 0.5, [0.0, 0.0, -0.25], material=material)
        for name, outline in (("left_arm", left), ("right_arm", right), ("seat", seat))
    ]
    board = box("board", [0.02, 0.6, 0.5], [0.06, 0.0, -0.25], material="wood")
    return assemble("piece_of_foam", [board, *upright])
