"""How long the arm needs for a viewing line of 130 profiles, from the choice of the track on.

python benchmarks/arm_lines.py
"""

from __future__ import annotations

import time

import numpy as np

from sensors import f3
from sensors.arm import ArmParams, solve_joints, viewing_line
from sensors.paths import aimed_view, straight_line

PROFILES, STEP_MM, REPEATS = 130, 3.0, 20


def best_ms(action) -> float:
    times_s = []
    for repeat in range(REPEATS):
        start_s = time.perf_counter()
        action(repeat)
        times_s.append(time.perf_counter() - start_s)
    return 1000.0 * min(times_s)


def main() -> None:
    view = aimed_view([0, 0, 120], 1030, 0, np.deg2rad(25), 0, PROFILES, STEP_MM)
    commanded = straight_line(view, PROFILES, STEP_MM).T_world_profile
    free, fixed = ArmParams(), ArmParams(track_mm=900.0)
    joints = solve_joints(commanded, free)
    rows = {
        "joints, track chosen among 53 positions": lambda _: solve_joints(commanded, free),
        "joints, track given": lambda _: solve_joints(commanded, fixed),
        "exact poses by the simulator": lambda _: f3.flange_by_simulator(joints),
        "poses by the encoders": lambda _: f3.flange_by_controller(joints),
        "contact of the arm with itself": lambda _: f3.self_contact(joints),
        "whole line": lambda repeat: viewing_line(view, PROFILES, STEP_MM, free, seed=1 + repeat),
        "whole line, remembered": lambda _: viewing_line(view, PROFILES, STEP_MM, free, seed=1),
    }
    for name, action in rows.items():
        print(f"{name:42s} {best_ms(action):7.2f} ms")


if __name__ == "__main__":
    main()
