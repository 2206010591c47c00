"""The ``activetouch`` command; it imports only the module of the chosen subcommand."""

from __future__ import annotations

import os
import sys
from contextlib import AbstractContextManager, nullcontext
from importlib import import_module
from pathlib import Path
from typing import Any, NamedTuple

from experiments.command_line.signals import loading, running


class Command(NamedTuple):
    """A subcommand: its module in :mod:`experiments`, its class there, and one line of the help."""

    module: str
    name: str
    summary: str

    def load(self) -> Any:
        """The class of the command."""
        return getattr(import_module(f"experiments.{self.module}"), self.name)


COMMAND_GROUPS: dict[str, dict[str, Command]] = {
    "Search": {
        "compare": Command("search.compare", "Compare", "run the same searches with several deciders; report"),
        "find": Command("meshes.find", "Find", "find the object of one mesh among others; no training"),
        "drawer": Command("search.drawer.drawer", "Drawer", "find an object in a tray, wherever it lies; no training"),
        "identify": Command("meshes.identify", "Identify", "name objects, given a folder of meshes; no training"),
        "replay": Command("search.replay", "Replay", "draw one recorded search"),
        "live": Command("search.live", "Live", "run a search that a robot carries out, over lines of JSON"),
        "export": Command("search.export", "Export", "write a run's figures and tables"),
    },
    "Look at touches": {
        "touch": Command("press.touch", "TouchCommand", "draw presses, watch one, or log every time step"),
        "explain": Command("press.explain", "Explain", "list what a scene models, and which shapes feel alike"),
    },
    "Make a sensor or a policy": {
        "collect": Command("sensor.collect", "Collect", "record touches of thousands of objects"),
        "train": Command("sensor.train", "Train", "train a classifier on a collection"),
        "pad-fit": Command("sensor.pad_fit", "PadFitCommand", "fit your own pad to presses of one ball"),
        "calibrate": Command("sensor.calibrate", "Calibrate", "fit the observation model; evaluate on unseen objects"),
        "train-ppo": Command("ppo.train_ppo", "TrainPPO", "train PPO policies on a collection"),
    },
    "Evaluate": {
        "benchmark": Command("search.benchmark.command", "Benchmark", "score an agent on a task; check submissions"),
        "certify": Command("search.certify", "Certify", "bound the error of stops at every number of touches"),
        "calibration-report": Command(
            "calibration.calibration_report", "CalibrationReport", "test the calibration of stated probabilities"
        ),
        "recorded": Command("recorded.recorded", "Recorded", "search among real objects by recorded touches"),
        "robustness": Command("robustness.robustness", "Robustness", "test faults, changed objects and unknown shapes"),
        "tradeoff": Command("tradeoff.tradeoff", "Tradeoff", "measure accuracy against time; recommend configurations"),
        "reproduce": Command("paper.reproduce", "Reproduce", "reproduce the paper's tables and Figure 3"),
    },
}
"""All commands, grouped and ordered as in the help."""

OPEN = "--open"
"""Option of every command."""
REGISTRY: dict[str, Command] = {name: entry for group in COMMAND_GROUPS.values() for name, entry in group.items()}


_HELP = """\
usage: activetouch COMMAND [OPTIONS]
Find an object by touch alone. The command to start with is compare.

{commands}

activetouch COMMAND --help    a command's options, with examples
activetouch COMMAND --open    run it, then open its report in a browser
activetouch --version         the version of this installation"""


def commands() -> dict[str, Any]:
    """Import all commands; return their classes by name."""
    return {name: entry.load() for name, entry in REGISTRY.items()}


def help_text() -> str:
    """What ``activetouch --help`` prints."""
    lines = []
    for group, entries in COMMAND_GROUPS.items():
        lines += [f"{group}:", *(f"  {name:<18}  {entry.summary}" for name, entry in entries.items())]
    return _HELP.format(commands="\n".join(lines))


def main() -> None:
    """Parse the arguments and run the chosen command."""
    for name, mode in {"stdin": "r", "stdout": "w", "stderr": "w"}.items():
        if getattr(sys, name) is None:  # closed, as by >&-; the next file to be opened would be written to by prints
            setattr(sys, name, open(os.devnull, mode))  # noqa: SIM115
    try:
        try:
            _run(sys.argv[1:])
        finally:  # also after --help, which exits
            sys.stdout.flush()
    except OSError as error:  # of printing, or of a library that writes a file, such as logs
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # without this the interpreter reports an error at exit
        if isinstance(error, BrokenPipeError):  # the reader of the output, such as head, has ended
            sys.exit(141)  # 128 + SIGPIPE, as shells report it
        sys.exit(f"activetouch: {error}. Finished results are kept. Solve this, then run the same command to continue")


def _run(arguments: list[str]) -> None:
    with loading():
        from belief.errors import ActiveTouchError
        from belief.references import ForeignCode
        from experiments.command_line.console import plain_warnings, print_on_any_terminal

        print_on_any_terminal()
        if not arguments or arguments[0] in ("-h", "--help"):
            print(help_text())
            return
        if arguments[0] == "--version":
            import activetouch

            print(f"activetouch {activetouch.__version__}")
            return
        try:
            command = _parsed(arguments)
        except ActiveTouchError as error:
            sys.exit(f"activetouch: {error}")
    try:
        with running(), plain_warnings():
            with ForeignCode(), _cluster_of(command):
                command.run()
            if OPEN in arguments:
                _open_page()
    except ModuleNotFoundError as error:
        from activetouch.extras import extra_of, missing_package

        module = error.name or ""
        if (extra := extra_of(module)) is None:
            raise
        sys.exit(f"activetouch: {missing_package([module], extra)}")
    except (ActiveTouchError, FileNotFoundError) as error:
        sys.exit("\n".join([f"activetouch: {error}", *getattr(error, "__notes__", [])]))


def _cluster_of(command: Any) -> AbstractContextManager[None]:
    """The context in which a command works on the cluster that it names, if any."""
    from experiments.command_line.arguments import BadArgument, Cluster

    options = getattr(command, "cluster", Cluster())
    if options.cluster is not None:
        return import_module("experiments.parallel.cluster").on_cluster(options.cluster, dashboard=options.dashboard)
    if options.dashboard:
        raise BadArgument("--dashboard is that of a cluster: add --cluster, such as --cluster local:8")
    return nullcontext()


def _open_page() -> None:
    """Open the page that the command wrote last in a browser."""
    import webbrowser

    page = sys.modules.get("experiments.report")
    if page is None or not page.written:
        print(f"{OPEN}: this command wrote no page", file=sys.stderr)
    elif not webbrowser.open(path := page.written[-1].resolve().as_uri()):
        print(f"{OPEN}: there is no browser here; open {path}", file=sys.stderr)


def _parsed(arguments: list[str]) -> Any:
    """Parse the command line into a command object."""
    import argparse

    import tyro

    from belief.errors import UnknownName

    name, *options = arguments
    options = [option for option in options if option != OPEN]
    if name.startswith("--tyro-"):  # shell completion needs all commands
        return tyro.extras.subcommand_cli_from_dict(commands(), prog="activetouch", args=arguments)
    if name not in REGISTRY:
        raise UnknownName("command", name, list(REGISTRY))
    kind = REGISTRY[name].load()
    known = {}
    if hasattr(kind, "from_config"):
        flag = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
        flag.add_argument("--config", type=Path, nargs="?")
        if (config := flag.parse_known_args(options)[0].config) is not None:
            known["default"] = kind.from_config(config)
    if {"-h", "--help"} & {*options} and hasattr(tyro.extras, "get_parser"):
        from experiments.command_line.help import help_of

        print(help_of(kind, name, **known))
        sys.exit()
    try:
        return tyro.cli(kind, prog=f"activetouch {name}", args=options, **known)
    except SystemExit as end:
        if end.code and hasattr(tyro.extras, "get_parser"):
            from experiments.command_line.help import hints

            print(*hints(name, options, commands()), sep="\n", file=sys.stderr)
        raise


if __name__ == "__main__":
    main()
