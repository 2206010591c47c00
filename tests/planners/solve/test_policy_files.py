"""Policies on disk: the same to the last bit, for one observation model, and no code."""

import io
import pickle
import zipfile

import numpy as np
import pytest

from belief.errors import CorruptFile
from planners.solve import SearchTouchProblem, TouchProblem, load_policy, save_policy, solve
from planners.solve.policy_files import CorruptPolicy, PolicyMismatch

TABLE = np.array([[[0.9, 0.1], [0.1, 0.9]]])
ROUNDS = (50, 50)


@pytest.fixture(params=["one object", "search", "independent"])
def policy(request):
    problems = {
        "one object": TouchProblem(TABLE, [0.3, 0.7], 0, 0.05),
        "search": SearchTouchProblem(TABLE, 2, "distinct", 1, 0.05),
        "independent": SearchTouchProblem(TABLE, 3, "independent", 1, 0.05, prior=[0.2, 0.8], discount=0.9),
    }
    return solve(problems[request.param], rounds=ROUNDS)


def test_a_policy_that_was_read_back_is_the_same(policy, tmp_path):
    save_policy(tmp_path / "policy.npz", policy)
    again = load_policy(tmp_path / "policy.npz", TABLE)
    assert again.lower_bound == policy.lower_bound
    assert again.problem.touch_cost == policy.problem.touch_cost
    assert again.problem.discount == policy.problem.discount
    assert (again.problem.prior == policy.problem.prior).all()
    assert type(again) is type(policy)
    assert list(tmp_path.iterdir()) == [tmp_path / "policy.npz"]


def test_another_observation_model_is_refused(policy, tmp_path):
    save_policy(tmp_path / "policy.npz", policy)
    with pytest.raises(PolicyMismatch, match="solve again"):
        load_policy(tmp_path / "policy.npz", TABLE[:, ::-1])


def test_truncated_and_foreign_files_are_refused(policy, tmp_path):
    file = tmp_path / "policy.npz"
    save_policy(file, policy)
    whole = file.read_bytes()
    for damaged in (b"", b"no policy", whole[: len(whole) // 2], whole[:-1]):
        file.write_bytes(damaged)
        with pytest.raises(CorruptPolicy):
            load_policy(file)


def test_a_tampered_table_is_noticed(policy, tmp_path):
    file = tmp_path / "policy.npz"
    save_policy(file, policy)
    with np.load(file) as arrays:
        changed = dict(arrays)
    changed["outcome_probs"] = TABLE[:, ::-1]
    np.savez(file, **changed)
    with pytest.raises(CorruptPolicy, match="changed"):
        load_policy(file)


@pytest.mark.parametrize("name", ["prior", "alphas_0_0", "actions_0_0"])
def test_any_array_that_was_changed_is_noticed(policy, name, tmp_path):
    file = tmp_path / "policy.npz"
    save_policy(file, policy)
    with np.load(file) as arrays:
        changed = dict(arrays)
    changed[name] = changed[name] + np.eye(1, changed[name].size, dtype=changed[name].dtype).reshape(
        changed[name].shape
    )
    np.savez(file, **changed)
    with pytest.raises(CorruptPolicy, match="changed"):
        load_policy(file)


def test_a_digit_of_the_header_that_was_changed_is_noticed(policy, tmp_path):
    file = tmp_path / "policy.npz"
    save_policy(file, policy)
    with np.load(file) as arrays:
        changed = dict(arrays)
    changed["header"] = np.array(str(changed["header"]).replace('"touch_cost": 0.05', '"touch_cost": 0.06'))
    np.savez(file, **changed)
    with pytest.raises(CorruptPolicy, match="changed"):
        load_policy(file)


def test_any_damage_is_answered_with_one_error_or_does_no_harm(policy, tmp_path):
    file = tmp_path / "policy.npz"
    save_policy(file, policy)
    whole, rng = file.read_bytes(), np.random.default_rng(0)
    refused, messages = 0, set()
    for place in rng.integers(len(whole), size=150).tolist():
        flipped = bytes([whole[place] ^ (1 << rng.integers(8))])
        for damaged in (whole[:place], whole[place:], whole[:place] + flipped + whole[place + 1 :]):
            file.write_bytes(damaged)
            try:
                assert load_policy(file).lower_bound == policy.lower_bound  # a bit that is never read, of a time stamp
            except CorruptPolicy as error:
                messages.add(str(error).split(" cannot be read")[0])
                refused += 1
    assert refused > 0.85 * 450
    assert messages == {str(file)}
    assert issubclass(CorruptPolicy, CorruptFile)


def test_a_file_that_would_unpack_to_more_than_a_policy_can_need_is_refused(tmp_path, monkeypatch):
    monkeypatch.setattr("planners.solve.policy_files._MOST_BYTES", 1_000_000)
    file = tmp_path / "policy.npz"
    with zipfile.ZipFile(file, "w", zipfile.ZIP_DEFLATED) as archive, archive.open("header.npy", "w") as member:
        for _ in range(3):
            member.write(bytes(1_000_000))
    assert file.stat().st_size < 100_000
    with pytest.raises(CorruptPolicy, match="unpack to"):
        load_policy(file)


def test_a_pickle_is_not_opened(tmp_path):
    class Bomb:
        def __reduce__(self):
            return (pytest.fail, ("code from the file was run",))

    buffer = io.BytesIO()
    np.save(buffer, np.array([Bomb()], object), allow_pickle=True)
    for content in (buffer.getvalue(), pickle.dumps(Bomb())):
        (tmp_path / "policy.npz").write_bytes(content)
        with pytest.raises(CorruptPolicy):
            load_policy(tmp_path / "policy.npz")


def test_a_file_that_is_not_there_is_named(tmp_path):
    with pytest.raises(FileNotFoundError, match="nothing"):
        load_policy(tmp_path / "nothing.npz")


def test_a_number_of_objects_that_numpy_counted_is_written(tmp_path):
    policy = solve(SearchTouchProblem(TABLE, np.int64(2), "distinct", 1, 0.05), rounds=ROUNDS)
    save_policy(tmp_path / "policy.npz", policy)
    assert load_policy(tmp_path / "policy.npz").problem.num_objects == 2
