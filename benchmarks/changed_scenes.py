"""What methods make of scenes in which a thing was moved, taken away or added between the scans.

python benchmarks/changed_scenes.py [--pairs N] [--seed N] [--only KIND ...]

Clutter, everyday scenes and some that repeat themselves, as hard_scenes.py has them, with a new
scene for every pair. A thing, any solid, is changed if that changes 2 to 25 % of the points of the
source scan; where none does, the pair is left out of that row. The truth is the pose of all the
rest. A wrong answer is marked "ok" and off by more than 5 degrees or 30 mm; "in doubt": a note of
the answer names another pose. Errors are those of right answers.
"""

from __future__ import annotations

from harness.workers.threads import limit_threads

limit_threads()

import argparse  # noqa: E402
from collections import defaultdict  # noqa: E402
from collections.abc import Callable, Sequence  # noqa: E402
from dataclasses import dataclass, replace  # noqa: E402

import numpy as np  # noqa: E402
import pandas as pd  # noqa: E402
from everyday_scenes import EVERYDAY  # noqa: E402
from hard_scenes import CONFIG, KINDS, STATUSES, families_of, methods_compared  # noqa: E402
from scipy.spatial.transform import RigidTransform  # noqa: E402
from scipy.stats import chi2  # noqa: E402
from tabulate import tabulate  # noqa: E402

from harness.config.reading import load_experiment  # noqa: E402
from harness.execution import full_spec  # noqa: E402
from harness.scoring.normalised_errors import squared_distances  # noqa: E402
from harness.scoring.poses import COARSE, exact_pose, is_success, pose_error  # noqa: E402
from harness.trials.random_pairs import build_random_trials  # noqa: E402
from harness.trials.specs import TrialSpec, keyed_rng  # noqa: E402
from harness.trials.views import ViewSpec  # noqa: E402
from registration import RegistrationResult, Scan, register  # noqa: E402
from scenes import SCENES, SceneEntry  # noqa: E402
from scenes.clutter import ClutterParams, scattered_solids  # noqa: E402
from scenes.rays import RayError  # noqa: E402
from scenes.scene import Scene  # noqa: E402
from scenes.solids import Solid, assemble, turned  # noqa: E402
from sensors import SENSORS  # noqa: E402

LEAST_CHANGED, MOST_CHANGED = 0.02, 0.25
REPEATING = ("shelf", "grid", "roofs", "brackets")

Change = Callable[[list[Solid], int, np.random.Generator], list[Solid]]


def clutter(rng: np.random.Generator) -> list[Solid]:
    """As configs/random_pairs.yaml has it."""
    return scattered_solids(ClutterParams(seed=int(rng.integers(2**31))))


SOLIDS = {"clutter": clutter, **EVERYDAY, **{kind: KINDS[kind] for kind in REPEATING}}


@dataclass(frozen=True)
class ThingsParams:
    """kind: one of SOLIDS; the seed decides the sizes."""

    kind: str = "clutter"
    seed: int = 0

    def solids(self) -> list[Solid]:
        return SOLIDS[self.kind](np.random.default_rng(self.seed))


def things(params: ThingsParams) -> Scene:
    """Build a scene of solids that can be changed one by one."""
    return assemble(params.kind, params.solids())


def moved(low_mm: float, high_mm: float) -> Change:
    """A thing pushed anywhere over the floor."""

    def change(solids: list[Solid], k: int, rng: np.random.Generator) -> list[Solid]:
        far_m = np.exp(rng.uniform(np.log(low_mm), np.log(high_mm))) / 1000.0
        position_m = solids[k].position_m + _anywhere(far_m, rng)
        return [*solids[:k], replace(solids[k], position_m=position_m), *solids[k + 1 :]]

    return change


def taken_away(solids: list[Solid], k: int, _: np.random.Generator) -> list[Solid]:
    return [*solids[:k], *solids[k + 1 :]]


def put_there(solids: list[Solid], k: int, rng: np.random.Generator) -> list[Solid]:
    """Another thing like one that is there, beside it and turned."""
    like = solids[k]
    another = replace(
        like,
        name=f"another {like.name}",
        position_m=like.position_m + _anywhere(rng.uniform(0.1, 0.3), rng),
        rotation=turned(rng.uniform(-180.0, 180.0)) * like.rotation,
    )
    return [*solids, another]


def _anywhere(far_m: float, rng: np.random.Generator) -> np.ndarray:
    angle = rng.uniform(0.0, 2.0 * np.pi)
    return far_m * np.array([np.cos(angle), np.sin(angle), 0.0])


CHANGES: dict[str, Change] = {
    "moved by 2 to 10 mm": moved(2.0, 10.0),
    "moved by 10 to 50 mm": moved(10.0, 50.0),
    "moved by 50 to 300 mm": moved(50.0, 300.0),
    "taken away": taken_away,
    "added": put_there,
}


def scanned(spec: TrialSpec, scene: Scene, view: ViewSpec) -> Scan:
    """A view of a scene; the noise of a beam is the same in any."""
    sensor = SENSORS[spec.sensor.name].factory(spec.sensor.params)
    scan: Scan = sensor.scan(scene, spec.path(view), spec.view_rng(view))
    return scan


def changed_scan(
    spec: TrialSpec, source: Scan, change: Change, rng: np.random.Generator
) -> Scan | None:
    """The source scan after one thing was changed, or None where all are too large or small."""
    solids = spec.scene.params.solids()
    for k in rng.permutation(len(solids)):
        try:
            scan = scanned(spec, assemble("changed", change(solids, int(k), rng)), spec.source)
        except RayError:
            continue  # the sensor would stand inside of a solid
        seen = scan.valid | source.valid
        differs = seen & (scan.points_mm != source.points_mm).any(axis=2)
        if LEAST_CHANGED <= differs.sum() / max(seen.sum(), 1) <= MOST_CHANGED:
            return scan
    return None


def outcome(result: RegistrationResult, T_exact: RigidTransform) -> dict[str, object]:
    """A row: what came of a pair, and for right answers how far off they are."""
    row: dict[str, object] = {"outcome": result.status, "doubt": False}
    if result.status != "ok" or result.T_target_source is None:
        return row
    error = pose_error(T_exact, result.T_target_source)
    row["outcome"] = "right" if is_success(error, COARSE) else "wrong"
    row["doubt"] = any("which is right" in note for note in result.notes)
    row["error_mm"] = error.translation_mm
    row["covariance"] = result.covariance
    row["T_estimated"] = result.T_target_source.as_matrix()
    row["T_exact"] = T_exact.as_matrix()
    return row


def counted(rows: Sequence[dict[str, object]]) -> list[object]:
    """The columns of a table for some rows."""
    of = {name: [r for r in rows if r["outcome"] == name] for name in ("right", "wrong", *STATUSES)}
    right = pd.DataFrame(of["right"], columns=["error_mm", "covariance", "T_estimated", "T_exact"])
    inside = squared_distances(right) <= chi2(6).ppf(0.99)
    return [
        len(rows),
        *(
            count
            for name in ("right", "wrong")
            for count in (len(of[name]), sum(bool(r["doubt"]) for r in of[name]))
        ),
        *(len(of[name]) for name in STATUSES),
        f"{right['error_mm'].median():.2f}" if len(right) else "",
        f"{inside.mean():.1%}" if len(right) else "",
    ]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=15, help="of each kind")
    parser.add_argument("--seed", type=int, default=20109)
    parser.add_argument("--only", nargs="+", choices=list(SOLIDS))
    options = parser.parse_args()
    SCENES["things"] = SceneEntry(things, ThingsParams)
    families = families_of("things", options.only or SOLIDS, options.pairs)
    overrides = ["methods=[{name: gauss_sphere}]", f"families={families}"]
    experiment = load_experiment(CONFIG, overrides, options.seed)
    rows = defaultdict[tuple[str, str], list[dict[str, object]]](list)
    wrong = list[tuple[str, str, str]]()
    for trial in build_random_trials(experiment, CONFIG):
        try:
            spec = full_spec(trial)
            scene = things(spec.scene.params)
            target, source = (scanned(spec, scene, view) for view in (spec.target, spec.source))
        except RayError:
            continue
        T_exact = exact_pose(*spec.paths)
        sources = {"nothing": source} | {
            # Other pairs and changes leave the random numbers of a change as they are.
            name: changed_scan(
                spec, source, change, keyed_rng(repr((options.seed, trial.pair, name)))
            )
            for name, change in CHANGES.items()
        }
        for name, scan in sources.items():
            if scan is None:
                continue
            for label, params in methods_compared(ablation=False).items():
                row = outcome(register(target, scan, params=params), T_exact)
                rows[name, label].append(row)
                if row["outcome"] == "wrong":
                    wrong.append((trial.pair, name, label))
    headers = ["changed", "method", "pairs", "ok, right", "in doubt", "ok, wrong", "in doubt",
               *STATUSES, "median error (mm)", "errors inside 99 %"]  # fmt: skip
    order = [(name, label) for name in ("nothing", *CHANGES) for label in methods_compared(False)]
    table = [[*key, *counted(rows[key])] for key in order if rows[key]]
    print(tabulate(table, headers, "github", disable_numparse=True))
    print(
        "\nWrong:", "; ".join(f"{pair}, {name}, {label}" for pair, name, label in wrong) or "none"
    )


if __name__ == "__main__":
    main()
