"""Find an object by touch alone: compare deciders on live MuJoCo searches, or make your own tactile sensor.

For example:

    activetouch compare                                  the main job: a table and a report in runs/compare
    activetouch compare --deciders threshold --help      what can be set
    activetouch replay --target cone --number 3          a picture of one search of that run
    activetouch touch --shape cone                       a picture of one press
    activetouch explain --scene paper                    what a scene models, why, and what that costs
"""

from __future__ import annotations

import os
import sys


def main() -> None:
    """Parse the arguments and run the chosen command."""
    os.environ.setdefault("HF_HUB_OFFLINE", "1")  # never try the hub silently; it would retry for half a minute
    import tyro

    from belief.errors import ActiveTouchError
    from experiments.calibrate import Calibrate
    from experiments.compare import Compare
    from experiments.explain import Explain
    from experiments.fidelity import Fidelity
    from experiments.perception import Collect, Train
    from experiments.replay import Replay
    from experiments.touch import Gallery, Record, Touch, View

    commands = {
        "compare": Compare,
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
    }
    command = tyro.extras.subcommand_cli_from_dict(commands, description=__doc__)
    try:
        command.run()
    except KeyboardInterrupt:
        print("\ninterrupted; what was finished is kept, run the same command to go on", file=sys.stderr)
        sys.exit(130)
    except (ActiveTouchError, FileNotFoundError) as error:
        sys.exit("\n".join([f"activetouch: {error}", *getattr(error, "__notes__", [])]))


if __name__ == "__main__":
    main()
