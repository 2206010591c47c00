"""The command line: ``activetouch <command>``; ``activetouch <command> --help`` explains each."""

from __future__ import annotations

import os


def main() -> None:
    """Parse the arguments and run the chosen command."""
    os.environ.setdefault("HF_HUB_OFFLINE", "1")  # never try the hub silently; it would retry for half a minute
    import tyro

    from experiments.perception import Collect, Train

    tyro.extras.subcommand_cli_from_dict({"collect": Collect, "train": Train}).run()


if __name__ == "__main__":
    main()
