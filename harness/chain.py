"""Poses of many views in the frame of one, by following the pairs that link them."""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterable, Sequence
from typing import NamedTuple

from scipy.spatial.transform import RigidTransform


class Link(NamedTuple):
    """The pose of one view in the frame of another, mm."""

    target: str
    source: str
    T_target_source: RigidTransform


def middle_view(links: Iterable[Link], names: Sequence[str]) -> str:
    """The view with the most links, the first of the names among equals."""
    counts = Counter(view for link in links for view in (link.target, link.source))
    return max(names, key=lambda name: counts[name])


def poses_in(reference: str, links: Sequence[Link]) -> dict[str, RigidTransform]:
    """T_reference_view of every view that a chain of links leads to, by the shortest chain.

    Errors add up along a chain; loops are not closed.
    """
    poses = {reference: RigidTransform.identity()}
    frontier = [reference]
    while frontier:
        reached: list[str] = []
        for here in frontier:
            for target, source, T_target_source in links:
                if here == target and source not in poses:
                    poses[source] = poses[here] * T_target_source
                    reached.append(source)
                elif here == source and target not in poses:
                    poses[target] = poses[here] * T_target_source.inv()
                    reached.append(target)
        frontier = reached
    return poses
