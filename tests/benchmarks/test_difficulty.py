"""What choosing places is worth is measured with the settings that were asked for."""

import sys

import pytest

from benchmarks import difficulty


@pytest.mark.mujoco
def test_a_variant_is_played_again_with_other_settings(tmp_path, monkeypatch, capsys):
    asked = []

    def measure(sensor, name, searches, seed, stop):
        asked.append((name, searches, seed))
        return [difficulty.Row(name, decider, 4.0, 0.5, 0.4, 0.6) for decider in ("chosen", "random")]

    monkeypatch.setattr(difficulty, "measure", measure)
    for searches, seed in (("4", "1"), ("8", "2")):
        words = ["--variants", "shafts", "--searches", searches, "--seed", seed, "--out", str(tmp_path)]
        monkeypatch.setattr(sys, "argv", ["difficulty", *words])
        difficulty.main()
    assert asked == [("shafts", 4, 1), ("shafts", 8, 2)]
    assert [path.name for path in tmp_path.iterdir()] == ["difficulty.png"]
