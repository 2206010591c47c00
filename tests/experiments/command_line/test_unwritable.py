"""A command whose results have nowhere to go says so before its work."""

import pytest

from belief.errors import CannotWrite
from experiments.ppo.train_ppo import TrainPPO
from experiments.press.touch import TouchCommand
from experiments.robustness.robustness import Robustness
from experiments.search.compare import Compare
from experiments.search.replay import Replay
from experiments.sensor.calibrate import Calibrate
from experiments.sensor.collect import Collect
from experiments.tradeoff.tradeoff import Tradeoff

PICTURES = (Replay, TouchCommand)


@pytest.mark.parametrize("command", [*PICTURES, Calibrate, Collect, Compare, Robustness, Tradeoff, TrainPPO])
def test_a_file_where_a_folder_is_needed_is_refused_at_once(command, tmp_path):
    (tmp_path / "file").write_text("mine")
    ending = ".png" if command in PICTURES else ""
    for out in ([] if ending else [tmp_path / "file"]) + [tmp_path / "file" / f"out{ending}"]:
        with pytest.raises(CannotWrite, match="file"):
            command(out=out).run()
    assert (tmp_path / "file").read_text() == "mine"
