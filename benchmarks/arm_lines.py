"""How long the arm needs for a viewing line of 130 profiles, and the same line by mink.

python benchmarks/arm_lines.py

mink is optional: pip install mink daqp.
"""

from __future__ import annotations

import time
from collections.abc import Callable

import numpy as np
from scipy.spatial.transform import RigidTransform

from sensors import f3
from sensors.arm import TOOL_CENTRE_POINT, ArmParams, solve_joints, viewing_line
from sensors.paths import aimed_view, straight_line

PROFILES, STEP_MM, REPEATS = 130, 3.0, 20
MINK_STEPS, MINK_STEP_S = 50, 1.0  # of its differential steps, at most, for each profile
MINK_CLOSE_MM, MINK_CLOSE_DEG = 0.01, 0.001


def best_ms(action: Callable[[int], object], repeats: int = REPEATS) -> float:
    times_s = []
    for repeat in range(repeats):
        start_s = time.perf_counter()
        action(repeat)
        times_s.append(time.perf_counter() - start_s)
    return 1000.0 * min(times_s)


def off_by(joints: np.ndarray, T_base_flange: RigidTransform) -> tuple[float, float]:
    """Farthest that the flange comes from where it should be, mm and deg, before any rounding."""
    off = T_base_flange.inv() * f3.flange_by_simulator(joints)
    distances_mm = np.linalg.norm(off.translation, axis=1)
    return float(distances_mm.max()), float(np.rad2deg(off.rotation.magnitude().max()))


def joints_by_mink(T_base_flange: RigidTransform, start: np.ndarray) -> np.ndarray:
    """Joint values (profiles, 7) by mink's differential steps within the limits, track held.

    start: (7,) joint values near the first profile.
    """
    import mink

    model = f3.model_spec().compile()
    configuration = mink.Configuration(model)
    configuration.update(f3.to_qpos(start))
    task = mink.FrameTask("flange", "body", position_cost=1.0, orientation_cost=1.0)
    held = mink.DofFreezingTask(model, dof_indices=[0])
    limits = [mink.ConfigurationLimit(model)]
    found = np.empty((len(T_base_flange), 7))
    for k, matrix in enumerate(T_base_flange.as_matrix()):
        matrix[:3, 3] /= 1000.0
        task.set_target(mink.SE3.from_matrix(matrix))
        for _ in range(MINK_STEPS):
            error = task.compute_error(configuration)
            far_mm, far_deg = 1000.0 * np.linalg.norm(error[:3]), np.rad2deg(error[3:])
            if far_mm < MINK_CLOSE_MM and np.linalg.norm(far_deg) < MINK_CLOSE_DEG:
                break
            velocity = mink.solve_ik(
                configuration, [task], MINK_STEP_S, "daqp", limits=limits, constraints=[held]
            )
            configuration.integrate_inplace(velocity, MINK_STEP_S)
        found[k] = configuration.q / f3.to_qpos(np.ones(7))
    return found


def compare_with_mink(T_base_flange: RigidTransform, joints: np.ndarray) -> None:
    try:
        import mink  # noqa: F401 - only whether it is there
    except ImportError as error:
        print(f"mink cannot be imported ({error}): pip install mink daqp")
        return
    theirs = joints_by_mink(T_base_flange, joints[0] + [0.0, *[0.02] * 6])
    time_ms = best_ms(lambda _: joints_by_mink(T_base_flange, joints[0] + [0.0, *[0.02] * 6]), 3)
    apart_deg = np.rad2deg(np.abs(theirs - joints)[:, 1:].max())
    print(f"{'joints by mink, track and start given':42s} {time_ms:7.2f} ms")
    for name, values in (("closed form", joints), ("mink", theirs)):
        far_mm, far_deg = off_by(values, T_base_flange)
        print(f"  {name:40s} {far_mm:9.1e} mm {far_deg:9.1e} deg off, at most")
    print(f"  joints differ by at most {apart_deg:.1e} deg; an encoder count is 1.8e-03 to 2.2e-03")


def main() -> None:
    view = aimed_view([0, 0, 120], 1030, 0, np.deg2rad(25), 0, PROFILES, STEP_MM)
    commanded = straight_line(view, PROFILES, STEP_MM).T_world_profile
    free, fixed = ArmParams(), ArmParams(track_mm=900.0)
    joints = solve_joints(commanded, free)
    rows: dict[str, Callable[[int], object]] = {
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
    compare_with_mink(free.T_world_base.inv() * commanded * TOOL_CENTRE_POINT.inv(), joints)


if __name__ == "__main__":
    main()
