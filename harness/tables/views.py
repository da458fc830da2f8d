"""Tables of single views: what they are compacted to, what scanned them, how the arm stood."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from scipy.spatial.transform import RigidTransform

from harness.config.schema import Experiment
from harness.tables.card import card_table
from harness.tables.table import Table
from harness.trials.specs import Trial, full_specs
from sensors import f3
from sensors.arm import ArmPath

STAGES = ("points", "segments", "patches", "normals")


def compaction_table(experiment: Experiment, rows: pd.DataFrame) -> Table | None:
    """To how few patches and normals each view is compacted, beside what the thesis counted.

    rows: of whole methods, as store.load gives them. None where no method tells of patches.
    """
    if "n_patches_target" not in rows:
        return None
    printed = {
        name: [getattr(counted, stage, None) for stage in STAGES]
        for name, counted in experiment.compaction.items()
    }
    records: list[dict[str, Any]] = []
    for view in experiment.views:
        for method in rows["method"].unique():
            counts = _counts(experiment, rows[rows["method"] == method], view)
            if not len(counts) or counts["patches"].isna().all():
                continue
            record = {"View": view, "Method": method, "Scans": len(counts)}
            records.append(record | {name.capitalize(): counts[name].median() for name in STAGES})
        if view in printed and any(record["View"] == view for record in records):
            theirs = {
                name.capitalize(): np.nan if count is None else count
                for name, count in zip(STAGES, printed[view], strict=True)
            }
            records.append({"View": view, "Method": "the thesis's own", "Scans": 1} | theirs)
    if not records:
        return None
    return Table(
        "compaction",
        "From points to normals",
        "What is left of each view after every stage, medians over its different scans. The thesis "
        "scanned other objects than ours: its numbers are to be compared in size only.",
        pd.DataFrame(records),
        {"Scans": "d"} | {name.capitalize(): ".0f" for name in STAGES},
    )


def sensing_tables(trials: Sequence[Trial]) -> list[Table]:
    """How the arm held the sensor, where one did, and the sensor's card, where it has one.

    Both are quiet: in the files and in the page, which nobody needs to see in the terminal at
    every run.
    """
    sensor = trials[0].spec.sensor
    tables = arm_table(trials), card_table(sensor.name, sensor.params)
    return [replace(table, quiet=True) for table in tables if table is not None]


def arm_table(trials: Iterable[Trial]) -> Table | None:
    """How the arm held the sensor in each view; None without an arm."""
    records = []
    seen: set[str] = set()
    for spec in full_specs(trials):
        for view in (spec.source, spec.target):
            path = spec.path(view)
            if view.name in seen or not isinstance(path, ArmPath):
                continue
            seen.add(view.name)
            joint, slack_deg = _nearest_limit(path)
            records.append(
                {
                    "View": view.name,
                    "Track (mm)": path.track_mm,
                    "Nearest to its limit": joint,
                    "Left (deg)": slack_deg,
                }
                | {
                    f"{what} from {other} ({unit})": value
                    for what, here, other, there in (
                        ("Encoders", path.T_world_encoder, "commanded", path.T_world_commanded),
                        ("Exact", path.T_world_profile, "encoders", path.T_world_encoder),
                    )
                    for unit, value in zip(("mm", "deg"), _farthest(here, there), strict=True)
                }
            )
    if not records:
        return None
    frame = pd.DataFrame(records)
    return Table(
        "arm",
        "The arm at each view",
        "Where it stands, how far its joints keep from their limits, and how far the three poses "
        "of a profile lie apart: the largest of all profiles. Encoders differ from what was "
        "commanded by the rounding of their counts; the exact poses differ from both by where "
        "within a count a joint rests, and by the bracket.",
        frame,
        {"Track (mm)": ".0f", "Left (deg)": ".1f"} | dict.fromkeys(frame.columns[4:], ".3f"),
    )


def _counts(experiment: Experiment, rows: pd.DataFrame, view: str) -> pd.DataFrame:
    """(scans, stages) what one method left of the scans of a view, each counted once."""
    parts = []
    for name, pair in experiment.pairs.items():
        of_pair = rows[rows["pair"] == name]
        for role in ("target", "source"):
            if getattr(pair, role) == view:
                columns = {f"n_{stage}_{role}": stage for stage in STAGES}
                part = of_pair.reindex(columns=["repeat", *columns]).rename(columns=columns)
                parts.append(part)
    if not parts:
        return pd.DataFrame(columns=STAGES)
    return pd.concat(parts).drop_duplicates("repeat").astype(np.float64)


def _nearest_limit(path: ArmPath) -> tuple[str, float]:
    """The joint that comes nearest to a limit along the line, and how many degrees are left."""
    turns = f3.from_pulses(path.counts)[:, 1:]
    low, high = f3.LIMITS[1:].T
    slack = np.minimum(turns - low, high - turns).min(axis=0)
    worst = int(slack.argmin())
    return f3.JOINTS[1 + worst], float(np.rad2deg(slack[worst]))


def _farthest(here: RigidTransform, there: RigidTransform) -> tuple[float, float]:
    """Largest distance in mm and largest turn in degrees between poses (profiles,)."""
    between = there.inv() * here
    distance_mm = np.linalg.norm(between.translation, axis=1)
    return float(distance_mm.max()), float(np.rad2deg(between.rotation.magnitude().max()))
