"""Find an object by touch alone: compare deciders on live MuJoCo searches, or make your own tactile sensor.

For example:

    activetouch compare                                  the main job: a table and a report in runs/compare
    activetouch compare --deciders threshold --help      what can be set
    activetouch replay --target cone --number 3          a picture of one search of that run
    activetouch touch --shape cone                       a picture of one press
    activetouch explain --scene paper                    what a scene models, why, and what that costs
    activetouch limit --scene coarse                     how well any reader of one touch could do
"""

from __future__ import annotations

import sys

from experiments.command_line.signals import loading, running


def commands() -> dict[str, type]:
    """Every command by name."""
    from experiments.bayes_error.limit import Limit
    from experiments.calibration.calibration_report import CalibrationReport
    from experiments.extremes.stress import Stress
    from experiments.paper.reproduce import Reproduce
    from experiments.ppo.touch_bank import MakeTouchBank
    from experiments.ppo.train_ppo import TrainPPO
    from experiments.press.explain import Explain
    from experiments.press.fidelity import Fidelity
    from experiments.press.leak import Leak
    from experiments.press.touch import Gallery, Record, Touch, View
    from experiments.robustness.robustness import Robustness
    from experiments.search.compare import Compare
    from experiments.search.merge import Merge
    from experiments.search.overprobing import OverprobingCommand
    from experiments.search.replay import Replay
    from experiments.sensor.calibrate import Calibrate
    from experiments.sensor.collect import Collect
    from experiments.sensor.frontier import Frontier
    from experiments.sensor.learning_curve import LearningCurve
    from experiments.sensor.train import Train
    from experiments.tradeoff.tradeoff import Tradeoff

    return {
        "compare": Compare,
        "merge": Merge,
        "replay": Replay,
        "explain": Explain,
        "touch": Touch,
        "gallery": Gallery,
        "record": Record,
        "view": View,
        "fidelity": Fidelity,
        "collect": Collect,
        "train": Train,
        "calibrate": Calibrate,
        "touch-bank": MakeTouchBank,
        "train-ppo": TrainPPO,
        "overprobing": OverprobingCommand,
        "calibration-report": CalibrationReport,
        "reproduce": Reproduce,
        "learning-curve": LearningCurve,
        "frontier": Frontier,
        "leak": Leak,
        "limit": Limit,
        "robustness": Robustness,
        "stress": Stress,
        "tradeoff": Tradeoff,
    }


def main() -> None:
    """Parse the arguments and run the chosen command."""
    with loading():
        import tyro

        from belief.errors import ActiveTouchError
        from belief.files import is_of_writing
        from experiments.command_line.console import print_on_any_terminal

        print_on_any_terminal()
        command = tyro.extras.subcommand_cli_from_dict(commands(), description=__doc__)
    try:
        with running():
            command.run()
    except (ActiveTouchError, FileNotFoundError) as error:
        sys.exit("\n".join([f"activetouch: {error}", *getattr(error, "__notes__", [])]))
    except OSError as error:  # of what libraries write on their own, such as logs and copies for workers
        if not is_of_writing(error):
            raise
        sys.exit(f"activetouch: {error}. What was finished is kept; mend that, and run the same command to go on")


if __name__ == "__main__":
    main()
