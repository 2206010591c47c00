"""A command whose results have nowhere to go says so before its work."""

import pytest

from belief.errors import CannotWrite
from experiments.calibrate import Calibrate
from experiments.collect import Collect
from experiments.compare import Compare
from experiments.fidelity import Fidelity
from experiments.limit import Limit
from experiments.replay import Replay
from experiments.robustness import Robustness
from experiments.touch import Gallery, Record, Touch
from experiments.tradeoff import Tradeoff
from experiments.train_ppo import TrainPPO

PICTURES = (Replay, Touch, Gallery)


@pytest.mark.parametrize(
    "command", [*PICTURES, Calibrate, Collect, Compare, Fidelity, Limit, Record, Robustness, Tradeoff, TrainPPO]
)
def test_a_place_below_a_file_is_refused_at_once(command, tmp_path):
    (tmp_path / "file").write_text("mine")
    ending = {Fidelity: ".json"}.get(command, ".png" if command in PICTURES else "")
    with pytest.raises(CannotWrite, match="file"):
        command(out=tmp_path / "file" / f"out{ending}").run()
    assert (tmp_path / "file").read_text() == "mine"
