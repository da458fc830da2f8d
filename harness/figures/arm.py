"""The arm before the scene as it stands for each view, and the viewing lines from above."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import NamedTuple

import numpy as np
from matplotlib.axes import Axes

from harness.figures.page import add_axes, new_figure, page_style, save
from scenes.picture import VIEW_COLOURS, Camera, camera_on, points_along
from scenes.raster import Polygons, Shot, draw
from scenes.scene import FloatArray, Scene
from sensors.arm import ArmParams, ArmPath
from sensors.arm_picture import faces_before, scene_faces
from sensors.paths import ViewPath
from sensors.sensor import Sensor

SIZE_PX = (510, 380)  # those of the page
WIDE_IN, GAP_IN, HEAD_IN, TITLE_IN, FOOT_IN = 4.25, 0.2, 0.3, 0.25, 0.45
TALL_IN = WIDE_IN * SIZE_PX[1] / SIZE_PX[0]
FROM_SIDE, FROM_ABOVE = (-30.0, 30.0), (0.0, 89.9)  # yaw and pitch of the camera, degrees
SAMPLES = 60  # of each part of a line, to tell what hides it


class Panel(NamedTuple):
    """One picture: its title, what it shows, where from, and the views whose lines are drawn."""

    title: str
    faces: Polygons
    camera: Camera
    views: list[str]


def draw_arm(
    scene: Scene,
    sensor: Sensor,
    params: ArmParams,
    paths: Mapping[str, ViewPath],
    title: str,
    file: Path,
) -> Path:
    """Draw a panel for each view that the arm drives, and one from above; returns the file.

    paths: the line of each view by its name; those driven without the arm are lines only.
    """
    outlines = {
        name: [line / 1000.0 for line in sensor.outline(path)] for name, path in paths.items()
    }
    faces = {
        name: faces_before(scene, params, path, path.profiles // 2)
        for name, path in paths.items()
        if isinstance(path, ArmPath)
    }
    lines_m = [line for lines in outlines.values() for line in lines]
    before = np.concatenate([*scene_faces(scene).corners_m, *lines_m])
    tracks_mm = [path.track_mm for path in paths.values() if isinstance(path, ArmPath)]
    corners_mm = [[x, y, z] for x in (-150, 150) for y in tracks_mm for z in (0, 850)]
    stands_m = params.T_world_base.apply(corners_mm) / 1000.0
    side = camera_on(np.concatenate([before, stands_m]), *FROM_SIDE, SIZE_PX)
    panels = [
        Panel(f"{name}: the arm at {path.track_mm:.0f} mm of its track", faces[name], side, [name])
        for name, path in paths.items()
        if isinstance(path, ArmPath)
    ]
    above = camera_on(before, *FROM_ABOVE, SIZE_PX)
    title_above = "The viewing lines and their fields from above"
    panels.append(Panel(title_above, scene_faces(scene), above, list(paths)))
    rows = (len(panels) + 1) // 2
    note = (
        "The arm is half-way along its line. The arrow is the sensor's path, from the first "
        "profile to the last; the outlines are its field at both ends, faint where hidden."
    )
    with page_style():
        figure = new_figure(title, HEAD_IN + rows * (TITLE_IN + TALL_IN + GAP_IN) + FOOT_IN, note)
        for place, panel in enumerate(panels):
            bottom_in = FOOT_IN + (rows - 1 - place // 2) * (TITLE_IN + TALL_IN + GAP_IN)
            left_in = 0.15 + (place % 2) * (WIDE_IN + GAP_IN)
            ax = add_axes(figure, left_in, bottom_in, WIDE_IN, TALL_IN)
            _draw_panel(ax, panel, outlines)
        return save(figure, file)


def _draw_panel(ax: Axes, panel: Panel, outlines: Mapping[str, list[FloatArray]]) -> None:
    shot = draw(panel.faces, panel.camera)
    ax.imshow(shot.image, interpolation="antialiased")
    for place, (name, lines) in enumerate(outlines.items()):
        if name not in panel.views:
            continue
        colour = VIEW_COLOURS[place % len(VIEW_COLOURS)]
        for number, line_m in enumerate(lines):
            pixels, hidden = _projected(shot, panel.camera, line_m)
            width = 1.8 if number == 0 else 0.8
            for mask, alpha in ((hidden, 0.25), (~hidden, 0.9)):
                drawn = np.where(mask[:, None], pixels, np.nan)
                ax.plot(*drawn.T, color=colour, lw=width, alpha=alpha, solid_capstyle="butt")
        start, end = panel.camera.pixels(lines[0][[0, -1]])
        ax.annotate("", end, start, arrowprops={"arrowstyle": "-|>", "color": colour, "lw": 1.8})
        ax.plot(*start, "o", color=colour, ms=3.5)
        ax.annotate(
            name, end, (0, 5), textcoords="offset points", ha="center", va="bottom",
            color=colour, fontsize=8.5, fontweight="bold",
            bbox={"boxstyle": "round,pad=0.15", "fc": "white", "ec": "none", "alpha": 0.8},
        )  # fmt: skip
    ax.set_title(panel.title, loc="left")
    ax.set_xlim(-0.5, SIZE_PX[0] - 0.5)
    ax.set_ylim(SIZE_PX[1] - 0.5, -0.5)
    ax.axis("off")


def _projected(
    shot: Shot, camera: Camera, line_m: FloatArray
) -> tuple[FloatArray, np.ndarray[tuple[int], np.dtype[np.bool_]]]:
    """Points along a polyline in the image, and whether a face hides each."""
    points_m = points_along(line_m, SAMPLES)
    pixels = camera.pixels(points_m)
    depth_m = (points_m - camera.origin_m) @ camera.rotation[:, 2]
    column, row = np.clip(np.rint(pixels), 0, np.array(SIZE_PX) - 1).astype(int).T
    return pixels, depth_m > 1.001 * shot.depth_m[row, column]
