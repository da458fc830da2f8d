"""The command `run-experiment`: parses, calls the harness, prints; errors become one line here."""

from __future__ import annotations

import argparse
import os
import shlex
import sys
from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING

from experiments.arguments import make_parser

if TYPE_CHECKING:  # help and usage errors must not wait for it
    from harness.config.reading import AnyExperiment

EXIT_OK, EXIT_FAILED, EXIT_USAGE, EXIT_INTERRUPTED = 0, 1, 2, 130
CHAPTERS = "chapters"  # experiments.chapters.KIND, likewise
# experiments.at_once.RUNS, which imports too much for --help
AT_ONCE = ("precision", "profiles", "discussion")
NEED_TRIALS = ("trial", "show_scene", "export", "scheduler")

OF_A_RUN = ("config", "set", "out", "seed", "workers", "scheduler")
OF_FILES = ("step", "travel", "method", "calibration")
# By what is asked in place of a run, the options that it reads; all others are refused.
READS: dict[str, tuple[str, ...]] = {
    "report_only": OF_A_RUN,
    "dry_run": ("config", "set", "out", "seed", "workers"),
    "export": ("config", "set", "out", "seed"),
    "trial": ("config", "set", "out", "seed"),
    "list": (),
    "show_scene": ("config", "set", "out", "seed"),
    "compare": ("out",),
    "register": ("out", *OF_FILES),
}
WHY = {"register": "reads two files", "compare": "reads two results folders"}


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit status."""
    try:
        status = _main(make_parser().parse_args(argv))
        sys.stdout.flush()
    except BrokenPipeError:
        # The reader of our output is gone, as with `| head`; the flush at exit must not fail again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return EXIT_FAILED
    except KeyboardInterrupt:  # before the first trial, or while tables and figures are made
        again = shlex.join(["run-experiment", *(sys.argv[1:] if argv is None else argv)])
        print(f"\nInterrupted: finished trials are kept. To go on: {again}", file=sys.stderr)
        return EXIT_INTERRUPTED
    return status


def _main(options: argparse.Namespace) -> int:
    # Everything below imports numpy and more; help and usage errors must not wait for that.
    from harness.config.errors import ConfigError
    from harness.config.reading import experiment_kind, load_experiment
    from harness.workers.fork_server import start_server
    from harness.workers.threads import limit_threads

    limit_threads()
    experiment = None
    try:
        _check_options(options)
        if options.list:
            return _list()
        kind = None if options.config is None else experiment_kind(options.config)
        if kind in AT_ONCE:
            return _run_at_once(options, kind)
        if kind == CHAPTERS:
            return _run_chapters(options)
        if options.config is not None:
            experiment = load_experiment(options.config, options.set, options.seed)
            if not (options.dry_run or options.trial or options.show_scene or options.export):
                drawn = experiment.sweep is None and any(m.figures for m in experiment.methods)
                start_server(drawn)  # it imports while this process does
        elif not (options.show_scene or options.register or options.compare):
            raise ConfigError("CONFIG", (), "is missing; --list shows those there are")
    except ConfigError as error:
        return _refuse(error)
    from harness.results import RESULTS, telling_disk
    from harness.store import StoreError
    from harness.workers.cluster import ClusterError

    try:
        with telling_disk(options.out or RESULTS):
            return _run(options, experiment)
    except (ConfigError, StoreError, ClusterError) as error:
        return _refuse(error)


def _check_options(options: argparse.Namespace) -> None:
    """Options that say nothing to what is asked are refused, not passed over."""
    from harness.config.errors import ConfigError

    action = next((name for name in READS if getattr(options, name)), None)
    read = OF_A_RUN if action is None else READS[action]
    said = [n for n in (*OF_A_RUN, *OF_FILES) if getattr(options, n) not in (None, [])]
    for name in said:
        if name in OF_FILES and action != "register":
            raise ConfigError(_flag(name), (), "belongs to --register TARGET SOURCE")
        if name not in read:
            why = f", which {WHY[action]}" if action in WHY else ""
            raise ConfigError(_flag(name), (), f"says nothing to {_flag(str(action))}{why}")
        if action == "show_scene" and name in ("set", "seed") and options.config is None:
            raise ConfigError(_flag(name), (), "says nothing to --show-scene without a CONFIG")


def _flag(name: str) -> str:
    return "CONFIG" if name == "config" else "--" + name.replace("_", "-")


def _refuse(error: Exception) -> int:
    print(f"run-experiment: {error}", file=sys.stderr)
    return EXIT_USAGE


def _list() -> int:
    from harness.config.reading import read_mapping

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


def _run_at_once(options: argparse.Namespace, kind: str) -> int:
    from experiments.at_once import RUNS, check_reportable, rehearse, show_run
    from experiments.discussion import TrialError, replay_asked, run_discussion
    from experiments.discussion_trials import KIND as DISCUSSION
    from harness.config.errors import ConfigError
    from harness.results import RESULTS, telling_disk
    from harness.store import StoreError

    for name in NEED_TRIALS:
        if getattr(options, name) and (name, kind) != ("trial", DISCUSSION):
            message = f"says nothing to {options.config}, which runs as a whole"
            raise ConfigError(_flag(name), (), message)
    if options.workers is not None and kind != DISCUSSION:
        message = f"says nothing to {options.config}, which runs in one process"
        raise ConfigError("--workers", (), message)
    request = options.config, options.out, options.set, options.seed
    if options.trial is not None:
        return replay_asked(options.config, options.set, options.seed, options.trial)
    if options.dry_run:
        rehearse(kind, *request)
        return EXIT_OK
    try:
        if options.report_only:
            check_reportable(kind, *request)
        run = RUNS[kind]
        if kind == DISCUSSION:
            run = partial(run_discussion, workers=options.workers)
        with telling_disk(options.out or RESULTS):
            show_run(run, *request)
    except TrialError as error:
        print(f"run-experiment: {error}", file=sys.stderr)
        return EXIT_FAILED
    except StoreError as error:
        return _refuse(error)
    except KeyboardInterrupt:
        print("\nInterrupted. The same command goes on with what is kept.", file=sys.stderr)
        return EXIT_INTERRUPTED
    return EXIT_OK


def _run_chapters(options: argparse.Namespace) -> int:
    from harness.config.errors import ConfigError
    from harness.results import RESULTS, telling_disk
    from harness.store import StoreError

    if options.show_scene is not None:
        message = f"says nothing to {options.config}, which has several scenes; name a part's file"
        raise ConfigError("--show-scene", (), message)
    for name in ("export", "scheduler"):
        if getattr(options, name):
            message = (
                f"says nothing to {options.config}, which has several parts; name a part's file"
            )
            raise ConfigError(f"--{name}", (), message)
    _find_own_methods()
    from experiments.run_chapters import rehearse_chapters, replay_part, run_chapters

    request = options.config, options.out, options.set, options.seed
    try:
        if options.trial is not None:
            return replay_part(*request, options.trial)
        if options.dry_run:
            return rehearse_chapters(*request, options.workers)
        with telling_disk(options.out or RESULTS):
            return run_chapters(*request, options.workers, options.report_only)
    except StoreError as error:
        return _refuse(error)


def _find_own_methods() -> None:
    """A method of the user's own, "package.module:function", lies where the command is called."""
    if str(Path.cwd()) not in sys.path:
        sys.path.append(str(Path.cwd()))


def _run(options: argparse.Namespace, experiment: AnyExperiment | None) -> int:
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
        request = options.config, options.out, options.set, options.seed
        return commands.show_scene(options.show_scene, *request)
    commands.tell_long_check(experiment)
    session = open_session(options.config, options.out, options.set, options.seed)
    if options.trial is not None:
        return commands.replay(session.trials, options.trial)
    if options.dry_run:
        from experiments.rehearsal import dry_run

        return dry_run(session, options.workers)
    if options.export is not None:
        return commands.export(session, options.export)
    return commands.run_all(
        session, options.workers, redraw=options.report_only, scheduler=options.scheduler
    )


if __name__ == "__main__":
    sys.exit(main())
