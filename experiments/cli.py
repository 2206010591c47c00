"""The command line: ``activetouch <command>``; ``activetouch <command> --help`` explains each."""

from __future__ import annotations

import os


def main() -> None:
    """Parse the arguments and run the chosen command."""
    os.environ.setdefault("HF_HUB_OFFLINE", "1")  # never try the hub silently; it would retry for half a minute
    import tyro

    from experiments.calibrate import Calibrate
    from experiments.compare import Compare
    from experiments.perception import Collect, Train
    from experiments.replay import Replay

    commands = {"compare": Compare, "replay": Replay, "collect": Collect, "train": Train, "calibrate": Calibrate}
    tyro.extras.subcommand_cli_from_dict(commands, description=__doc__).run()


if __name__ == "__main__":
    main()
