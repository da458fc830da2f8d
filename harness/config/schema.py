"""What an experiment's file may say: its keys, their types and bounds."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import Discriminator, Field, Tag, model_validator

from harness.config.limits import NO_LIMITS, Limits
from harness.config.strict import Strict
from harness.config.sweep_schema import Sweep

MOST_PROFILES = 10_000
Length = Annotated[float, Field(gt=0.0)]
Angle = Annotated[float, Field(ge=-360.0, le=360.0)]
Vector = tuple[float, float, float]
# Those of sensors.paths, whose import would bring numba and the simulation: a file is read sooner.
Line = Literal["sensor_x", "vertical"]
Direction = Literal["up", "down"]
Angles = tuple[Angle, Angle, Angle]
RotationLabels = Literal["printed", "swapped", "cyclic"]
BeyondReach = Literal["refuse", "straight_line", "straight_line_unless_swapped"]
Truth = Literal["segments", "patches", "shared_patches", "rotation"]


class Choice(Strict):
    """An entry of a registry (SCENES, SENSORS) and its parameters, checked by its dataclass."""

    name: str
    params: dict[str, Any] = Field(default_factory=dict)


class MethodChoice(Choice):
    """A registration method; a preset of its parameters that `params` may refine.

    given: for method `thesis`, trials that enter the method with the truth in place of these
        stages, tabulated beside the full pipeline: exact segments, exact patches, exact patches
        cut to what both views see, or the exact rotation with the patches that were found.
    figures: whether to draw repeat 0 of each pair and write its clouds.
    optional: whether the run goes on without the method where its library is not installed.
    """

    preset: str | None = None
    label: Annotated[str, Field(min_length=1)] | None = None
    given: tuple[Truth, ...] = ()
    figures: bool = True
    optional: bool = False

    @property
    def called(self) -> str:
        """Its label, or its name where it has none."""
        return self.label or self.name


class ScanSize(Strict):
    """Profiles a view, and the sensor's motion between two of them."""

    profiles: int = Field(ge=1, le=MOST_PROFILES)
    step_mm: Length


class ScanLine(ScanSize):
    """How every view's line runs.

    line: along the sensor's own X, which the mounting tilts, or along the laboratory's vertical as
        in appendix B. direction: in which sense a vertical one is driven.
    low_mm, high_mm: instead of profiles, between which heights of the world the sensor's front
        moves on a vertical line; it begins at the low end and moves up, or at the high one, down.
    """

    line: Line = "sensor_x"
    direction: Direction = "up"
    low_mm: float | None = None
    high_mm: float | None = None

    @model_validator(mode="before")
    @classmethod
    def _counted(cls, data: Any) -> Any:
        """Count the profiles between the two heights, where all that takes is given."""
        if not isinstance(data, Mapping):
            return data
        ends = [data.get(key) for key in ("low_mm", "high_mm", "step_mm")]
        numbers = [value for value in ends if isinstance(value, int | float)]
        if len(numbers) < 3 or numbers[2] <= 0.0:
            return data
        try:
            low, high, step = (float(number) for number in numbers)
        except OverflowError:
            raise ValueError("low_mm, high_mm or step_mm is too large a number") from None
        if low >= high:
            raise ValueError(f"low_mm {low:g} should lie below high_mm {high:g}")
        steps = (high - low) / step
        if steps >= MOST_PROFILES:
            raise ValueError(
                f"from low_mm {low:g} to high_mm {high:g} in steps of {step:g} mm there are more "
                f"than {MOST_PROFILES} profiles"
            )
        count = int(steps + 1e-9) + 1
        given = data.get("profiles", count)
        if given != count:
            raise ValueError(
                f"profiles is {given}, but from low_mm {low:g} to high_mm {high:g} in steps of "
                f"{step:g} mm there are {count}; leave profiles out"
            )
        return {**data, "profiles": count}

    @model_validator(mode="after")
    def _fitting_together(self) -> ScanLine:
        if (self.low_mm is None) != (self.high_mm is None):
            raise ValueError("low_mm and high_mm belong together; one of them is missing")
        if self.line == "sensor_x":
            for name in ("low_mm", "direction"):
                if name in self.model_fields_set and getattr(self, name) not in (None, "up"):
                    raise ValueError(f"{name} is for vertical lines; add `line: vertical`")
        return self


class StartView(Strict):
    """A view by how the arm holds the sensor at the start, as appendix B's location `start`.

    joints_deg: the six joints. track_mm: where on the track the arm stands.
    """

    joints_deg: tuple[Angle, Angle, Angle, Angle, Angle, Angle]
    track_mm: float


class AimedView(Strict):
    """A view by what the middle of its line looks at."""

    aim_mm: Vector
    distance_mm: Length
    yaw_deg: Angle = 0.0
    pitch_deg: Angle = 0.0
    roll_deg: Angle = 0.0


class PlacedView(Strict):
    """A view placed so that the pose of a pair is the one printed for it, as commanded.

    beyond_reach: what becomes of the view where the arm cannot follow its line: the configuration
        is refused, or the sensor moves without an arm and the run says so. With
        straight_line_unless_swapped the latter holds for other readings of rotation_labels, which
        place a view where nobody drove an arm; swapped ones are refused.
    """

    placed_by: str
    beyond_reach: BeyondReach = "refuse"


class RelativeView(Strict):
    """A view by its pose in the frame of another: p_other = R p_this + T.

    rotation_deg: psi, phi, theta about the sensor's X, Y, Z, as in (4-6).
    """

    relative_to: str
    rotation_deg: Angles
    translation_mm: Vector


class NextView(Strict):
    """A view by what the arm does after another, as in appendix B: waist and track move, no more.

    waist_deg: turn of joint 1. track_mm: along the track.
    """

    next_of: str
    waist_deg: Angle = 0.0
    track_mm: float = 0.0


def _kind_of_view(data: Any) -> str:
    keys = data if isinstance(data, Mapping) else vars(data) if hasattr(data, "__dict__") else {}
    if "placed_by" in keys:
        return "placed"
    if "next_of" in keys:
        return "next"
    if "joints_deg" in keys:
        return "start"
    return "relative" if "relative_to" in keys else "aimed"


View = Annotated[
    Annotated[AimedView, Tag("aimed")]
    | Annotated[PlacedView, Tag("placed")]
    | Annotated[RelativeView, Tag("relative")]
    | Annotated[NextView, Tag("next")]
    | Annotated[StartView, Tag("start")],
    Discriminator(_kind_of_view),
]


class PrintedPose(Strict):
    """A pose as a table of the thesis prints it, the angles in the order of its labels X, Y, Z."""

    rotation_deg: Angles
    translation_mm: Vector


class Pair(Strict):
    """Two views to register; what the thesis printed for them, if it did.

    printed: its theoretical values. estimated: its experimental results.
    """

    source: str
    target: str
    printed: PrintedPose | None = None
    estimated: PrintedPose | None = None


class Compaction(Strict):
    """What the thesis counted in a view: measured points, patches, normals after merging."""

    points: int | None = None
    patches: int | None = None
    normals: int | None = None


class Experiment(Strict):
    """One experiment: a scene, a sensor, views, pairs of them, methods and repeats.

    compaction: by view, what the thesis counted in its own.
    arm: what carries the sensor, as ArmParams; null moves it exactly as commanded, without an arm.
    rotation_labels: how the labels of the printed angles are read (the tables 6.2 to 6.5 name
        another axis than the one that was turned): printed, swapped (X and Z) or cyclic.
    sweep: variants of all this; every trial is then done for each of its points.
    limits: what a trial may take; one that takes more becomes a row of status "error".
    """

    title: str
    description: str = ""
    scene: Choice
    sensor: Choice
    arm: dict[str, Any] | None = None
    scan: ScanLine
    rotation_labels: RotationLabels = "printed"
    views: dict[str, View] = Field(min_length=1)
    pairs: dict[str, Pair] = Field(min_length=1)
    compaction: dict[str, Compaction] = Field(default_factory=dict)
    methods: tuple[MethodChoice, ...] = Field(min_length=1)
    repeats: int = Field(default=1, ge=1, le=100_000)
    seed: int = Field(default=0, ge=0)
    sweep: Sweep | None = None
    limits: Limits = NO_LIMITS
