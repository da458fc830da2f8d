"""The trials that the questions of section 6.6 need, from the configs of its experiments."""

from __future__ import annotations

import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated, Any, Literal

from pydantic import Field

from experiments.icp_on_top import ROUNDS
from harness.config.errors import ConfigError
from harness.config.reading import overridden_mapping, validated
from harness.config.schema import AimedView, Angle, Experiment, Length
from harness.config.strict import Strict
from harness.session import open_session
from harness.trials.specs import Trial

KIND = "discussion"
Repeats = Annotated[int, Field(ge=1, le=10_000)]

PLAIN = "plain"
ON_TRUE_ROTATION = ", true rotation"
# What section 6.6 would change in the last stages of the thesis method; the first is as it ran.
STAGES: dict[str, dict[str, Any]] = {
    PLAIN: {},
    "densest shift in 3D": {"translation": {"density": "3d"}},
    "hierarchical shift": {"translation": {"density": "hierarchical"}},
    "plane distances": {"translation": {"estimate": "plane_distances"}},
    "plane distances in 3D": {"translation": {"density": "3d", "estimate": "plane_distances"}},
    "ICP on top": {"icp": {"rounds": ROUNDS}},
}
BOTH = [{"name": "thesis"}, {"name": "gauss_sphere"}]


class Stages(Strict):
    """How often every pair of the tables is scanned, to compare variants of the last stages."""

    repeats: Repeats


class Turned(Strict):
    """By which angles the true rotation is turned, about how many axes, in how many scans."""

    angles_deg: tuple[Annotated[float, Field(ge=0.0, le=45.0)], ...] = Field(min_length=2)
    axes: Repeats
    repeats: Repeats


class Moved(Strict):
    """How far a view of the desk is moved, along Y and along Z, and how often it is scanned."""

    shift_mm: Length
    repeats: Repeats


class Overlap(Strict):
    """Angles between two views about the vertical, and how far apart they look across it."""

    turns_deg: tuple[Angle, ...] = Field(min_length=1)
    apart_mm: tuple[Annotated[float, Field(ge=0.0)], ...] = Field(min_length=2)
    repeats: Repeats


class Bracket(Strict):
    """How many times as far off as in the config of the desk the bracket is."""

    times: tuple[Annotated[float, Field(ge=0.0, le=100.0)], ...] = Field(min_length=2)
    repeats: Repeats


class DiscussionExperiment(Strict):
    """What configs/discussion.yaml may say; desk and foam are configs beside it."""

    experiment: Literal["discussion"]
    title: str
    description: str = ""
    desk: str
    foam: str
    stages: Stages
    turned: Turned
    moved: Moved
    overlap: Overlap
    bracket: Bracket
    seed: int = Field(default=0, ge=0)


@dataclass(frozen=True)
class Asked:
    """A trial and what it is asked for: the question, the scene, and the value that changes."""

    trial: Trial
    question: str
    scene: str
    value: Any


def load_discussion(
    path: Path, overrides: Sequence[str] = (), seed: int | None = None
) -> tuple[DiscussionExperiment, tuple[Asked, ...]]:
    """Read a config and those it builds on, and make all trials; raises ConfigError."""
    data = overridden_mapping(path, overrides, seed)
    experiment: DiscussionExperiment = validated(DiscussionExperiment, data, path)
    files = {"desk": path.parent / experiment.desk, "foam": path.parent / experiment.foam}
    asked: list[Asked] = []
    for question in (_stages, _turned, _moved, _overlap, _bracket):
        asked += question(experiment, files)
    return experiment, tuple(asked)


def _stages(experiment: DiscussionExperiment, files: Mapping[str, Path]) -> Iterator[Asked]:
    """The variants on scans, and those before ICP with the true rotation too."""
    methods: list[dict[str, Any]] = []
    for label, params in STAGES.items():
        given = [] if "icp" in params else ["rotation"]
        methods.append({"name": "thesis", "label": label, "params": params, "given": given})
    methods.append({"name": "gauss_sphere"})
    on_top = "experiments.icp_on_top:gauss_sphere_icp"
    methods.append({"name": on_top, "label": "gauss_sphere, ICP on top"})
    for scene, file in files.items():
        changes = {"methods": methods, "repeats": experiment.stages.repeats}
        for trial in _trials(experiment, file, changes, tables_only=True):
            entered = ON_TRUE_ROTATION if trial.spec.given else ""
            named = replace(trial, pair=trial.pair + entered)
            yield Asked(named, "stages", scene, trial.pair)


def _turned(experiment: DiscussionExperiment, files: Mapping[str, Path]) -> Iterator[Asked]:
    """The scans to turn the rotation on: those of the stages, by the two methods."""
    for scene, file in files.items():
        changes = {"methods": BOTH, "repeats": experiment.turned.repeats}
        for trial in _trials(experiment, file, changes, tables_only=True):
            yield Asked(trial, "turned", scene, trial.pair)


def _moved(experiment: DiscussionExperiment, files: Mapping[str, Path]) -> Iterator[Asked]:
    shift_mm = experiment.moved.shift_mm
    here = _aimed(files["desk"]).model_dump()
    views: dict[str, Any] = {"here": here}
    pairs = {}
    for axis, translation_mm in (("Y", [0.0, shift_mm, 0.0]), ("Z", [0.0, 0.0, shift_mm])):
        views[f"along_{axis}"] = {
            "relative_to": "here",
            "rotation_deg": [0, 0, 0],
            "translation_mm": translation_mm,
        }
        pairs[f"moved along {axis}"] = {"source": f"along_{axis}", "target": "here"}
    changes = {"repeats": experiment.moved.repeats, **_free(views, pairs)}
    for trial in _trials(experiment, files["desk"], changes):
        yield Asked(trial, "moved", "desk", trial.pair[-1])


def _overlap(experiment: DiscussionExperiment, files: Mapping[str, Path]) -> Iterator[Asked]:
    for scene, file in files.items():
        middle = _aimed(file)
        views, pairs, turns = {}, {}, {}
        for turn in experiment.overlap.turns_deg:
            for apart in experiment.overlap.apart_mm:
                name = f"turned by {turn:g}, {apart:g} mm apart"
                for side, sign in (("left", -0.5), ("right", 0.5)):
                    x, y, z = middle.aim_mm
                    aimed = middle.model_copy(
                        update={
                            "aim_mm": (x, y + sign * apart, z),
                            "yaw_deg": sign * turn,
                            "roll_deg": 0.0,
                        }
                    )
                    views[f"{side} {name}"] = aimed.model_dump()
                pairs[name] = {"source": f"left {name}", "target": f"right {name}"}
                turns[name] = turn
        # As on random pairs: it takes no finer profiles to see how much the views have to share.
        scan = {"profiles": 80, "step_mm": 5.0}
        changes = {"repeats": experiment.overlap.repeats, "scan": scan, **_free(views, pairs)}
        for trial in _trials(experiment, file, changes):
            named = replace(trial, pair=f"{scene} {trial.pair}")
            yield Asked(named, "overlap", scene, turns[trial.pair])


def _bracket(experiment: DiscussionExperiment, files: Mapping[str, Path]) -> Iterator[Asked]:
    file = files["desk"]
    arm = overridden_mapping(file).get("arm") or {}
    if not any(arm.get("bracket_mm", ())) and not any(arm.get("bracket_deg", ())):
        raise ConfigError(file, ("arm",), "has no bracket_mm nor bracket_deg to multiply")
    for times in experiment.bracket.times:
        off = {
            name: [times * value for value in arm.get(name, [0.0, 0.0, 0.0])]
            for name in ("bracket_mm", "bracket_deg")
        }
        changes = {"methods": BOTH, "repeats": experiment.bracket.repeats, "arm": arm | off}
        for trial in _trials(experiment, file, changes, tables_only=True):
            named = replace(trial, pair=f"{trial.pair}, bracket times {times:g}")
            yield Asked(named, "bracket", "desk", times)


def _free(views: dict[str, Any], pairs: dict[str, Any]) -> dict[str, Any]:
    """What views of one's own need: no arm, as they are nowhere it was driven."""
    return {"views": views, "pairs": pairs, "arm": None, "compaction": {}, "methods": BOTH}


def _aimed(file: Path) -> AimedView:
    """The view of a config that the others hang on."""
    experiment = open_session(file, None).experiment
    views = experiment.views.values() if isinstance(experiment, Experiment) else ()
    for view in views:
        if isinstance(view, AimedView):
            return view
    raise ConfigError(file, ("views",), "has no view with aim_mm, from which others are made")


def _trials(
    experiment: DiscussionExperiment,
    file: Path,
    changes: Mapping[str, Any],
    tables_only: bool = False,
) -> Iterator[Trial]:
    """The trials of a config with changed keys; of the pairs that a table prints only, if asked."""
    overrides = [f"{key}={json.dumps(value)}" for key, value in changes.items()]
    session = open_session(file, None, overrides, experiment.seed)
    if not isinstance(session.experiment, Experiment):
        raise ConfigError(file, ("experiment",), "is no experiment on named pairs of views")
    printed = {name for name, pair in session.experiment.pairs.items() if pair.printed is not None}
    for trial in session.trials:
        if not tables_only or trial.pair in printed:
            yield trial
