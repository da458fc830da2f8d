"""The library that a cluster takes, where it is not installed."""

from __future__ import annotations

import sys

import pytest

from harness.workers.cluster import ClusterError, cluster_pool


def test_a_missing_library_is_told_with_what_installs_it_beside_the_rest(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(sys.modules, "distributed", None)
    with pytest.raises(ClusterError, match=r"pip install -c constraints\.txt -e '\.\[cluster\]'"):
        cluster_pool("tcp://nowhere:1")
