"""The options of the command `run-experiment`."""

from __future__ import annotations

import argparse
from pathlib import Path

DESCRIPTION = """\
Run an experiment: scan a scene in simulation, register pairs of views, score the estimates against
the exact poses, and write rows, tables, figures and point clouds to a results folder. A run that
was cut off goes on where it stopped; rows that are there are reused."""

EXAMPLES = """\
examples:
  run-experiment configs/desk.yaml
  run-experiment configs/desk.yaml --set scan.profiles=60 --set repeats=1 --out results/short
  run-experiment configs/desk.yaml --set pairs.6.4.source=right --dry-run
  run-experiment --list
  run-experiment --show-scene desk
  run-experiment --register left.3dx right.3dx --step 5
  run-experiment --compare results/before results/after

exit status: 0 done, 1 when trials ended with an error or --register found no sure pose, 2 when the
request is wrong (nothing is written then) or the results folder cannot be used, 130 when
interrupted."""


def make_parser() -> argparse.ArgumentParser:
    """The parser of the command line; its errors exit with status 2."""
    parser = argparse.ArgumentParser(
        prog="run-experiment",
        description=DESCRIPTION,
        epilog=EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
        allow_abbrev=False,
    )
    parser.add_argument("config", nargs="?", type=Path, metavar="CONFIG", help="a YAML file")
    parser.add_argument(
        "--set",
        action="append",
        default=[],
        metavar="KEY=VALUE",
        help="change one key of the config, dotted, the value in YAML; may be repeated",
    )
    parser.add_argument(
        "--out", type=Path, metavar="DIR", help="results folder [results/<name of the config>]"
    )
    parser.add_argument("--seed", type=_natural, metavar="N", help="replaces the config's seed")
    parser.add_argument(
        "--workers", type=_positive, metavar="N", help="processes [one for each core]"
    )
    parser.add_argument(
        "--scheduler",
        metavar="ADDRESS",
        help="compute on the workers of this Dask scheduler, as tcp://host:8786",
    )
    what = parser.add_mutually_exclusive_group()
    what.add_argument(
        "--report-only",
        action="store_true",
        help="compute no rows: build tables, figures and clouds again from those at hand",
    )
    what.add_argument(
        "--dry-run",
        action="store_true",
        help="check the config, count the trials and estimate the time; write nothing",
    )
    what.add_argument(
        "--export",
        type=Path,
        metavar="FILE",
        help="compute nothing: write the rows at hand of CONFIG to FILE, .parquet or .csv",
    )
    what.add_argument("--trial", metavar="ID", help="replay one trial, print it, write nothing")
    what.add_argument("--list", action="store_true", help="list the configs, one line each")
    what.add_argument(
        "--show-scene",
        metavar="NAME",
        help="save a picture of a scene to results/scenes or DIR; with CONFIG, that of its scene "
        "and views",
    )
    what.add_argument(
        "--compare",
        nargs=2,
        type=Path,
        metavar=("A", "B"),
        help="two results folders: what B changed on the trials that both have",
    )
    what.add_argument(
        "--register",
        nargs=2,
        type=Path,
        metavar=("TARGET", "SOURCE"),
        help="register two scans of your own: .3dx, organised .ply or .csv, or .npz files with "
        "points_mm (profiles, pixels, 3); print the pose, write page and merged cloud to DIR",
    )
    parser.add_argument(
        "--step", type=_length, metavar="MM", help="for --register: distance between profiles"
    )
    parser.add_argument(
        "--travel",
        nargs=3,
        type=float,
        metavar=("X", "Y", "Z"),
        help="for --register: direction of the motion in the sensor frame [1 0 0]",
    )
    parser.add_argument(
        "--method", metavar="NAME", help="for --register: the method [gauss_sphere]"
    )
    parser.add_argument(
        "--calibration",
        type=Path,
        metavar="FILE",
        help="for --register: bias and noise of the sensor, as configs/precision.yaml writes it",
    )
    return parser


def _natural(text: str) -> int:
    if not text.isdecimal():
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 0")
    return int(text)


def _positive(text: str) -> int:
    if not text.isdecimal() or int(text) == 0:
        raise argparse.ArgumentTypeError(f"{text!r} is no whole number from 1")
    return int(text)


def _length(text: str) -> float:
    try:
        value = float(text)
    except ValueError:
        value = 0.0
    if not 0.0 < value < float("inf"):
        raise argparse.ArgumentTypeError(f"{text!r} is no length above 0 mm")
    return value
