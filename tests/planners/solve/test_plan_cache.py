"""Plans in the cache folder: the same to the last bit, for one problem, settings and code, and never trusted."""

import pickle
from pathlib import Path

import numpy as np
import pytest

import planners.solve.plan_cache as cache
from belief import SearchProblem
from belief.observation_model import OutcomeTable
from planners.point_based import _POLICIES, PointBased
from planners.solve import SearchTouchProblem, solve
from planners.solve.plan_cache import PlanCacheWarning, plan_folder, solve_once

TABLE = np.array([[[0.9, 0.1], [0.1, 0.9]], [[0.6, 0.4], [0.4, 0.6]]])


def problem(table=TABLE, composition="distinct", target=1, touch_cost=0.05, discount=1.0):
    return SearchTouchProblem(table, 2, composition, target, touch_cost, discount=discount)


PROBLEM = problem()
ROUNDS, WEIGHTS = (30, 30), np.array([1.0, 0.8, 0.5])


@pytest.fixture
def folder(tmp_path, monkeypatch):
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "plans"))
    return tmp_path / "plans"


@pytest.fixture
def solved(monkeypatch):
    """The problems that were solved, in turn."""
    found = []
    monkeypatch.setattr(cache, "solve", lambda problem, **settings: found.append(problem) or solve(problem, **settings))
    return found


def once(problem=PROBLEM, rounds=ROUNDS, weights=WEIGHTS):
    return solve_once(problem, rounds, weights)


def assert_same(one, other):
    for mine, theirs in zip(one.vectors, other.vectors, strict=True):
        for a, b in zip(mine, theirs, strict=True):
            assert a.alphas.tobytes() == b.alphas.tobytes()
            assert a.alphas.flags.c_contiguous  # the order of sums depends on it
            assert b.alphas.flags.c_contiguous
            assert a.actions.tolist() == b.actions.tolist()


def test_a_plan_is_solved_once_and_read_back_to_the_last_bit(folder, solved):
    first, second = once(), once()
    assert len(solved) == 1
    assert_same(first, second)
    assert_same(second, solve(PROBLEM, rounds=ROUNDS, repeat_weights=WEIGHTS))
    assert len(list(folder.iterdir())) == 1


def test_any_other_problem_setting_or_code_is_solved_anew(folder, solved, monkeypatch):
    once()
    others = (
        {"problem": problem(target=0)},
        {"problem": problem(touch_cost=0.06)},
        {"problem": problem(TABLE[:, :, ::-1])},
        {"problem": problem(composition="independent")},
        {"problem": problem(discount=0.9)},
        {"rounds": (30, 31)},
        {"weights": WEIGHTS * 0.9},
        {"weights": WEIGHTS[:2]},
    )
    for number, other in enumerate(others, start=2):
        once(**other)
        assert len(solved) == number
    monkeypatch.setattr(cache, "_code", lambda: ("other code",))
    once()
    assert len(solved) == len(others) + 2


def test_the_code_of_a_plan_is_all_that_the_solver_imports_of_its_package():
    imported = {
        value.__module__
        for name in cache.CODE
        for value in vars(cache.sys.modules[name]).values()
        if getattr(value, "__module__", "").startswith("planners.pomdp.")
    }
    described = {"planners.pomdp.problem", "planners.pomdp.finite_horizon"}  # as arrays; another solver
    assert imported - described <= set(cache.CODE)


@pytest.mark.parametrize("content", ["empty", "half", "foreign", "pickle", "swapped", "actions"])
def test_a_broken_or_foreign_file_is_solved_again_with_a_sentence(folder, solved, content):
    expected = once()
    [path] = folder.iterdir()
    whole = path.read_bytes()
    if content == "swapped":
        once(problem(target=0))
        [other] = set(folder.iterdir()) - {path}
        path.write_bytes(other.read_bytes())
    elif content == "actions":
        header, arrays = cache.read_arrays(whole, cache._FORMAT)
        arrays["actions_0_0"] = arrays["actions_0_0"] + 7
        cache.write_arrays(path, cache._FORMAT, {"key": header["key"]}, arrays)
    else:

        class Harm:
            def __reduce__(self):
                return Path.touch, (folder / "harm",)

        broken = {"empty": b"", "half": whole[: len(whole) // 2], "foreign": b"PK, but no plan"}
        path.write_bytes(broken[content] if content in broken else pickle.dumps(Harm()))
    num_solved = len(solved)
    with pytest.warns(PlanCacheWarning, match="is no plan of this search .* solved again"):
        assert_same(once(), expected)
    assert len(solved) == num_solved + 1
    assert not (folder / "harm").exists()
    assert_same(once(), expected)  # the file was replaced
    assert len(solved) == num_solved + 1


def test_a_folder_that_cannot_be_written_costs_a_sentence_only(tmp_path, monkeypatch):
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv(cache.VARIABLE, str(tmp_path / "file" / "plans"))
    with pytest.warns(PlanCacheWarning, match="plan is not kept.*ACTIVETOUCH_PLANS=off"):
        once()


def test_the_folder_is_the_users_cache_or_the_one_that_is_named(tmp_path, monkeypatch, solved):
    monkeypatch.delenv(cache.VARIABLE)
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    assert plan_folder() == tmp_path / "activetouch" / "plans"
    monkeypatch.setenv("XDG_CACHE_HOME", "relative")
    monkeypatch.setenv("HOME", str(tmp_path / "home"))
    assert plan_folder() == tmp_path / "home" / ".cache" / "activetouch" / "plans"
    monkeypatch.setenv(cache.VARIABLE, "off")
    assert plan_folder() is None
    once()
    once()
    assert len(solved) == 2
    assert not list(tmp_path.iterdir())


def test_plans_that_were_not_used_for_long_make_room(folder, monkeypatch, solved):
    once()
    size = next(folder.iterdir()).stat().st_size
    monkeypatch.setattr(cache, "MOST_BYTES", int(2.5 * size))
    for cost in (0.06, 0.07, 0.08):
        once()  # used between the others
        once(problem(touch_cost=cost))
    assert len(list(folder.iterdir())) == 2
    once()
    assert len(solved) == 4


def test_another_process_follows_the_plan_of_the_default_planner(folder, solved):
    decider = PointBased(OutcomeTable(TABLE), rounds=ROUNDS)
    search = SearchProblem(("a", "b"), ("p", "q"), 2)
    first = decider.policy(search, 1)
    assert decider.policy(search, 1) is first
    _POLICIES.clear()  # as in a new process
    assert_same(decider.policy(search, 1), first)
    assert len(solved) == len(list(folder.iterdir())) == 1
    _POLICIES.clear()


def test_numbers_of_numpy_name_the_same_plan(folder, solved):
    for kind in (float, np.float32, np.float64):
        solve_once(problem(touch_cost=kind(0.0625), discount=kind(1.0)), ROUNDS, WEIGHTS)
    assert len(solved) == 1
