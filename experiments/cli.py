"""The ``activetouch`` command: a table of commands, of which only the chosen one is imported."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from importlib import import_module
from pathlib import Path
from typing import Any

from experiments.command_line.signals import loading, running


@dataclass(frozen=True)
class Entry:
    """A command in the table.

    Attributes:
        place: ``module:class``; the module lies in :mod:`experiments`.
        summary: what it does, in one line of the help.
    """

    place: str
    summary: str

    def load(self) -> Any:
        """The class of the command."""
        module, _, name = self.place.partition(":")
        return getattr(import_module(f"experiments.{module}"), name)


GROUPS: dict[str, dict[str, Entry]] = {
    "Search": {
        "compare": Entry("search.compare:Compare", "play the same searches with several deciders; report"),
        "merge": Entry("search.merge:Merge", "unite run folders that several machines filled"),
        "replay": Entry("search.replay:Replay", "draw or animate one recorded search"),
        "export": Entry("search.export:Export", "write a search (.pomdp) or a solved policy (.npz)"),
        "overprobing": Entry("search.overprobing:OverprobingCommand", "count the touches made after certainty"),
    },
    "Look at touches": {
        "touch": Entry("press.touch:TouchCommand", "draw one press"),
        "gallery": Entry("press.touch:Gallery", "draw every shape, pose and renderer"),
        "view": Entry("press.touch:View", "watch a press in MuJoCo's window"),
        "record": Entry("press.touch:Record", "write presses as time series, one CSV file per object"),
        "explain": Entry("press.explain:Explain", "list what a scene models, why, and what that costs"),
        "fidelity": Entry("press.fidelity:FidelityCommand", "compare cheap and rich ways to press"),
    },
    "Make a sensor": {
        "collect": Entry("sensor.collect:Collect", "record touches of thousands of objects"),
        "train": Entry("sensor.train:Train", "train a classifier on a collection"),
        "calibrate": Entry("sensor.calibrate:Calibrate", "fit the observation model; evaluate on unseen objects"),
        "learning-curve": Entry("sensor.learning_curve:LearningCurve", "accuracy against the number of images"),
        "frontier": Entry("sensor.frontier:Frontier", "accuracy against time and size, per network"),
    },
    "Train policies": {
        "touch-bank": Entry("ppo.touch_bank:MakeTouchBank", "turn a collection into a bank of touches to learn from"),
        "train-ppo": Entry("ppo.train_ppo:TrainPPO", "train PPO policies, one per target"),
    },
    "Evaluate": {
        "calibration-report": Entry(
            "calibration.calibration_report:CalibrationReport", "test whether stated probabilities are right"
        ),
        "limit": Entry("bayes_error.limit:Limit", "estimate the best possible accuracy of one touch"),
        "leak": Entry("press.leak:Leak", "measure what force and depth reveal without the image"),
        "robustness": Entry("robustness.robustness:Robustness", "test faults, other objects and unknown shapes"),
        "tradeoff": Entry("tradeoff.tradeoff:Tradeoff", "measure accuracy against time; recommend configurations"),
        "reproduce": Entry("paper.reproduce:Reproduce", "the paper's tables and figures, beside ours"),
        "stress": Entry("extremes.stress:Stress", "run extreme inputs and judge what happens"),
    },
}
"""Every command, in the groups and the order of the help."""

TABLE: dict[str, Entry] = {name: entry for group in GROUPS.values() for name, entry in group.items()}


def commands() -> dict[str, Any]:
    """The class of every command by name; this imports all of them."""
    return {name: entry.load() for name, entry in TABLE.items()}


def help_lines() -> Iterator[str]:
    """What ``activetouch --help`` prints: one line per command."""
    yield "usage: activetouch COMMAND [OPTIONS]"
    yield "Find an object by touch alone. To begin: activetouch compare"
    for group, entries in GROUPS.items():
        yield f"\n{group}:" if group == "Search" else f"{group}:"
        yield from (f"  {name:<18}  {entry.summary}" for name, entry in entries.items())
    yield "\nactivetouch COMMAND --help    a command's options, with examples"
    yield "activetouch --version         the version of this installation"


def main() -> None:
    """Parse the arguments and run the chosen command."""
    try:
        _run(sys.argv[1:])
        sys.stdout.flush()
    except BrokenPipeError:  # whoever read the output, such as head, has ended
        os.dup2(os.open(os.devnull, os.O_WRONLY), 1)  # or the interpreter complains when it flushes at its end
        sys.exit(141)  # what a shell says of a process that SIGPIPE ended


def _run(arguments: list[str]) -> None:
    with loading():
        from belief.errors import ActiveTouchError
        from belief.files import is_of_writing
        from experiments.command_line.console import print_on_any_terminal

        print_on_any_terminal()
        if not arguments or arguments[0] in ("-h", "--help"):
            print("\n".join(help_lines()))
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
        with running():
            command.run()
    except BrokenPipeError:
        raise
    except (ActiveTouchError, FileNotFoundError) as error:
        sys.exit("\n".join([f"activetouch: {error}", *getattr(error, "__notes__", [])]))
    except OSError as error:  # of what libraries write on their own, such as logs and copies for workers
        if not is_of_writing(error):
            raise
        sys.exit(f"activetouch: {error}. What was finished is kept; mend that, and run the same command to go on")


def _parsed(arguments: list[str]) -> Any:
    """The command that was typed, with its arguments."""
    import tyro

    from belief.errors import UnknownName

    name, *options = arguments
    if name.startswith("--tyro-"):  # completion for a shell, which has to know all commands
        return tyro.extras.subcommand_cli_from_dict(commands(), prog="activetouch", args=arguments)
    if name not in TABLE:
        raise UnknownName("command", name, list(TABLE))
    kind = TABLE[name].load()
    config = _value_of("--config", options) if hasattr(kind, "from_config") else None
    known = {} if config is None else {"default": kind.from_config(Path(config))}
    return tyro.cli(kind, prog=f"activetouch {name}", args=options, **known)


def _value_of(flag: str, options: list[str]) -> str | None:
    """What follows a flag, which stands alone or with an equals sign."""
    for word, following in zip(options, [*options[1:], None], strict=True):
        if word == flag:
            return following
        if word.startswith(f"{flag}="):
            return word.removeprefix(f"{flag}=")
    return None


if __name__ == "__main__":
    main()
