from __future__ import annotations

import subprocess
import sys
from dataclasses import replace

import numpy as np
import pytest
from plane_scans import pose_error

from registration import METHODS, Scan, register
from registration.peers import PEERS, MissingPeerError, require
from registration.peers.entries import check_installed
from registration.peers.params import (
    FgrParams,
    IcpParams,
    KissMatcherParams,
    RansacParams,
    RefineParams,
)


@pytest.fixture(params=PEERS)
def peer(request: pytest.FixtureRequest) -> str:
    """The name of a peer that is installed; the extra `peers` is optional."""
    try:
        check_installed(request.param, PEERS[request.param].params_type())
    except MissingPeerError as error:
        pytest.skip(str(error))
    return request.param


def test_importing_registration_imports_no_peer() -> None:
    program = (
        "import sys, registration; "
        "print([m for m in ('open3d', 'kiss_matcher', 'small_gicp') if m in sys.modules])"
    )
    answer = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert answer.stdout.strip() == "[]", answer.stderr


def test_a_missing_library_is_one_line_with_the_way_out(monkeypatch, tmp_path) -> None:
    (tmp_path / "half_a_wheel.py").write_text(
        "raise ImportError('libusb-1.0.so.0: cannot open shared object file')", encoding="utf-8"
    )
    monkeypatch.syspath_prepend(tmp_path)
    with pytest.raises(MissingPeerError, match=r"half_a_wheel .* apt-get install libusb-1.0-0"):
        require("half_a_wheel")
    with pytest.raises(MissingPeerError, match=r"no_such_peer is not installed; .*\[peers\]"):
        require("no_such_peer")


def test_a_peer_that_is_missing_raises_when_called(monkeypatch, exact_pair) -> None:
    monkeypatch.setitem(sys.modules, "kiss_matcher", None)  # what Python takes for uninstalled
    with pytest.raises(MissingPeerError, match="pip install"):
        register(exact_pair.target, exact_pair.source, "kiss_matcher")


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: RansacParams(voxel_mm=0.0), "voxel_mm is 0.0; expected a number above 0"),
        (lambda: RansacParams(confidence=1.5), "confidence is 1.5"),
        (lambda: FgrParams(threads=0), "threads is 0"),
        (lambda: KissMatcherParams(voxel_mm=-1.0), "voxel_mm is -1.0"),
        (lambda: RefineParams(neighbours=2), "neighbours is 2"),
        (lambda: IcpParams(refine=RefineParams()), "refine.kind is 'none'"),
        (lambda: IcpParams(start="icp"), "start is 'icp'"),
    ],
)
def test_wrong_parameters_are_refused(make, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        make()


@pytest.mark.parametrize("valid", [0, 1, 20])
def test_too_few_points_come_back_with_a_reason(peer: str, valid: int, exact_pair) -> None:
    points_mm = np.full((10, 32, 3), np.nan)
    points_mm[5, :valid] = np.linspace([0.0, 0.0, 500.0], [0.0, 40.0, 540.0], valid)
    poor = Scan.from_points(points_mm, step_mm=5.0)
    for target, source in ((poor, exact_pair.source), (exact_pair.target, poor)):
        result = register(target, source, peer)
        assert (result.status, result.T_target_source) == ("failed", None)
        assert f"{valid} measured points" in result.reason


def test_scans_without_shape_never_raise(peer: str) -> None:
    line_mm = np.zeros((1, 200, 3))
    line_mm[0, :, 1:] = np.linspace([-100.0, 700.0], [100.0, 700.0], 200)
    scan = Scan.from_points(line_mm, step_mm=5.0)
    result = register(scan, scan, peer)
    assert result.status == "ok" or result.reason


def test_gicp_ends_at_the_truth_on_exact_scans(peer: str, exact_pair) -> None:
    gicp = RefineParams(kind="gicp", voxel_mm=4.0, reach_mm=40.0)
    params = replace(PEERS[peer].params_type(), refine=gicp)
    if peer == "icp":  # the identity is too far for it
        params = replace(params, start="gauss_sphere")
    result = register(exact_pair.target, exact_pair.source, peer, params)
    assert (result.status, result.reason) == ("ok", "")
    angle_deg, distance_mm = pose_error(result.T_target_source, exact_pair.T_target_source)
    assert angle_deg < 0.2
    assert distance_mm < 3.0
    assert {"gicp"} < result.stage_ms.keys()


def test_swapped_scans_give_the_inverse(peer: str, exact_pair) -> None:
    gicp = RefineParams(kind="gicp", voxel_mm=4.0, reach_mm=40.0)
    params = replace(PEERS[peer].params_type(), refine=gicp)
    if peer == "icp":
        params = replace(params, start="gauss_sphere")
    there = register(exact_pair.target, exact_pair.source, peer, params)
    back = register(exact_pair.source, exact_pair.target, peer, params)
    angle_deg, distance_mm = pose_error(back.T_target_source.inv(), there.T_target_source)
    assert angle_deg < 0.4
    assert distance_mm < 6.0


def test_one_thread_and_one_seed_give_one_answer(peer: str, noisy_pair) -> None:
    if peer == "kiss_matcher":
        pytest.skip("KISS-Matcher matches in parallel on every core and has no seed")
    first, second = (register(noisy_pair.target, noisy_pair.source, peer) for _ in range(2))
    np.testing.assert_array_equal(
        first.T_target_source.as_matrix(), second.T_target_source.as_matrix()
    )


def test_every_peer_is_a_method() -> None:
    for name, entry in PEERS.items():
        assert METHODS[name].function is entry.function
        assert METHODS[name].params_type is entry.params_type
