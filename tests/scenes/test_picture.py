from pathlib import Path

import numpy as np
from matplotlib.image import imread

from scenes.flat_target import FlatTargetParams, flat_target
from scenes.picture import SKY, save_picture

BOARD = flat_target(FlatTargetParams(width_mm=600.0, height_mm=200.0))


def _picture(path: Path, **options) -> np.ndarray:
    save_picture(BOARD, path, yaw_deg=0.0, pitch_deg=0.0, size_px=(200, 120), **options)
    return imread(path)[..., :3]


def test_a_board_seen_straight_on_is_a_rectangle_in_the_sky(tmp_path: Path) -> None:
    image = _picture(tmp_path / "board.png")
    assert image.shape == (120, 200, 3)
    board = np.abs(image - SKY).max(axis=2) > 0.02
    rows, columns = np.flatnonzero(board.any(axis=1)), np.flatnonzero(board.any(axis=0))
    # 600 mm by 200 mm fill 94 % of the width, in the middle, at the same scale both ways; the ink
    # of the border may reach one pixel further.
    assert abs((np.ptp(columns) + 1) - 0.94 * 200) <= 1.0
    assert abs((np.ptp(rows) + 1) - (np.ptp(columns) + 1) / 3.0) <= 1.0
    assert abs(rows.mean() - 59.5) <= 0.5
    assert abs(columns.mean() - 99.5) <= 0.5
    assert board[np.ix_(rows, columns)].all()


def test_what_hides_a_view_makes_it_faint(tmp_path: Path) -> None:
    plain = _picture(tmp_path / "plain.png")
    paint = []
    for x_mm in (-10.0, 200.0):  # in front of the board and behind it
        line_mm = [[x_mm, -250.0, 40.0], [x_mm, 250.0, 40.0]]
        border_mm = [[x_mm, -250.0, -40.0], [x_mm, 250.0, -40.0]]
        image = _picture(tmp_path / "view.png", views={"v": [line_mm, border_mm]})
        drawn = np.abs(image - plain).max(axis=2)[62:]  # below the arrow and its name
        paint.append(drawn.max())
    assert paint[0] > 2.0 * paint[1] > 0.0
