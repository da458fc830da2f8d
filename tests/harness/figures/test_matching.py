from __future__ import annotations

from dataclasses import fields

import numpy as np

from harness.figures.matching import telling_patches
from registration.thesis.patches import Patches
from registration.thesis.translation import Shifts


def patches(area_mm2: list[float]) -> Patches:
    """Patches of which only the area is told."""
    empty = {field.name: np.zeros((len(area_mm2), 3)) for field in fields(Patches)}
    return Patches(**{**empty, "area_mm2": np.array(area_mm2)})


def shifts(pairs: list[tuple[int, int]], chosen: list[bool]) -> Shifts:
    values = 10.0 * np.arange(3 * len(pairs)).reshape(-1, 3)
    weights = np.ones(len(pairs))
    return Shifts(values, weights, np.array(pairs), np.array(chosen), np.zeros((2, 3)))


def test_the_four_patches_are_the_largest_whose_right_pairs_agree() -> None:
    every = [(i, j) for i in range(3) for j in range(3)]
    agreeing = {(0, 0), (1, 1), (2, 2)}
    found = shifts(every, [pair in agreeing for pair in every])
    four = telling_patches(patches([5.0, 1.0, 9.0]), patches([4.0, 9.0, 9.0]), found)
    assert four is not None
    assert (four.target, four.source) == ((0, 2), (0, 2))
    order = [every.index(pair) for pair in ((0, 0), (0, 2), (2, 0), (2, 2))]
    np.testing.assert_array_equal(four.shifts_mm, found.values_mm[order])


def test_no_four_patches_where_the_false_pairs_agree_too_or_are_of_other_orientation() -> None:
    both = patches([1.0, 1.0])
    square = [(0, 0), (0, 1), (1, 0), (1, 1)]
    assert telling_patches(both, both, shifts(square, [True] * 4)) is None
    assert telling_patches(both, both, shifts([(0, 0), (1, 1)], [True, True])) is None
    assert telling_patches(both, both, shifts(square, [True, False, False, False])) is None
