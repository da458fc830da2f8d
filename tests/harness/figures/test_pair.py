"""The figures of a pair: there, whole, the same every time, and as far as the evidence goes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import matplotlib
import numpy as np
import pytest
from PIL import Image
from scipy.spatial.transform import RigidTransform, Rotation

from harness.figures.looks import FRONT, TOP, limits
from harness.figures.page import MAX_POINTS, projections, thinned
from harness.figures.pair import KINDS, draw_pair
from harness.figures.pair_matches import sorted_matches
from harness.figures.pair_view import PairView
from harness.figures.planes import normal_colours
from harness.figures.point_labels import draw_labelled_points
from harness.figures.shifts import box_edges
from harness.figures.superposition import draw_superposition
from harness.report.pair_layers import view_layers
from harness.scoring import exact_pose
from registration import RegistrationResult, Scan, register
from registration.gauss_sphere.evidence import patch_of_points
from scenes.separated_planes import SeparatedPlanesParams, separated_planes
from sensors.jupiter import Jupiter, JupiterParams
from sensors.paths import aimed_view, straight_line


@pytest.fixture(scope="module")
def pair() -> PairView:
    """Two exact views of plates, registered by the thesis's method."""
    sensor, scene = Jupiter(JupiterParams()), separated_planes(SeparatedPlanesParams())
    paths = [
        straight_line(aimed_view([0, 0, 0], 700.0, yaw, 0.1, 0.0, 60, 5.0), 60, 5.0)
        for yaw in (-0.1, 0.1)
    ]
    target, source = (
        Scan.from_points(sensor.hits(scene, path).points_mm, 5.0, apex_mm=sensor.apex_mm)
        for path in paths
    )
    result = register(target, source, "thesis")
    assert result.status == "ok", result.reason
    return PairView(
        pair="a.b",
        scene="separated_planes",
        target_view="right",
        source_view="left",
        method="thesis",
        repeat=0,
        target=target,
        source=source,
        T_target_source_exact=exact_pose(*paths),
        overlap=0.9,
        result=result,
    )


def failed(pair: PairView, reason: str = "nothing was tried") -> PairView:
    return replace(pair, result=RegistrationResult(None, "failed", reason))


def inked(path: Path, boxes: int = 2) -> list[float]:
    """Share of pixels that are not white, in each cell of a grid laid over the page."""
    with Image.open(path) as image:
        page = np.asarray(image.convert("L")) < 250
    return [
        float(cell.mean())
        for row in np.array_split(page, boxes, axis=0)
        for cell in np.array_split(row, boxes, axis=1)
    ]


def words(figure) -> str:
    texts = figure.findobj(matplotlib.text.Text)
    return " ".join(" ".join(text.get_text().split()) for text in texts)


def test_a_registered_pair_gets_every_figure(pair: PairView, tmp_path: Path) -> None:
    files = draw_pair(pair, tmp_path / "figures")
    assert [file.name for file in files] == [
        f"a.b_thesis_{place}_{kind}.png" for place, kind in enumerate(KINDS, start=1)
    ]
    for file in files:
        assert 10_000 < file.stat().st_size < 400_000, file.name
        assert min(inked(file)) > 0.01, file.name
        with Image.open(file) as image:
            assert 900 < image.width < 1300
            assert 400 < image.height < 1600
    assert sorted(file.name for file in (tmp_path / "figures").iterdir()) == [f.name for f in files]


def test_figures_are_the_same_bytes_whatever_the_users_settings(
    pair: PairView, tmp_path: Path
) -> None:
    first = draw_pair(failed(pair), tmp_path / "first")
    with matplotlib.rc_context({"font.size": 20.0, "figure.facecolor": "black"}):
        second = draw_pair(failed(pair), tmp_path / "second")
        assert matplotlib.rcParams["font.size"] == 20.0
    assert [f.read_bytes() for f in first] == [f.read_bytes() for f in second]


def test_a_failed_pair_shows_the_exact_pose_and_says_why(pair: PairView, tmp_path: Path) -> None:
    (tmp_path / "a.b_thesis_6_shifts.png").write_bytes(b"of an earlier drawing")
    files = draw_pair(failed(pair), tmp_path)
    assert [file.stem.split("_", 3)[-1] for file in files] == ["measurements", "superposition"]
    assert sorted(tmp_path.iterdir()) == files
    told = words(draw_superposition(failed(pair, "no two planes agree"), "title"))
    assert "Failed: no two planes agree." in told
    assert "Exact pose" in told
    assert "estimated" not in told


def test_the_superposition_states_the_error(pair: PairView) -> None:
    by = RigidTransform.from_components([3.0, 0.0, 4.0], Rotation.from_rotvec([0.0, 0.02, 0.0]))
    estimate = RigidTransform.from_components(
        pair.T_target_source_exact.translation + by.translation,
        by.rotation * pair.T_target_source_exact.rotation,
    )
    told = words(draw_superposition(replace(pair, result=RegistrationResult(estimate, "ok")), "x"))
    assert "off by 1.15° and 5.0 mm" in told
    assert "Exact pose" not in told


def test_stages_that_found_nothing_are_left_out(pair: PairView, tmp_path: Path) -> None:
    empty = Scan.from_points(np.full((20, 64, 3), np.nan), 5.0)
    blind = replace(pair, target=empty, result=register(empty, pair.source, "thesis"))
    kinds = [file.stem.split("_", 3)[-1] for file in draw_pair(blind, tmp_path)]
    assert "measurements" in kinds
    assert "superposition" in kinds
    assert "shifts" not in kinds


def test_projections_are_to_scale() -> None:
    rng = np.random.default_rng(4)
    points = [rng.uniform([0, -300, 700], [390, 250, 1200], (50, 3)) for _ in range(2)]
    figure, axes = projections("title", ["a", "b"], points)
    figure.canvas.draw_idle()
    size = figure.get_size_inches()
    for row, projection in zip(axes, (FRONT, TOP), strict=True):
        for ax in row:
            place = ax.get_position(original=True)
            across, up = (np.diff(lim)[0] for lim in (ax.get_xlim(), ax.get_ylim()))
            scale = across / (place.width * size[0])
            assert up / (place.height * size[1]) == pytest.approx(scale)
            shown = np.concatenate(points)[:, [projection.right, projection.up]]
            assert (shown.min(axis=0) >= [ax.get_xlim()[0], ax.get_ylim()[0]]).all()
            assert (shown.max(axis=0) <= [ax.get_xlim()[1], ax.get_ylim()[1]]).all()


@pytest.mark.parametrize("points", [np.zeros((0, 3)), np.full((4, 3), np.nan), np.ones((1, 3))])
def test_limits_are_never_flat(points: np.ndarray) -> None:
    low, high = limits([points])
    assert (high - low >= 5.0).all()


def test_thinning_keeps_points_as_they_are() -> None:
    cloud = np.random.default_rng(1).normal(size=(20_000, 3))
    thin = thinned(cloud)
    assert len(thin) == MAX_POINTS
    assert len(np.unique(thin, axis=0)) == len(thin)
    assert set(map(tuple, thin)) <= set(map(tuple, cloud))


def test_matched_normals_share_a_colour() -> None:
    matches = sorted_matches(np.array([[2, 0], [0, 3]]), np.array([9.0, 5.0, 1.0]))
    assert matches.tolist() == [[0, 3], [2, 0]]
    target, source = normal_colours(3, matches[:, 0]), normal_colours(4, matches[:, 1])
    assert target[0] == source[3]
    assert target[2] == source[0]
    assert target[1] == source[1] == source[2]
    assert len({target[0], target[1], target[2]}) == 3


def test_a_box_has_twelve_edges_along_the_axes() -> None:
    edges = np.array(box_edges(np.array([[0.0, 1.0, 2.0], [3.0, 5.0, 7.0]])))
    assert edges.shape == (12, 2, 3)
    span = np.abs(edges[:, 1] - edges[:, 0])
    assert (np.count_nonzero(span, axis=1) == 1).all()
    assert sorted(span.max(axis=1)) == [3.0] * 4 + [4.0] * 4 + [5.0] * 4


def test_points_keep_their_planes_where_profiles_are_empty(pair: PairView) -> None:
    points_mm = pair.target.points_mm.copy()
    points_mm[20:24] = points_mm[40] = np.nan
    target = Scan.from_points(points_mm, 5.0, apex_mm=pair.target.apex_mm)
    result = register(target, pair.source)
    assert result.status == "ok", result.reason
    shown = replace(pair, target=target, result=result, method="gauss_sphere")
    planes = result.evidence["planes"]
    figure = draw_labelled_points(shown, planes, "planes")
    label = patch_of_points(target, planes.target)
    offsets = figure.axes[0].collections[0].get_offsets()
    assert len(offsets) == np.count_nonzero(label >= 0)
    hulls = view_layers(shown)["target"]["patches"]
    assert len(hulls["sizes"]) == planes.target.patches.n_points.size
    for index in range(planes.target.patches.n_points.size):
        away_mm = target.points_mm[label == index] @ planes.target.patches.normal[index]
        assert np.ptp(away_mm) < 1.0
