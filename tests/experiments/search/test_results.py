"""Files of results are paired by task and seed, and what is wrong with a file is said."""

import sys

import numpy as np
import pytest

from belief.statistics import mcnemar_test, wilson_interval
from experiments.cli import main
from experiments.command_line.arguments import BadArgument
from experiments.search.results import compare_results

HEADER = "seed,task,success,length"


def write(path, rows, header=HEADER):
    path.write_text("\n".join([header, *(",".join(map(str, row)) for row in rows)]) + "\n")
    return path


def outcomes(seed, share, tasks=("lift", "push"), number=60):
    rng = np.random.default_rng(seed)
    return [(i, task, int(rng.random() < share), 5 + i % 3) for task in tasks for i in range(number)]


def test_episodes_are_paired_by_task_and_seed_whatever_their_order_and_the_rest_is_left_out(tmp_path):
    first, second = outcomes(0, 0.9), outcomes(1, 0.6)
    shuffled = [second[i] for i in np.random.default_rng(2).permutation(len(second))]
    one = write(tmp_path / "one.csv", [*first, (99, "lift", 1, 5)])
    columns = [(task, f"{seed}.0", bool(success), "kept") for seed, task, success, _ in shuffled]
    found = compare_results([one, write(tmp_path / "two.csv", columns, " Task,SEED,Success,note")])
    right, other = ([row[2] for row in rows] for rows in (first, second))
    pair = found.differences["two"]
    assert pair.mcnemar == mcnemar_test(other, right)
    assert pair.success[0] == pytest.approx(np.mean(other) - np.mean(right))
    assert pair.touches is None  # the second file states none
    rate = next(row for row in found.tables()[0].rows if row[:2] == ("one", "all"))
    assert rate[2:5] == (120, np.mean(right), wilson_interval(sum(right), 120))
    assert pair.p_value == pair.mcnemar.mid_p_value
    assert "1 episodes of one are not in all others; left out." in found.verdict()


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("Seed,outcome\n1,1\n", "no column 'task' and no column 'success'"),
        ("", "its first line is empty"),
        (f"{HEADER}\n", "holds no episodes"),
        (f"{HEADER}\n1,a,1,3\n1.0,a,0,3\n", "line 3: the episode of task 'a' with seed '1' is there twice"),
        (f"{HEADER}\n1,a,maybe,3\n", "line 2: success must be 1, 0, true or false, got 'maybe'"),
        (f"{HEADER}\n1,a,1,inf\n", "line 2: length must be a number"),
        (f"{HEADER}\n1,a,1,-3\n", "line 2: length must be a number"),
        (f"{HEADER}\n1,a,1\n", "line 2: 3 cells under 4 columns"),
        (f"{HEADER}\n1,a,1,3\n,a,1,3\n", "line 3: the seed is missing"),
        (f"{HEADER}\n1,all,1,3\n", "a task cannot be called 'all'"),
        ('seed,task,success\n1,"a,1\n', "is not CSV"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(tmp_path, content, said):
    (tmp_path / "a.csv").write_text(content)
    with pytest.raises(BadArgument, match=said):
        compare_results([tmp_path / "a.csv"])


def test_the_command_prints_and_reports_without_a_scene(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = [write(tmp_path / f"{name}.csv", outcomes(i, 0.9 - 0.2 * i)).name for i, name in enumerate("ab")]
    monkeypatch.setattr(sys, "argv", ["activetouch", "compare", "--results", *names])
    main()
    printed = " ".join(capsys.readouterr().out.split())
    assert "b succeeds significantly less often than a" in printed
    page = (tmp_path / "runs/results/report.html").read_text()
    assert "b succeeds significantly less often than a" in page
    assert (tmp_path / "runs/results/tables/differences.csv").exists()
