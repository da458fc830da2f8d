"""Many views in one frame, and what closing a loop of pairs does for the pose of each.

Section 6.4 finds the left and the right view better registered by way of the center one.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from harness.config.schema import Experiment
from harness.scoring.poses import parameter_errors, pose_error, six_parameters
from harness.tables.table import Table
from registration.pose_graph import PoseGraphError, RelativePose, chain_poses, close_loops
from registration.scan import FloatArray

# What a method that gives no covariance is taken to know: every registration alike.
NO_COVARIANCE = np.diag([np.deg2rad(1.0) ** 2] * 3 + [10.0**2] * 3)
WAYS = ("directly", "by way of the others", "pose graph")
AXES = ("X error (mm)", "Y error (mm)", "Z error (mm)")


class Estimate(NamedTuple):
    """The pose of a pair by one of the WAYS; how often the loop would disagree more by chance."""

    way: str
    T_target_source: RigidTransform
    p_value: float = np.nan


def loop_tables(experiment: Experiment, rows: pd.DataFrame) -> list[Table]:
    """The one table of all pairs that close a loop, or none without a loop.

    rows: whole trials, as store.load gives them.
    """
    looped = pairs_in_loops(experiment)
    if not looped:
        return []
    records = []
    for name in sorted(looped, key=lambda pair: experiment.pairs[pair].printed is not None):
        pair = experiment.pairs[name]
        for method, of_method in rows.groupby("method", sort=False):
            repeats = [group for _, group in of_method.groupby("repeat")]
            errors: dict[str, list[list[float]]] = {way: [] for way in WAYS}
            for group in repeats:
                exact = group.loc[group["pair"] == name, "T_exact"]
                if exact.empty or exact.iloc[0] is None:
                    continue
                T_exact = RigidTransform.from_matrix(exact.iloc[0])
                for found in estimates(experiment, name, relative_poses(experiment, group)):
                    errors[found.way].append([*_errors(T_exact, found), found.p_value])
            if any(errors.values()):
                records += [
                    {"Pair": f"{name}: {pair.source} to {pair.target}", "Method": method}
                    | _record(way, errors[way], len(repeats))
                    for way in WAYS
                    if way == WAYS[0] or errors[way]
                ]
    if not records:
        return []
    formats = dict.fromkeys(("Rotation (deg)", "Translation (mm)"), ".2f")
    formats |= dict.fromkeys(AXES, "+.2f") | {"Loop, p": ".2g"}
    return [
        Table(
            "loops",
            "Pairs in a loop: directly, by way of the others, by the pose graph",
            "Medians over the repeats that have an estimate that way. The way by the others "
            "multiplies the fewest registrations; where the answers close a loop, the graph takes "
            "all of them by their covariances and weighs down what contradicts the rest. A method "
            "without covariances has every registration count alike (1 deg, 10 mm). Loop, p: how "
            "often chance alone would let the loop gape wider; far below 0.01, a registration is "
            "wrong or surer than it may be.",
            pd.DataFrame(records),
            formats,
        )
    ]


def middle_view(edges: Iterable[RelativePose], names: Sequence[str]) -> str:
    """The view with the most edges, the first of the names among equals."""
    counts = Counter(view for edge in edges for view in (edge.target, edge.source))
    return max(names, key=lambda name: counts[name])


def poses_in(reference: str, edges: Sequence[RelativePose]) -> dict[str, RigidTransform]:
    """T_reference_view of every view that edges lead to, all loops closed."""
    linked = _linked(edges, reference)
    if not linked:
        return {reference: RigidTransform.identity()}
    graph = close_loops(linked, reference)
    return dict(zip(graph.views, graph.T_reference_view, strict=True))


def usable(covariance: FloatArray | None) -> FloatArray:
    """A covariance that can weigh an edge: the given one if it is one, else NO_COVARIANCE."""
    if covariance is None or covariance.shape != (6, 6) or not np.isfinite(covariance).all():
        return NO_COVARIANCE
    return covariance if np.linalg.eigvalsh(covariance)[0] > 0.0 else NO_COVARIANCE


def pairs_in_loops(experiment: Experiment) -> list[str]:
    """Names of the pairs whose views are also linked by other pairs."""
    links = {name: (pair.target, pair.source) for name, pair in experiment.pairs.items()}
    looped = []
    for name, (target, source) in links.items():
        if target in _reached(source, [link for other, link in links.items() if other != name]):
            looped.append(name)
    return looped


def relative_poses(experiment: Experiment, rows: pd.DataFrame) -> dict[str, RelativePose]:
    """The answers of status ok of one method and one repeat, by pair."""
    found = {}
    for name, status, pose, covariance in zip(
        rows["pair"], rows["status"], rows["T_estimated"], rows["covariance"], strict=True
    ):
        if status == "ok" and pose is not None:
            pair = experiment.pairs[name]
            T_target_source = RigidTransform.from_matrix(pose)
            found[name] = RelativePose(
                pair.target, pair.source, T_target_source, usable(covariance)
            )
    return found


def estimates(
    experiment: Experiment, name: str, edges: dict[str, RelativePose]
) -> Iterator[Estimate]:
    """The pose of a pair by each of the WAYS that its own and the other registrations allow."""
    pair = experiment.pairs[name]
    if name in edges:
        yield Estimate(WAYS[0], edges[name].T_target_source)
    others = [edge for other, edge in edges.items() if other != name]
    for way, given, solve in (
        (WAYS[1], others, chain_poses),
        (WAYS[2], list(edges.values()), close_loops),
    ):
        linked = _linked(given, pair.target)
        try:
            graph = solve(linked, pair.target)
            pose = graph.relative(pair.target, pair.source).T_target_source
        except PoseGraphError:
            continue  # too few of the pairs were answered
        if way == WAYS[1]:
            yield Estimate(way, pose)
        elif len(linked) >= len(graph.views):  # without a loop it would be one of the other ways
            yield Estimate(way, pose, graph.p_value)


def _linked(edges: Sequence[RelativePose], view: str) -> list[RelativePose]:
    """The edges that hang together with a view."""
    reached = _reached(view, [(edge.target, edge.source) for edge in edges])
    return [edge for edge in edges if edge.target in reached]


def _reached(view: str, links: Sequence[tuple[str, str]]) -> set[str]:
    """The views that links of two lead to from a view, however far."""
    reached, grown = {view}, True
    while grown:
        before = len(reached)
        for link in links:
            if not reached.isdisjoint(link):
                reached.update(link)
        grown = len(reached) > before
    return reached


def _errors(T_exact: RigidTransform, found: Estimate) -> list[float]:
    """Angle in degrees and length in mm of the error, and its X, Y and Z."""
    error = pose_error(T_exact, found.T_target_source)
    apart = parameter_errors(six_parameters(T_exact), six_parameters(found.T_target_source))
    return [float(np.rad2deg(error.rotation_rad)), error.translation_mm, *apart[3:].tolist()]


def _record(way: str, errors: list[list[float]], repeats: int) -> dict[str, Any]:
    record: dict[str, Any] = {"How": way, "Answered": f"{len(errors)}/{repeats}"}
    columns = ("Rotation (deg)", "Translation (mm)", *AXES, "Loop, p")
    values = np.array(errors).reshape(-1, len(columns)).T
    for column, of_column in zip(columns, values, strict=True):
        known = of_column[np.isfinite(of_column)]
        record[column] = float(np.median(known)) if len(known) else np.nan
    return record
