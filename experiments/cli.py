"""The command `run-experiment`: parses, calls the harness, prints; errors become one line here."""

from __future__ import annotations

import argparse
import os
import sys
from collections.abc import Sequence
from pathlib import Path

EXIT_OK, EXIT_FAILED, EXIT_USAGE, EXIT_INTERRUPTED = 0, 1, 2, 130
CHAPTERS = "chapters"  # experiments.chapters.KIND, likewise
# experiments.at_once.RUNS, which imports too much for --help
AT_ONCE = ("precision", "profiles", "discussion")

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
request is wrong (nothing is written then), 130 when interrupted."""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    try:
        status = _main(_parser().parse_args(argv))
        sys.stdout.flush()
    except BrokenPipeError:
        # The reader of our output is gone, as with `| head`; the flush at exit must not fail again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_FAILED
    return status


def _main(options: argparse.Namespace) -> int:
    # Everything below imports numpy and more; help and usage errors must not wait for that.
    from harness.config import experiment_kind, load_experiment
    from harness.config_errors import ConfigError
    from harness.pool import start_server
    from harness.threads import limit_threads

    limit_threads()
    try:
        _check_register(options)
        if options.list:
            return _list()
        if options.config is not None and experiment_kind(options.config) in AT_ONCE:
            return _run_at_once(options)
        if options.config is not None and experiment_kind(options.config) == CHAPTERS:
            return _run_chapters(options)
        if options.config is not None:
            load_experiment(options.config, options.set, options.seed)
            if not (options.dry_run or options.trial or options.show_scene):
                start_server()  # it imports while this process does
        elif not (options.show_scene or options.register or options.compare):
            raise ConfigError("CONFIG", (), "is missing; --list shows those there are")
    except ConfigError as error:
        return _refuse(error)
    from harness.store import StoreError

    try:
        return _run(options)
    except (ConfigError, StoreError) as error:
        return _refuse(error)


def _parser() -> argparse.ArgumentParser:
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


def _check_register(options: argparse.Namespace) -> None:
    """Options that say nothing to what is asked are refused, not passed over."""
    from harness.config_errors import ConfigError

    if options.register is None:
        for name in ("step", "travel", "method", "calibration"):
            if getattr(options, name) is not None:
                raise ConfigError(f"--{name}", (), "belongs to --register TARGET SOURCE")
    asked = next((name for name in ("register", "compare") if getattr(options, name)), None)
    if asked is None:
        return
    what = "reads two files" if asked == "register" else "reads two results folders"
    for name in ("config", "set", "seed", "workers"):
        if getattr(options, name) not in (None, []):
            flag = "CONFIG" if name == "config" else f"--{name}"
            raise ConfigError(flag, (), f"says nothing to --{asked}, which {what}")


def _refuse(error: Exception) -> int:
    print(f"run-experiment: {error}", file=sys.stderr)
    return EXIT_USAGE


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


def _list() -> int:
    from harness.config import read_mapping

    folder = Path("configs")
    if not folder.is_dir():
        folder = Path(__file__).resolve().parent.parent / "configs"
    files = sorted(folder.glob("*.yaml"))
    width = max((len(str(file)) for file in files), default=0)
    for file in files:
        data = read_mapping(file)
        text = " ".join(str(data.get("description") or data.get("title", "")).split())
        print(f"{file!s:{width}}  {text}")
    return EXIT_OK


def _run_at_once(options: argparse.Namespace) -> int:
    from experiments.at_once import RUNS, check_reportable, rehearse, show_run
    from harness.config import experiment_kind
    from harness.config_errors import ConfigError
    from harness.store import StoreError

    for name in ("trial", "show_scene", "register"):
        if getattr(options, name):
            flag = "--" + name.replace("_", "-")
            raise ConfigError(flag, (), f"says nothing to {options.config}, which has no trials")
    kind = experiment_kind(options.config)
    request = options.config, options.out, options.set, options.seed
    if options.dry_run:
        rehearse(kind, *request)
        return EXIT_OK
    try:
        if options.report_only:
            check_reportable(kind, *request)
        show_run(RUNS[kind], *request)
    except StoreError as error:
        return _refuse(error)
    except KeyboardInterrupt:
        print("\nInterrupted. The same command goes on with what is kept.", file=sys.stderr)
        return EXIT_INTERRUPTED
    return EXIT_OK


def _run_chapters(options: argparse.Namespace) -> int:
    from harness.config_errors import ConfigError
    from harness.store import StoreError

    if options.show_scene is not None:
        message = f"says nothing to {options.config}, which has several scenes; name a part's file"
        raise ConfigError("--show-scene", (), message)
    _find_own_methods()
    from experiments.run_chapters import rehearse_chapters, replay_part, run_chapters

    request = options.config, options.out, options.set, options.seed
    try:
        if options.trial is not None:
            return replay_part(*request, options.trial)
        if options.dry_run:
            return rehearse_chapters(*request, options.workers)
        return run_chapters(*request, options.workers, options.report_only)
    except StoreError as error:
        return _refuse(error)


def _find_own_methods() -> None:
    """A method of the user's own, "package.module:function", lies where the command is called."""
    if str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))


def _run(options: argparse.Namespace) -> int:
    _find_own_methods()
    if options.compare is not None:
        from experiments.compare_runs import compare

        first, second = options.compare
        return compare(first, second, options.out)
    if options.register is not None:
        from experiments.own_scans import register_files

        target, source = options.register
        method = options.method or "gauss_sphere"
        files = target, source, options.calibration
        return register_files(*files, options.step, options.travel, method, options.out)
    from experiments import commands
    from harness.session import open_session

    if options.show_scene is not None:
        return commands.show_scene(options.show_scene, options.config, options.out, options.set)
    session = open_session(options.config, options.out, options.set, options.seed)
    if options.trial is not None:
        return commands.replay(session, options.trial)
    if options.dry_run:
        return commands.dry_run(session, options.workers)
    return commands.run_all(session, options.workers, redraw=options.report_only)


if __name__ == "__main__":
    sys.exit(main())
