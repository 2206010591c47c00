"""Files of results are paired by task and seed, and what is wrong with a file is said."""

import csv
import gzip
import json
import sys
from dataclasses import replace

import numpy as np
import pytest

from belief.statistics import mcnemar_test, wilson_interval
from experiments.cli import main
from experiments.command_line.arguments import BadArgument
from experiments.search.comparison import compare
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
    pair = found.differences["two", "all"]
    assert pair.mcnemar == mcnemar_test(other, right)
    assert pair.success[0] == pytest.approx(np.mean(other) - np.mean(right))
    assert pair.touches is None  # the second file states none
    rate = next(row for row in found.tables()[0].rows if row[:2] == ("one", "all"))
    assert rate[2:5] == (120, np.mean(right), wilson_interval(sum(right), 120))
    assert pair.p_value == pair.mcnemar.mid_p_value
    tasks = [found.differences["two", task] for task in ("lift", "push")]  # two questions, corrected together
    assert min(one.p_value for one in tasks) == 2 * min(one.mcnemar.mid_p_value for one in tasks)
    assert "1 episodes of one are not in all others; left out." in found.verdict()


def test_results_are_the_same_in_every_format_of_columns(tmp_path):
    rows = outcomes(0, 0.7)
    write(tmp_path / "a.csv", rows)
    (tmp_path / "b.csv.gz").write_bytes(gzip.compress((tmp_path / "a.csv").read_bytes()))
    names = HEADER.split(",")
    arrays = {name: np.array([row[i] for row in rows]) for i, name in enumerate(names)}
    np.savez(tmp_path / "c.npz", note=np.zeros(3), **arrays)
    found = compare_results([tmp_path / name for name in ("a.csv", "b.csv.gz", "c.npz")])
    first = found.success["a"], found.length["a"]
    for name in ("b.csv", "c"):
        np.testing.assert_array_equal((found.success[name], found.length[name]), first)
    np.savez(tmp_path / "d.npz", seed=np.zeros(2), task=np.zeros(3), success=np.ones(2))
    with pytest.raises(BadArgument, match=r"d\.npz: .* must be rows of one length"):
        compare_results([tmp_path / "d.npz"])


def test_subtracting_controls_changes_the_sign_where_the_policies_fail_without_a_perturbation(tmp_path):
    rows = {name: [] for name in ("weak", "weak clean", "strong", "strong clean")}
    for i in range(4):
        for seed in range(40):
            fails = {
                "weak clean": seed < 8,
                "weak": seed < 9,
                "strong clean": False,
                "strong": seed < 2 + 10 * (i == 3),
            }
            for name, fail in fails.items():
                rows[name].append((seed, f"family {i}", int(not fail), 7))
    paths = {name: write(tmp_path / f"{name}.csv", some) for name, some in rows.items()}
    controls = [paths["weak clean"], paths["strong clean"]]
    found = compare_results([paths["weak"], paths["strong"]], control=controls)
    before_and_after = {task: (before, after[0]) for (_, task), (before, after) in found.beyond_controls.items()}
    assert before_and_after["family 0"] == pytest.approx((7 / 40, -1 / 40))
    assert before_and_after["family 3"] == pytest.approx((-3 / 40, -11 / 40))
    said = found.verdict()
    assert said[0] == "strong succeeds in 142 of 160 episodes; weak in 124."
    assert "the sign of strong minus weak in 3 of 4 tasks." in said[-1]
    assert any(one.startswith("weak fails in 4 of 4 tasks; minus weak clean it is no worse in 0") for one in said)
    assert any(one.startswith("strong succeeds significantly less often than strong clean") for one in said)
    assert [table.name for table in found.tables()][2:] == ["over_control", "beyond_controls"]
    common = compare_results([paths["weak"], paths["strong"]], control=controls[:1])
    assert {*common.control.values()} == {"weak clean"}
    assert len(common.over_control) == 10
    assert not common.beyond_controls
    with pytest.raises(BadArgument, match="one for each of 1; got 2"):
        compare_results([paths["weak"]], control=controls)
    with pytest.raises(BadArgument, match="nothing to be subtracted from"):
        compare_results([], control=controls)
    with pytest.raises(BadArgument, match="different files"):
        compare_results([paths["weak"]], control=[paths["weak"]])


def test_files_of_lerobot_are_read_in_both_forms(tmp_path):
    old = [{"episode_ix": i, "success": i % 3 > 0, "seed": 1000 + i, "sum_reward": 0.0} for i in range(9)]
    (tmp_path / "old").mkdir()
    (tmp_path / "old" / "eval_info.json").write_text(json.dumps({"per_episode": old, "aggregated": {}}))
    successes = [{"task_group": "libero", "task_id": k, "metrics": {"successes": [True, False]}} for k in range(2)]
    (tmp_path / "eval_info.json").write_text(json.dumps({"per_task": successes, "overall": {}}))
    one = compare_results([tmp_path / "old" / "eval_info.json"])
    assert one.keys[0] == ("", "1000")
    assert one.success["eval_info"].tolist() == [i % 3 > 0 for i in range(9)]
    new = compare_results([tmp_path / "eval_info.json"])
    assert new.keys == [("libero 0", "0"), ("libero 0", "1"), ("libero 1", "0"), ("libero 1", "1")]
    assert new.success["eval_info"].tolist() == [True, False, True, False]
    assert "Without seeds in eval_info, episodes are paired by their number" in new.verdict()[2]
    with pytest.raises(BadArgument, match="no episode of the same task and seed"):
        compare_results([tmp_path / "eval_info.json", tmp_path / "old" / "eval_info.json"])
    (tmp_path / "some.json").write_text(json.dumps({"per_episode": [old[0], old[1] | {"seed": None}]}))
    with pytest.raises(BadArgument, match="episode 1: the seed is missing"):
        compare_results([tmp_path / "some.json"])


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
        (f"{HEADER}\n1,a,1\n", "line 2 of .* has 3 cells, the header has 4"),
        (f"{HEADER}\n1,a,1,3\n,a,1,3\n", "line 3: the seed is missing"),
        (f"{HEADER}\n1,all,1,3\n", "a task cannot be called 'all'"),
        ('seed,task,success\n1,"a,1\n', "is not CSV"),
    ],
)
def test_what_is_wrong_with_a_file_is_said(tmp_path, content, said):
    (tmp_path / "a.csv").write_text(content)
    with pytest.raises(BadArgument, match=said):
        compare_results([tmp_path / "a.csv"])


@pytest.mark.parametrize(
    "content", ["[", "[]", "{}", '{"per_task": 3}', '{"per_episode": [{"success": true}]}', "[" * 10**5]
)
def test_other_json_is_refused(tmp_path, content):
    (tmp_path / "a.json").write_text(content)
    with pytest.raises(BadArgument, match="no eval_info"):
        compare_results([tmp_path / "a.json"])


def test_the_command_prints_and_reports_without_a_scene(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    names = [write(tmp_path / f"{name}.csv", outcomes(i, 0.9 - 0.2 * i)).name for i, name in enumerate("ab")]
    clean = write(tmp_path / "clean.csv", outcomes(2, 0.95)).name
    monkeypatch.setattr(sys, "argv", ["activetouch", "compare", "--results", *names, "--control", clean])
    main()
    printed = " ".join(capsys.readouterr().out.split())
    assert "b succeeds significantly less often than a" in printed
    page = (tmp_path / "runs/results/report.html").read_text()
    assert "b succeeds significantly less often than a" in page
    assert (tmp_path / "runs/results/tables/differences.csv").exists()
    assert (tmp_path / "runs/results/tables/over_control.csv").exists()


@pytest.mark.mujoco
def test_episodes_of_the_environment_are_paired_with_the_searches_of_a_run(tmp_path, monkeypatch, capsys):
    """An agent that repeats the actions of a decider succeeds where it does, with as many touches."""
    import gymnasium

    monkeypatch.chdir(tmp_path)
    played = compare("coarse", ["information_gain", "random_confirm"], episodes=3, targets="cone", seed=5, out="run")
    env = gymnasium.make("activetouch:activetouch/ObjectSearch-v0", scene="coarse", target="cone")
    rows = []
    for episode in played.of("information_gain"):
        env.reset(options={"seed": (key := episode.seed)})
        for step in episode.steps:
            action = step.decision.action
            *_, info = env.step(getattr(action, "pose", env.unwrapped.confirm + (type(action).__name__ == "Reject")))
        rows.append([np.array(key) if key[2] else list(key), "cone", info["is_success"], info["num_touches"]])
    with (tmp_path / "mine.csv").open("w") as file:
        csv.writer(file).writerows([HEADER.split(","), *rows])
    monkeypatch.setattr(sys, "argv", ["activetouch", "compare", "--results", "run", "mine.csv"])
    main()
    assert "3 episodes are in all files, of 1 task." in capsys.readouterr().out
    found = compare_results([tmp_path / "run" / "episodes.jsonl", tmp_path / "mine.csv"])
    assert list(found.success) == ["information_gain", "random_confirm", "mine"]
    assert found.success["mine"].tolist() == [e.success for e in played.of("information_gain")]
    assert found.length["mine"].tolist() == found.length["information_gain"].tolist()
    assert not any(found.left_out.values())
    of_run, searched = compare_results(["run"], seed=5), played.differences["random_confirm"]
    assert of_run.differences["random_confirm", "all"] == replace(searched, reward=None)
    for folder in ("run", "run again"):
        compare("coarse", "random_confirm", episodes=2, targets="cone", seed=5, out=folder)
    both = compare_results([tmp_path / "run", tmp_path / "run again"])
    assert list(both.success) == [str(tmp_path / name / "random_confirm") for name in ("run", "run again")]


def test_what_is_no_file_and_no_run_is_said(tmp_path):
    with pytest.raises(BadArgument, match=r"there is no file .*none\.csv"):
        compare_results([tmp_path / "none.csv"])
    with pytest.raises(FileNotFoundError, match="holds no run; start one with"):
        compare_results([tmp_path])
