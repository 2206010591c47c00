"""A file for other solvers is the problem to the last bit: what it holds has the problem's value."""

import re
import sys

import numpy as np
import pytest

from benchmarks.pomdp_files import main, pomdp_text
from planners.solve import SearchTouchProblem, TouchProblem, finite_horizon_value

TABLE = np.random.default_rng(0).dirichlet(np.ones(3), size=(2, 3))
LABELS = ("45° cube", "45. cube", "reset")


def parsed(text):
    """Start, T, O and R of a file, by its own words."""
    words = dict(line.split(": ", 1) for line in text.split("\nT:")[0].splitlines())
    states, actions = words["states"].split(), words["actions"].split()
    assert all(re.fullmatch("[A-Za-z][A-Za-z0-9_-]*", word) for word in (*states, *actions))
    assert len({*states}) == len(states)
    blocks = [
        [text.split(f"\n{kind}: {action}\n")[1].split("\n")[: len(states)] for action in actions] for kind in "TO"
    ]
    tables = [np.array([[[*map(float, row.split())] for row in rows] for rows in block]) for block in blocks]
    paid = re.findall(r"^R: (\S+) : (\S+) : \* : \* (\S+)$", text, re.MULTILINE)
    assert [(action, state) for action, state, _ in paid] == [(a, s) for a in actions for s in states]
    rewards = np.array([float(reward) for *_, reward in paid]).reshape(len(actions), len(states))
    return np.array([*map(float, words["start"].split())]), *tables, rewards


def value(pomdp, belief, steps):
    """Value of the best policy of so many steps, by recursion over the arrays alone; discount 1."""
    _, moves, observed, rewards = pomdp
    if steps == 0:
        return 0.0
    worth = belief @ rewards.T
    for action in range(len(rewards)):
        for column in ((belief @ moves[action])[:, None] * observed[action]).T:
            if column[:-1].any():
                worth[action] += column.sum() * value(pomdp, column / column.sum(), steps - 1)
    return worth.max()


def test_what_a_file_holds_has_the_value_of_the_problem():
    problem = TouchProblem(TABLE, [0.5, 0.3, 0.2], 1, 0.05)
    pomdp = parsed(pomdp_text(problem, LABELS))
    for probs in pomdp[:3]:
        np.testing.assert_allclose(probs.sum(axis=-1), 1.0, atol=1e-12)
    np.testing.assert_array_equal(pomdp[2][:2, :3, :3], TABLE)
    assert value(pomdp, pomdp[0], 3) == pytest.approx(finite_horizon_value(problem, 2))  # two touches and a stop


def test_rejecting_both_objects_of_a_search_pays_what_a_search_pays():
    start, moves, _, rewards = parsed(pomdp_text(SearchTouchProblem(TABLE, 2, "distinct", 0, 0.02), LABELS))
    belief, total = start, 0.0
    for _ in range(3):
        total += belief @ rewards[-1]
        belief = belief @ moves[-1]
    assert total == pytest.approx(1 / 3 - 2 / 3)  # one of three shapes was at neither place
    assert belief[-1] == pytest.approx(1.0)
    large = SearchTouchProblem(np.full((6, 8, 40), 1 / 40), 7, "distinct", 0, 0.02)
    with pytest.raises(ValueError, match="write fewer objects"):
        pomdp_text(large, tuple("abcdefgh"))


@pytest.mark.torch
def test_the_command_writes_the_search_of_a_scene(tmp_path, monkeypatch, capsys):
    file = tmp_path / "cone.pomdp"
    monkeypatch.setattr(sys, "argv", ["pomdp_files.py", "--scene", "paper-independent", "--out", str(file)])
    main()
    assert "the value is at least 0.88" in capsys.readouterr().out
    assert parsed(file.read_text())[1].shape == (8, 5, 5)
