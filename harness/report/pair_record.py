"""A registered pair as files that the page takes in: scans, surroundings, and what was made of it.

Beside the figures, in the folder `pairs` of the results; the page of a run is built from them.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
from scipy.spatial.transform import RigidTransform

from harness.execution import full_spec, scene_of, sensor_of
from harness.figures.pair_view import PairView
from harness.report.packing import compressed, write_by_content, write_whole
from harness.report.pair_layers import (
    Surroundings,
    distances,
    scan_layer,
    shift_layer,
    surroundings_layer,
    view_layers,
)
from harness.report.record_paths import record_path
from harness.scoring.poses import pose_error
from harness.trials.specs import Trial

ROLES = ("target", "source")


def write_trial(pair: PairView, trial: Trial, folder: Path) -> list[Path]:
    """Write the record of a trial and what it shares with others; returns the files."""
    record = write_pair(pair, surroundings(trial), folder)
    path = record_path(folder, trial.id)
    write_whole(path, compressed({"id": trial.id, **record}))
    return [path, *(folder / name for name in record["files"].values())]


def surroundings(trial: Trial) -> Surroundings:
    """The exact surfaces and the sensors' fields of a simulated trial."""
    spec = full_spec(trial)
    sensor = sensor_of(spec)
    paths = {"target": spec.path(spec.target), "source": spec.path(spec.source)}
    return Surroundings(
        tuple(1000.0 * surface.polygon_m for surface in scene_of(spec).surfaces),
        {role: sensor.outline(path) for role, path in paths.items()},
        paths["target"].T_world_view,
    )


def write_pair(pair: PairView, known: Surroundings | None, folder: Path) -> dict[str, Any]:
    """Write the scans and surroundings of a pair; returns its record, which names those files."""
    folder.mkdir(parents=True, exist_ok=True)
    files = {
        role: write_by_content(scan_layer(scan), folder, "scan")
        for role, scan in zip(ROLES, (pair.target, pair.source), strict=True)
    }
    if known is not None:
        files["surroundings"] = write_by_content(surroundings_layer(known), folder, "scene")
    pose, layers = pair.result.T_target_source, view_layers(pair)
    exact = pair.T_target_source_exact if known is not None else None
    error = None
    if pose is not None and exact is not None:
        off = pose_error(exact, pose)
        error = [float(np.rad2deg(off.rotation_rad)), off.translation_mm]
    return {
        "pair": pair.pair,
        "scene": pair.scene,
        "method": pair.method,
        "repeat": pair.repeat,
        "views": {"target": pair.target_view, "source": pair.source_view},
        "status": pair.result.status,
        "reason": pair.result.reason,
        "notes": list(pair.result.notes),
        "error": error,
        "overlap": pair.overlap if known is not None else None,
        "files": files,
        "layers": layers,
        "shifts": shift_layer(pair),
        "distances": distances(pair),
        "poses": {"estimate": _matrix(pose), "exact": _matrix(exact)},
        "stages": stages(pair, layers, exact is not None),
    }


def stages(pair: PairView, layers: dict[str, Any], exact_known: bool) -> list[dict[str, Any]]:
    """The steps of the slider, from raw profiles to the final pose, as far as the method got.

    Each has a name, a sentence, the layers it shows and the pose that the source is drawn at.
    """
    found = layers["target"].keys() | layers["source"].keys()
    steps = [
        ("Raw profiles", "Every profile as measured, the two views drawn beside each other.",
         ["profiles"], "beside"),
    ]  # fmt: skip
    if "filtered" in found:
        steps.append(("Filtered", "Median and cliffs: isolated points are gone.",
                      ["filtered"], "beside"))  # fmt: skip
    if "segments" in found:
        steps.append(("Line segments", "Straight pieces of every profile.",
                      ["segments"], "beside"))  # fmt: skip
    if "patches" in found:
        text = (
            "Planes and their normals. Matched ones have the same colour in both views, "
            "grey ones found no partner."
        )
        steps.append(("Patches", text, ["patches", "normals"], "beside"))
    text = "Both scans in one frame as if the sensor had not moved: what has to be registered."
    steps.append(("Before", text, ["points"], "none"))
    if pair.result.T_target_source is not None:
        text = "The source turned by the estimated rotation; the sensors still share an origin."
        steps.append(("Turned", text, ["points"], "rotation"))
        steps.append(("Registered", "The source moved by the estimated pose.",
                      ["points"], "estimate"))  # fmt: skip
    if exact_known:
        text = "The source moved by the exact pose, with the exact surfaces of the scene."
        steps.append(("Exact pose", text, ["points", "surfaces"], "exact"))
    return [
        {"name": name, "text": text, "layers": shown, "pose": pose}
        for name, text, shown, pose in steps
    ]


def _matrix(pose: RigidTransform | None) -> list[list[float]] | None:
    return None if pose is None else [[float(v) for v in row] for row in pose.as_matrix()]
