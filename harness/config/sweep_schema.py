"""What the key `sweep` of an experiment may say: the keys, their values and the design."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Annotated, Any, Literal

from pydantic import AfterValidator, Discriminator, Field, Tag, model_validator

from harness.config.strict import Strict

Design = Literal[
    "product", "zip", "one_at_a_time", "latin_hypercube", "sobol", "saltelli", "morris"
]
# Designs that go through the values that are listed; the others draw from distributions.
LISTING: tuple[Design, ...] = ("product", "zip", "one_at_a_time")
POWER_OF_TWO: tuple[Design, ...] = ("sobol", "saltelli")

EXACT, LARGEST = 2**53, 1e300  # whole numbers that a double holds, and where sums stay finite


def _calculable(number: int | float) -> int | float:
    most = EXACT if isinstance(number, int) else LARGEST
    if abs(number) > most:
        shown = f"{most:g}" if isinstance(number, float) else f"2**53 = {most}"
        raise ValueError(f"should lie within {shown} of 0")
    return number


Number = Annotated[int | float, AfterValidator(_calculable)]
From = Annotated[Number, Field(alias="from")]
To = Annotated[Number, Field(alias="to")]


class Range(Strict):
    """So many values from one number to another, both included, in equal steps or equal ratios.

    integers: whether to round them, as for a number of profiles; equal ones count once.
    """

    low: From
    high: To
    count: int = Field(ge=1, le=1_000_000)
    scale: Literal["linear", "log"] = "linear"
    integers: bool = False

    @model_validator(mode="after")
    def _logarithm(self) -> Range:
        if self.scale == "log" and not (self.low > 0 and self.high > 0):
            raise ValueError("a logarithmic range should lie above 0")
        return self


class Named(Strict):
    """Values under names of their own, for those that are no plain numbers or words."""

    named: dict[str, Any] = Field(min_length=1)


class Between(Strict):
    """A number drawn between two, evenly, evenly in its logarithm, or of the whole numbers."""

    distribution: Literal["uniform", "log_uniform", "integers"]
    low: From
    high: To

    @model_validator(mode="after")
    def _in_order(self) -> Between:
        if not self.low < self.high:
            raise ValueError("`from` should be less than `to`")
        if self.distribution == "log_uniform" and not self.low > 0:
            raise ValueError("log_uniform should lie above 0")
        if self.distribution == "integers" and not (
            isinstance(self.low, int) and isinstance(self.high, int)
        ):
            raise ValueError("`from` and `to` of integers should be whole numbers")
        return self


class Normal(Strict):
    """A number drawn from a normal distribution, cut off where `from` or `to` says so."""

    distribution: Literal["normal"]
    mean: Number
    deviation: Annotated[Number, Field(gt=0.0)]
    low: Annotated[Number | None, Field(alias="from")] = None
    high: Annotated[Number | None, Field(alias="to")] = None

    @model_validator(mode="after")
    def _in_order(self) -> Normal:
        if self.low is not None and self.high is not None and not self.low < self.high:
            raise ValueError("`from` should be less than `to`")
        return self


class AnyOf(Strict):
    """One of several values, each as likely as the others."""

    distribution: Literal["choice"]
    values: tuple[Any, ...] = Field(min_length=1)


def _kind_of_values(data: Any) -> str:
    if isinstance(data, Strict):
        return type(data).__name__.lower()
    if not isinstance(data, Mapping):
        return "list"  # a lone value gets told that it should be one
    if "named" in data:
        return "named"
    if "distribution" not in data:
        return "range"
    return {"normal": "normal", "choice": "anyof"}.get(str(data["distribution"]), "between")


Values = Annotated[
    Annotated[tuple[Any, ...], Field(min_length=1), Tag("list")]
    | Annotated[Range, Tag("range")]
    | Annotated[Named, Tag("named")]
    | Annotated[Between, Tag("between")]
    | Annotated[Normal, Tag("normal")]
    | Annotated[AnyOf, Tag("anyof")],
    Discriminator(_kind_of_values),
]


class Sweep(Strict):
    """Many variants of one experiment, each with some keys changed.

    over: by dotted key, as for --set (a method also by its label), the values it takes. A list; a
        range {from, to, count, scale: linear or log, integers}; {named: {name: value}}; or a
        distribution {distribution: uniform, log_uniform or integers, from, to}, {distribution:
        normal, mean, deviation, from, to}, {distribution: choice, values}.
    design: product takes every combination, the last key fastest; zip the first values of all keys
        together, then the second ones; one_at_a_time the experiment itself, then each key's values
        with all others as they are. The other designs draw `samples` points, of a list or of named
        values each as likely as the others: latin_hypercube; sobol, the scrambled Sobol' sequence;
        saltelli, samples x (keys + 2) points for Sobol' indices, samples x (2 keys + 2) with
        second_order; morris, samples trajectories of keys + 1 points on a grid of `levels`.
    along: by a key of `over`, other keys that take its value at every point, for one quantity that
        a configuration holds in several places.
    seed: of the design; that of the trials is the experiment's.
    """

    design: Design = "product"
    over: dict[str, Values] = Field(min_length=1)
    along: dict[str, tuple[str, ...]] = Field(default_factory=dict)
    samples: Annotated[int, Field(ge=1, le=1_000_000)] | None = None
    levels: int = Field(default=4, ge=2, le=100)
    second_order: bool = False
    seed: int = Field(default=0, ge=0, lt=2**32)

    @model_validator(mode="after")
    def _goes_along(self) -> Sweep:
        taken = list(self.over)
        for key, others in self.along.items():
            if key not in self.over:
                known = ", ".join(self.over)
                raise ValueError(f"`along` names {key}, which is not swept; `over` has {known}")
            for other in others:
                if other in taken:
                    raise ValueError(f"{other} is swept twice, once `along` with {key}")
                taken.append(other)
        return self

    @model_validator(mode="after")
    def _fits_the_design(self) -> Sweep:
        if self.design in LISTING:
            if self.samples is not None:
                raise ValueError(f"`samples` says nothing to design {self.design}")
            for key, values in self.over.items():
                if isinstance(values, Between | Normal | AnyOf):
                    raise ValueError(
                        f"design {self.design} needs a list, a range or named values of {key}, "
                        "not a distribution"
                    )
            return self
        if self.samples is None:
            raise ValueError(f"design {self.design} needs `samples`")
        if self.design in POWER_OF_TWO and self.samples & (self.samples - 1):
            raise ValueError(
                f"`samples` of design {self.design} should be a power of two, not {self.samples}"
            )
        if self.design == "morris" and self.levels % 2:
            raise ValueError(f"`levels` of design morris should be even, not {self.levels}")
        for key, values in self.over.items():
            if isinstance(values, Range):
                raise ValueError(
                    f"design {self.design} needs a list, named values or a distribution of {key}, "
                    "not a range with a count"
                )
            open_ended = isinstance(values, Normal) and None in (values.low, values.high)
            if self.design == "morris" and open_ended:
                raise ValueError(f"design morris needs `from` and `to` of the normal {key}")
        return self
