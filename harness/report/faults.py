"""At which stage a trial failed, where its answer or its sibling trials tell."""

from __future__ import annotations

from collections.abc import Mapping

# What a reader is told of the stages that results name; others stand as they are.
TOLD = {
    "segments": "line segments",
    "scene": "scene: it leaves a motion open",
    "decision": "decision: more than one pose fits",
}

# A wrong answer that the truth in place of one stage's result puts right was that stage's fault.
MENDED_BY = (
    ("rotation", "rotation"),
    ("segments", "line segments"),
    ("patches", "patches"),
    ("shared_patches", "patches: each view sees another part of them"),
)


def stage_at_fault(status: str, stage: str, mended: Mapping[str, bool]) -> str:
    """The stage, or "" where nothing tells.

    status, stage: of the trial; stage is where the method says that it stopped, or "". mended: by
    what was given as the truth, whether the same trial then succeeded.
    """
    if status == "error":
        return "program"
    if status == "no_overlap":
        return "views: they share nothing"
    if stage:
        return TOLD.get(stage, stage)
    if status == "underdetermined":
        return TOLD["scene"]
    for given, named in MENDED_BY:
        if mended.get(given):
            return named
    if mended:
        return "more than one stage" if status == "ok" else ""
    return ""
