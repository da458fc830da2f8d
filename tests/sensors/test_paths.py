import numpy as np
import pytest
from scipy.spatial.transform import RigidTransform, Rotation

from sensors.paths import ViewPath, aimed_view, straight_line


def _axes(yaw_deg: float = 0.0, pitch_deg: float = 0.0, roll_deg: float = 0.0) -> np.ndarray:
    """Rows: the sensor's X, Y and Z in the world."""
    angles_rad = np.radians([yaw_deg, pitch_deg, roll_deg])
    return aimed_view([0.0, 0.0, 0.0], 1000.0, *angles_rad, 2, 5.0).rotation.as_matrix().T


def test_an_unturned_view_looks_along_x_with_its_own_x_up_and_y_to_the_right() -> None:
    assert _axes() == pytest.approx(
        np.array([[0.0, 0.0, 1.0], [0.0, -1.0, 0.0], [1.0, 0.0, 0.0]]), abs=1e-15
    )


def test_the_signs_of_the_angles() -> None:
    yawed, pitched, rolled = _axes(yaw_deg=30.0), _axes(pitch_deg=20.0), _axes(roll_deg=10.0)
    assert yawed[2] == pytest.approx([np.cos(np.pi / 6), 0.5, 0.0])
    assert pitched[2] == pytest.approx([np.cos(np.pi / 9), 0.0, -np.sin(np.pi / 9)])
    # The line of motion is tilted along: up, and forward by the sine of the pitch.
    assert pitched[0] == pytest.approx([np.sin(np.pi / 9), 0.0, np.cos(np.pi / 9)])
    assert rolled[2] == pytest.approx([1.0, 0.0, 0.0])
    assert rolled[0] @ _axes()[1] == pytest.approx(np.sin(np.pi / 18))


@pytest.mark.parametrize(("profiles", "step_mm"), [(1, 5.0), (40, 5.0), (131, 3.0)])
def test_the_middle_of_the_line_looks_at_the_aim(profiles: int, step_mm: float) -> None:
    rng = np.random.default_rng(1)
    aim_mm, angles_rad = rng.uniform(-300.0, 300.0, 3), rng.uniform(-1.0, 1.0, 3)
    T_world_view = aimed_view(aim_mm, 870.0, *angles_rad, profiles, step_mm)
    path = straight_line(T_world_view, profiles, step_mm)
    ends = path.T_world_profile.translation[[0, -1]]
    Z = path.T_world_view.rotation.as_matrix()[:, 2]
    assert ends.mean(axis=0) + 870.0 * Z == pytest.approx(aim_mm, abs=1e-9)


def test_profile_k_lies_at_k_steps_along_the_own_x() -> None:
    rng = np.random.default_rng(2)
    T_world_view = RigidTransform.from_components(
        rng.uniform(-900.0, 900.0, 3), Rotation.random(rng=rng)
    )
    path = straight_line(T_world_view, 130, 3.0)
    T_view_profile = path.T_world_view.inv() * path.T_world_profile
    expected = np.zeros((130, 3))
    expected[:, 0] = 3.0 * np.arange(130)
    assert path.profiles == 130
    assert T_view_profile.translation == pytest.approx(expected, abs=1e-9)
    assert T_view_profile.rotation.magnitude() == pytest.approx(0.0, abs=1e-12)
    assert path.T_world_view.as_matrix() == pytest.approx(T_world_view.as_matrix(), abs=1e-12)


def test_impossible_paths_are_refused() -> None:
    here = RigidTransform.identity()
    with pytest.raises(ValueError, match="profiles is 0; expected at least 1"):
        straight_line(here, 0, 5.0)
    for step_mm in (0.0, -3.0, np.nan):
        with pytest.raises(ValueError, match="expected a length above 0 mm"):
            straight_line(here, 10, step_mm)
    with pytest.raises(ValueError, match="expected one a profile"):
        ViewPath(here, 5.0)
