"""What is scanned: scenes by name."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from scenes.clutter import ClutterParams, clutter
from scenes.desk import DeskParams, desk
from scenes.flat_target import FlatTargetParams, flat_target
from scenes.foam_chair import FoamChairParams, foam_chair
from scenes.scene import Scene
from scenes.separated_planes import SeparatedPlanesParams, separated_planes


class SceneEntry(NamedTuple):
    """A scene: builder(params) makes it, params of type params_type; equal params, equal scene."""

    builder: Callable[[Any], Scene]
    params_type: type


SCENES: dict[str, SceneEntry] = {
    "desk": SceneEntry(desk, DeskParams),
    "foam_chair": SceneEntry(foam_chair, FoamChairParams),
    "flat_target": SceneEntry(flat_target, FlatTargetParams),
    "clutter": SceneEntry(clutter, ClutterParams),
    "separated_planes": SceneEntry(separated_planes, SeparatedPlanesParams),
}
