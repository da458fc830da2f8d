"""At which stage a trial failed, where its answer or its sibling trials tell."""

from __future__ import annotations

from collections.abc import Mapping

# What the reasons of the methods say, and the stage it was said at; the first that fits.
SAID_BY = (
    ("no measured point", "scan"),
    ("measured points;", "scan"),
    ("no straight segment", "line segments"),
    ("but no patch", "patches"),
    ("has no patches", "patches"),
    ("no plane found", "patches"),
    ("planes of one direction", "scene: it leaves a motion open"),
    ("triplets of normals", "rotation"),
    ("subtend the angle", "rotation"),
    ("normals of the best rotation", "rotation"),
    ("another rotation", "rotation"),
    ("not coplanar", "rotation"),
    ("densest intervals", "translation"),
    ("agree on a translation", "translation"),
    ("lays two planes", "translation"),
    ("the best pose lays only", "verification"),
    ("seen to be empty", "verification"),
    ("as planes of unrelated scenes", "verification"),
    ("fit about equally well", "decision: more than one pose fits"),
)

# A wrong answer that the truth in place of one stage's result puts right was that stage's fault.
MENDED_BY = (
    ("rotation", "rotation"),
    ("segments", "line segments"),
    ("patches", "patches"),
    ("shared_patches", "patches: each view sees another part of them"),
)


def stage_at_fault(status: str, reason: str, mended: Mapping[str, bool]) -> str:
    """The stage, or "" where nothing tells.

    status, reason: of the trial. mended: by what was given as the truth, whether the same trial
    then succeeded.
    """
    if status == "error":
        return "program"
    if status == "no_overlap":
        return "views: they share nothing"
    for words, stage in SAID_BY:
        if words in reason:
            return stage
    if status == "underdetermined":
        return "scene: it leaves a motion open"
    for given, stage in MENDED_BY:
        if mended.get(given):
            return stage
    if mended:
        return "more than one stage" if status == "ok" else ""
    return ""
