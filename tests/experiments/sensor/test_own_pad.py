"""Commands with a described pad: a picture of a press, and the fit of its response."""

import numpy as np
import pytest

from activetouch import PadDescription, Response, Taxels, read_pad
from belief.errors import InvalidArgument
from benchmarks.pad_fits import RADIUS, simulated
from experiments.command_line.arguments import BadArgument, Trust
from experiments.press.touch import TouchCommand
from experiments.scene_choice import SceneChoice, choice_name
from experiments.sensor.pad_fit import PadFitCommand

KNOWN = {
    "gain": 1.0,
    "blur": 0.2,
    "crosstalk": 0.0,
    "threshold": [0.0, 0.2],
    "stiffness": [4e6, 4e7],
    "law": [0.7, 2.0],
}
PAD = PadDescription(Taxels.grid(4, 4, 0.005), Response.of(KNOWN), (1.0, 8.0), full_scale=4e4)


@pytest.fixture
def mine(tmp_path):
    PAD.save(tmp_path / "mine.toml")
    return tmp_path / "mine.toml"


def test_a_scene_is_touched_by_a_pad(mine):
    choice = SceneChoice("hard", pad=mine)
    scene = choice.named.scene
    assert scene.pad.layout == PAD.taxels
    assert len(scene.shapes) == 12
    assert choice_name(choice) == "hard-mine"
    assert SceneChoice.from_dict(choice.to_dict(), Trust(mine)) == choice
    for other in ({"hand": "parallel"}, {"fidelity": "dynamic"}, {"renderer": "gelsight"}):
        with pytest.raises(InvalidArgument, match="--pad"):
            _ = SceneChoice("gel", pad=mine, **other).named


@pytest.mark.mujoco
def test_a_press_on_a_pad_is_drawn(mine, tmp_path, capsys):
    TouchCommand(SceneChoice(pad=mine), shape="cube", out=tmp_path / "taxels.png").run()
    said = capsys.readouterr().out
    assert "of 16 taxels feel it" in said
    assert (tmp_path / "taxels.png").stat().st_size > 10_000
    with pytest.raises(BadArgument, match="--pad"):
        TouchCommand(SceneChoice(pad=mine), all=True, out=tmp_path / "all.png").run()


def test_a_pad_is_fitted_on_the_command_line(mine, tmp_path, capsys):
    given = simulated(PAD, np.full(7, 0.5), np.random.default_rng(0), 12)
    np.savez(tmp_path / "presses.npz", readings=given.readings, forces=given.forces)
    out, picture = tmp_path / "fitted.toml", tmp_path / "fit.png"
    PadFitCommand(mine, tmp_path / "presses.npz", 1e3 * RADIUS, out, picture).run()
    said = capsys.readouterr().out
    assert "90 % intervals" in said
    assert picture.stat().st_size > 10_000
    before, after = PAD.response.ranges(), read_pad(out).response.ranges()
    for name in ("stiffness", "law"):
        assert after[name][1] / after[name][0] < 0.5 * before[name][1] / before[name][0]
