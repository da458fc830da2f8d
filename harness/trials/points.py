"""The points of a sweep: what each of them changes in the configuration."""

from __future__ import annotations

import json
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.config.sweep_schema import LISTING, AnyOf, Between, Named, Normal, Range, Sweep
from harness.trials.lazy import Lazy
from registration.scan import FloatArray

Entries = Sequence[tuple[Any, Any]]  # values, each with what a table calls it

MOST_POINTS = 1_000_000
# Quantiles 0 and 1 of an unbounded distribution are infinite; a sequence may begin with them.
EDGE = 1e-9


@dataclass(frozen=True)
class Point:
    """One variant of an experiment.

    number: its place in the design. varied: for one_at_a_time, the key that differs from the
        experiment, "" for the experiment itself; for other designs "".
    values: by dotted key, what the key is set to. shown: by dotted key, what a table calls it.
    """

    number: int
    varied: str
    values: dict[str, Any]
    shown: dict[str, Any]

    def __str__(self) -> str:
        """What is set here, each key by its short name."""
        names = short_names(self.shown)
        shown = [key for key in self.shown if self.varied in ("", key)]
        return ", ".join(f"{names[key]} {_short(self.shown[key])}" for key in shown)


def short_names(keys: Iterable[str]) -> dict[str, str]:
    """By key, as many of its last parts as tell it from the other keys, and what it is.

    The number of an entry, or the name of what is chosen, says nothing without what it is of.
    """
    names, known = {}, list(keys)
    for key in known:
        parts = key.split(".")
        least = 2 if parts[-1].isdecimal() or parts[-1] == "name" else 1
        tails = (".".join(parts[-length:]) for length in range(least, len(parts) + 1))
        names[key] = next(
            (tail for tail in tails if sum(f".{k}".endswith(f".{tail}") for k in known) == 1), key
        )
    return names


def point_count(sweep: Sweep) -> int:
    """How many points a sweep has; those of a product are not made for it."""
    keys = len(sweep.over)
    if sweep.design not in LISTING:
        samples = sweep.samples or 0
        each = {"saltelli": (2 if sweep.second_order else 1) * keys + 2, "morris": keys + 1}
        return samples * each.get(sweep.design, 1)
    counts = [len(_listed(values)) for values in sweep.over.values()]
    if sweep.design == "product":
        return math.prod(counts)
    return 1 + sum(counts) if sweep.design == "one_at_a_time" else max(counts)


def sweep_points(sweep: Sweep) -> Sequence[Point]:
    """The points of a sweep in their order; raises ValueError for a zip of unequal lengths."""
    if sweep.design == "one_at_a_time":
        changes = [(k, *entry) for k, values in sweep.over.items() for entry in _listed(values)]

        def changed(number: int) -> Point:
            if number == 0:
                return Point(0, "", {}, {})
            key, value, shown = changes[number - 1]
            return Point(number, key, {key: value}, {key: shown})

        return Lazy(1 + len(changes), changed)
    settings = _settings(sweep)

    def point(number: int) -> Point:
        pairs = dict(zip(sweep.over, settings[number], strict=True))
        return Point(
            number,
            "",
            {key: value for key, (value, _) in pairs.items()},
            {key: shown for key, (_, shown) in pairs.items()},
        )

    return Lazy(len(settings), point)


def salib_problem(sweep: Sweep) -> dict[str, Any]:
    """The problem that SALib's samplers and analysers want; its cube is that of unit_design."""
    keys = list(sweep.over)
    return {"num_vars": len(keys), "names": keys, "bounds": [[0.0, 1.0]] * len(keys)}


def unit_design(sweep: Sweep) -> FloatArray:
    """(points, keys) what a drawing design draws, in the unit cube, in the order of the points.

    The values of a point are these quantiles of the keys' distributions.
    """
    from SALib.sample import latin, morris, sobol  # they bring half of scipy.stats
    from scipy.stats import qmc

    problem, samples = salib_problem(sweep), sweep.samples or 0
    if sweep.design == "latin_hypercube":
        drawn = latin.sample(problem, samples, seed=sweep.seed)
    elif sweep.design == "saltelli":
        second = sweep.second_order
        drawn = sobol.sample(problem, samples, calc_second_order=second, seed=sweep.seed)
    elif sweep.design == "morris":
        drawn = morris.sample(problem, samples, num_levels=sweep.levels, seed=sweep.seed)
    else:
        drawn = qmc.Sobol(len(sweep.over), rng=np.random.default_rng(sweep.seed)).random(samples)
    return np.asarray(drawn, dtype=np.float64)


def _settings(sweep: Sweep) -> Sequence[Sequence[tuple[Any, Any]]]:
    """For each point the value of every key, and what a table calls it."""
    if sweep.design in LISTING:
        lists: dict[str, Entries] = {key: _listed(values) for key, values in sweep.over.items()}
    else:
        design = unit_design(sweep)
        columns = zip(sweep.over.items(), design.T, strict=True)
        lists = {key: _drawn(values, quantiles) for (key, values), quantiles in columns}
    lengths = {key: len(entries) for key, entries in lists.items()}
    if sweep.design == "product":
        return Lazy(math.prod(lengths.values()), lambda n: _combined(list(lists.values()), n))
    if len(set(lengths.values())) > 1:
        told = ", ".join(f"{key} has {length}" for key, length in lengths.items())
        raise ValueError(f"design zip needs as many values of every key; {told}")
    return Lazy(min(lengths.values()), lambda n: [entries[n] for entries in lists.values()])


def _combined(lists: Sequence[Entries], number: int) -> list[tuple[Any, Any]]:
    """One element of the product of lists, of which the last varies fastest."""
    chosen = []
    for entries in reversed(lists):
        number, place = divmod(number, len(entries))
        chosen.append(entries[place])
    return chosen[::-1]


def _listed(values: Any) -> list[tuple[Any, Any]]:
    if isinstance(values, Named):
        return [(value, name) for name, value in values.named.items()]
    entries = _range(values) if isinstance(values, Range) else values
    return [(value, shown_value(value)) for value in entries]


def _range(values: Range) -> list[Any]:
    spaced = np.geomspace if values.scale == "log" else np.linspace
    numbers = spaced(values.low, values.high, values.count)
    whole = isinstance(values.low, int) and isinstance(values.high, int)
    if values.integers or (whole and (numbers == np.round(numbers)).all()):
        return list(dict.fromkeys(int(number) for number in np.round(numbers)))
    # 0.30000000000000004 is what nobody asked for.
    return [float(f"{number:.12g}") for number in numbers.tolist()]


def _drawn(values: Any, quantiles: FloatArray) -> Entries:
    """The values of one key at these quantiles of its distribution."""
    if isinstance(values, Between):
        low, high = float(values.low), float(values.high)
        if values.distribution == "integers":
            steps = np.floor(quantiles * (high - low + 1.0)).astype(np.int64)
            return _numbers(np.minimum(int(low) + steps, int(high)))
        if values.distribution == "log_uniform":
            return _numbers(low * (high / low) ** quantiles)
        return _numbers(low + (high - low) * quantiles)
    if isinstance(values, Normal):
        from scipy.stats import truncnorm

        low = -np.inf if values.low is None else (values.low - values.mean) / values.deviation
        high = np.inf if values.high is None else (values.high - values.mean) / values.deviation
        least, most = (
            (0.0 if np.isfinite(low) else EDGE),
            (1.0 if np.isfinite(high) else 1.0 - EDGE),
        )
        standard = truncnorm.ppf(np.clip(quantiles, least, most), low, high)
        return _numbers(values.mean + values.deviation * standard)
    entries = _listed(values.values if isinstance(values, AnyOf) else values)
    which = np.minimum((quantiles * len(entries)).astype(np.int64), len(entries) - 1)
    return Lazy(len(which), lambda n: entries[which[n]])


def _numbers(drawn: NDArray[Any]) -> Entries:
    return Lazy(len(drawn), lambda n: (drawn[n].item(), drawn[n].item()))


def _short(value: Any) -> str:
    return f"{value:.4g}" if isinstance(value, float) else str(value)


def shown_value(value: Any) -> Any:
    """What a table calls a value: itself, or its JSON when it is no plain number or word."""
    if value is None or isinstance(value, str | int | float):
        return value
    return json.dumps(value, separators=(", ", ": "))
