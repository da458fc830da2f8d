"""What the file of an experiment on random pairs of views may say."""

from __future__ import annotations

from itertools import pairwise
from typing import Annotated, Literal

from pydantic import Field, model_validator

from harness.config.limits import NO_LIMITS, Limits
from harness.config.schema import Angle, Choice, Length, MethodChoice, ScanSize, Vector
from harness.config.strict import Strict
from harness.config.study_schema import Study
from harness.config.sweep_schema import Sweep

KIND = "random_pairs"
Share = Annotated[float, Field(ge=0.0, le=1.0)]
Spread = Annotated[float, Field(ge=0.0, le=180.0)]


class Family(Strict):
    """Pairs of views of one scene, or of one kind of scene.

    pairs: how many. new_scene: whether each pair has a scene of its own, by drawing the `seed` of
        the scene's parameters.
    aim_mm: what the middle of a viewing line looks at, give or take aim_within_mm along each axis
        of the world. distance_mm: least and largest distance from it.
    pitch_deg: the sensor's mounting.
    """

    scene: Choice
    pairs: Annotated[int, Field(ge=1, le=100_000)]
    new_scene: bool = False
    aim_mm: Vector
    aim_within_mm: Annotated[float, Field(ge=0.0)] = 0.0
    distance_mm: tuple[Length, Length]
    pitch_deg: Angle = 0.0

    @model_validator(mode="after")
    def _in_order(self) -> Family:
        if self.distance_mm[0] > self.distance_mm[1]:
            raise ValueError("distance_mm should hold the least, then the largest distance")
        return self


class RandomPairsExperiment(Strict):
    """Random convergent pairs of views, each with enough overlap, and the methods to compare.

    heading_within_deg: the mean yaw of a pair lies this close to 0.
    yaw_within_deg: the yaws of a pair differ by up to this.
    pitch_within_deg, roll_within_deg: of each view, about the mounting pitch and about 0.
    overlap: ends of ranges of overlap, the smaller of the two views' shares of points that the
        other sees; pairs take turns between the ranges, so that each has as many, and are drawn
        again until they lie in theirs.
    drawn_for: the scan by which pairs are drawn and their overlap is judged, `scan` when not given.
        Where `scan` is swept it keeps the pairs the same.
    study: the question that the sweep or the methods answer, and how it is drawn.
    sweep: variants of all this; every trial is then done for each of its points.
    limits: what a trial may take; one that takes more becomes a row of status "error".
    """

    experiment: Literal["random_pairs"]
    title: str
    description: str = ""
    sensor: Choice
    scan: ScanSize
    drawn_for: ScanSize | None = None
    families: dict[str, Family] = Field(min_length=1)
    heading_within_deg: Spread = 10.0
    yaw_within_deg: Spread = 40.0
    pitch_within_deg: Spread = 10.0
    roll_within_deg: Spread = 10.0
    overlap: Annotated[tuple[Share, ...], Field(min_length=2)] = (0.2, 1.0)
    methods: tuple[MethodChoice, ...] = Field(min_length=1)
    seed: int = Field(default=0, ge=0)
    study: Study | None = None
    sweep: Sweep | None = None
    limits: Limits = NO_LIMITS

    @model_validator(mode="after")
    def _in_order(self) -> RandomPairsExperiment:
        if any(low >= high for low, high in pairwise(self.overlap)):
            raise ValueError("overlap should hold shares in rising order, the least first")
        if self.study is not None:
            self.study.check(self.sweep)
        return self
