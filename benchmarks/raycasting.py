"""What a view costs: rays by MuJoCo and by Open3D, and the share of each measurement effect.

python benchmarks/raycasting.py

One core, a view of the desk of 130 x 256 rays, in processor time, so that other work on the
machine counts little. Open3D is optional.
"""

from __future__ import annotations

import os

os.environ.setdefault("OMP_NUM_THREADS", "1")

import time
from collections.abc import Callable
from functools import partial

import numpy as np

from scenes import SCENES
from scenes.rays import cast_fans
from scenes.scene import Scene
from sensors.jupiter import Jupiter, JupiterParams
from sensors.noise import SWITCHES, NoiseParams
from sensors.paths import ViewPath, aimed_view, straight_line

PROFILES, STEP_MM, REPEATS = 130, 3.0, 40
LIMIT_MS = 60.0


def best_ms(action: Callable[[], object]) -> float:
    action()
    times_s = []
    for _ in range(REPEATS):
        start_s = time.process_time()
        action()
        times_s.append(time.process_time() - start_s)
    return 1000.0 * min(times_s)


def desk_view() -> tuple[Scene, ViewPath]:
    builder, params_type = SCENES["desk"]
    view = aimed_view([0, 0, 120], 1030, 0, np.deg2rad(25), 0, PROFILES, STEP_MM)
    return builder(params_type()), straight_line(view, PROFILES, STEP_MM)


def rays(path: ViewPath) -> tuple[np.ndarray, np.ndarray]:
    """Origins (profiles, 3) in metres and directions (profiles, pixels, 3) of the default sensor.

    A direction advances one unit in depth, so that distances are depths from the apex.
    """
    sensor = Jupiter()
    slopes = sensor.params.slopes
    fan = np.stack([np.zeros_like(slopes), slopes, np.ones_like(slopes)], axis=1)
    directions = fan @ path.T_world_profile.rotation.as_matrix().transpose(0, 2, 1)
    return path.T_world_profile.apply(sensor.apex_mm) / 1000.0, directions


def triangles(scene: Scene) -> tuple[np.ndarray, np.ndarray]:
    """Vertices (n, 3) and triangles (m, 3) of all faces, the very ones MuJoCo's rays meet."""
    vertices, indices = [], []
    for surface in scene.surfaces:
        first, corners = sum(len(v) for v in vertices), len(surface.polygon_m)
        vertices.append(surface.polygon_m)
        indices += [(first, first + i, first + i + 1) for i in range(1, corners - 1)]
    return np.concatenate(vertices).astype(np.float32), np.array(indices, dtype=np.uint32)


def compare_with_open3d(scene: Scene, path: ViewPath, ours_ms: float) -> None:
    try:
        import open3d as o3d
    except ImportError as error:
        print(
            f"Open3D cannot be imported ({error}): it comes with pip install '.[peers]' and needs "
            "the system's libusb-1.0-0"
        )
        return
    origins_m, directions = rays(path)
    vertices, faces = triangles(scene)
    target = o3d.t.geometry.RaycastingScene(nthreads=1)
    target.add_triangles(o3d.core.Tensor(vertices), o3d.core.Tensor(faces))
    starts = np.broadcast_to(origins_m[:, None], directions.shape)
    both = o3d.core.Tensor(np.concatenate([starts, directions], axis=2).astype(np.float32))
    theirs_ms = best_ms(lambda: target.cast_rays(both, nthreads=1))
    ours_m, _ = cast_fans(scene, origins_m, directions)
    theirs_m = target.cast_rays(both, nthreads=1)["t_hit"].numpy()
    met = np.isfinite(ours_m) & np.isfinite(theirs_m)
    off_mm = 1000.0 * np.abs(ours_m - theirs_m)[met]
    n = directions.shape[0] * directions.shape[1]
    print(
        f"Open3D RaycastingScene, {len(faces)} triangles {theirs_ms:9.2f} ms {rate(n, theirs_ms)}"
    )
    print(
        f"  MuJoCo takes {ours_ms / theirs_ms:.1f} times as long; depths differ by "
        f"{np.median(off_mm):.1e} mm in the median (single precision), "
        f"{np.count_nonzero(off_mm > 0.1)} of {n} rays at edges by more than 0.1 mm"
    )


def rate(count: int, time_ms: float) -> str:
    return f"{count / time_ms / 1000.0:6.2f} M rays/s"


def main() -> int:
    scene, path = desk_view()
    origins_m, directions = rays(path)
    n = directions.shape[0] * directions.shape[1]
    ours_ms = best_ms(lambda: cast_fans(scene, origins_m, directions))
    print(f"MuJoCo, faces and exact depths              {ours_ms:9.2f} ms {rate(n, ours_ms)}")
    compare_with_open3d(scene, path, ours_ms)

    return report_effects(scene, path)


def report_effects(scene: Scene, path: ViewPath) -> int:
    """Print what a scan costs and each effect's share; 1 when it takes longer than it may."""
    sensors = {
        name: Jupiter(JupiterParams(noise=noise))
        for name, noise in {
            "none": NoiseParams.exact(),
            "all": NoiseParams(),
            **{effect: NoiseParams.only(effect) for effect in SWITCHES},
        }.items()
    }
    origins_m, directions = rays(path)
    actions: dict[str, Callable[[], object]] = {
        "cast": lambda: cast_fans(scene, origins_m, directions)
    }
    for name, sensor in sensors.items():
        actions[name] = partial(sensor.scan, scene, path, np.random.default_rng(0))
    # One of each in every round, so that what the machine does besides falls on all alike; a share
    # is the median over the rounds of the difference within one.
    rounds: dict[str, list[float]] = {name: [] for name in actions}
    for action in actions.values():
        action()
    for _ in range(REPEATS):
        for name, action in actions.items():
            start_s = time.process_time()
            action()
            rounds[name].append(1000.0 * (time.process_time() - start_s))
    times_ms = {name: np.array(times) for name, times in rounds.items()}
    all_ms = float(np.median(times_ms["all"]))
    parts_ms = {
        "casting the rays": float(np.median(times_ms["cast"])),
        "points of the scan": float(np.median(times_ms["none"] - times_ms["cast"])),
        **{name: float(np.median(times_ms[name] - times_ms["none"])) for name in SWITCHES},
    }
    print(f"\nA scan with all effects, medians of {REPEATS} rounds, shares by paired differences")
    for name, part_ms in parts_ms.items():
        print(f"  {name:42s}{part_ms:+9.2f} ms {100.0 * part_ms / all_ms:6.1f} %")
    rest_ms = all_ms - sum(parts_ms.values())
    shared = "all together, beyond the sum of each alone"
    print(f"  {shared:42s}{rest_ms:+9.2f} ms {100.0 * rest_ms / all_ms:6.1f} %")
    best_all_ms = float(times_ms["all"].min())
    verdict = "within" if best_all_ms <= LIMIT_MS else "OVER"
    print(
        f"scan with all effects, best                 {best_all_ms:9.2f} ms, {verdict} "
        f"{LIMIT_MS:g} ms; median {all_ms:.2f} ms"
    )
    return 0 if best_all_ms <= LIMIT_MS else 1


if __name__ == "__main__":
    raise SystemExit(main())
