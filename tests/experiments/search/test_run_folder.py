"""Nothing finished is lost, and a failed write leaves the old file."""

import errno
import subprocess
import sys
from itertools import combinations
from pathlib import Path

import pytest

from belief.errors import CannotWrite, CorruptFile
from belief.files import atomic_path, sealed_json, unsealed_json, write_text
from experiments.command_line.arguments import BadArgument
from experiments.search.holdings import Holdings, Selection
from experiments.search.merge import Conflict, Merge, merge
from experiments.search.run_folder import BOUND, ORACLE, RunFolder, RunMismatch, Seconds, Shard, ShardKey

ROOT = Path(__file__).parents[3]
KEY = ShardKey("threshold", "hex-nut", 3)
LINES = [f'{{"decider": "threshold", "number": {number}}}\n' for number in range(25)]
TIME = Seconds(1.0, 2.0, 3.0, 40)
SHARD = Shard(LINES, TIME, "v1")


def a_run(path, keys=(KEY,), identity=None, shard=SHARD, episodes=100):
    """A folder with some shards."""
    folder = RunFolder(path)
    players = {}
    for key in keys:
        players.setdefault(key.decider, {})[key.target] = shard.made_by
    arguments = {"deciders": ["threshold"], "targets": ["hex-nut"], "episodes": episodes}
    folder.open(identity or {"seed": 1}, arguments, players)
    for key in keys:
        folder.write(key, shard)
    return folder


def test_a_write_that_fails_leaves_the_old_file_and_no_debris(tmp_path):
    path = tmp_path / "result.json"
    path.write_text("old")

    def write_until_the_disk_is_full():
        with atomic_path(path) as temporary:
            temporary.write_text("half of the n")
            raise OSError("disk full")

    with pytest.raises(OSError, match="disk full"):
        write_until_the_disk_is_full()
    assert path.read_text() == "old"
    assert list(tmp_path.iterdir()) == [path]


def test_a_write_makes_its_folder(tmp_path):
    with atomic_path(tmp_path / "a" / "b.txt") as temporary:
        temporary.write_text("new")
    assert (tmp_path / "a" / "b.txt").read_text() == "new"


def test_a_folder_goes_on_with_its_own_run_only(tmp_path):
    folder = RunFolder(tmp_path)
    folder.open({"seed": 1, "scene": "x"}, {})
    folder.open({"seed": 1, "scene": "x"}, {})
    with pytest.raises(RunMismatch, match="other scene, seed"):
        folder.open({"seed": 2, "scene": "y"}, {})


def test_of_two_runs_that_find_a_folder_empty_the_first_to_write_gets_it(tmp_path):
    first, second = RunFolder(tmp_path), RunFolder(tmp_path)
    assert first.require({"seed": 1}) is None
    assert second.require({"seed": 2}) is None
    first.open({"seed": 1}, {}, {})
    identity = {**first.read_run()["identity"], "seed": 2}
    with pytest.raises(RunMismatch, match="other seed"):  # it has looked before the first wrote
        second.write_run({**first.read_run(), "identity": identity})
    assert first.read_run()["identity"]["seed"] == 1


def copy_shard(source, target, key=KEY):
    for ending in ("jsonl", "seal.json"):
        path = target / "shards" / f"{key.stem}.{ending}"
        path.parent.mkdir(exist_ok=True)
        path.write_bytes((source / "shards" / path.name).read_bytes())


def test_a_shard_that_was_copied_from_another_run_counts_as_missing_for_every_reader(tmp_path, capsys):
    other, _ = a_run(tmp_path / "other", identity={"seed": 2}), a_run(tmp_path / "run", keys=())
    copy_shard(tmp_path / "other", tmp_path / "run")
    for folder in (RunFolder(tmp_path / "run"), a_run(tmp_path / "run", keys=())):
        assert not folder.has(KEY)
        assert folder.complete_keys() == []
        with pytest.raises(FileNotFoundError, match="of another run"):
            folder.lines(KEY)
        assert not Holdings.of(folder, {KEY.decider: {KEY.target: "v1"}}).shards
    assert merge([tmp_path / "run"], tmp_path / "merged") == []
    assert f"has shards of another run; they are left out: {KEY.stem}" in capsys.readouterr().err
    assert other.complete_keys() == [KEY]


def as_in_format_1(folder):
    """Rewrite a folder as versions wrote it whose seals did not name the run."""
    for path in [folder / "run.json", *folder.glob("shards/*.seal.json")]:
        fields = unsealed_json(path.read_text())
        path.write_text(sealed_json({name: fields[name] for name in fields if name not in ("format", "run")}))


def test_a_folder_of_an_earlier_version_is_read_continued_and_merged(tmp_path):
    a_run(tmp_path / "old")
    as_in_format_1(tmp_path / "old")
    assert RunFolder(tmp_path / "old").complete_keys() == [KEY]
    later = ShardKey(KEY.decider, KEY.target, 4)
    folder = a_run(tmp_path / "old", keys=(later,))
    assert folder.complete_keys() == [KEY, later]
    a_run(tmp_path / "new", keys=(ShardKey(KEY.decider, KEY.target, 5),))
    merged = merge([tmp_path / "new", tmp_path / "old"], tmp_path / "merged")
    assert len(merged) == 3
    copy_shard(tmp_path / "old", tmp_path / "new")  # but a new folder takes no shard that names no run
    assert not RunFolder(tmp_path / "new").has(KEY)
    foreign = ShardKey("threshold", "foreign", 0)
    a_run(tmp_path / "other", keys=(foreign,), identity={"seed": 2})
    copy_shard(tmp_path / "other", tmp_path / "old", foreign)  # nor an old one one that names another
    assert not RunFolder(tmp_path / "old").has(foreign)


def test_a_run_json_of_a_newer_format_is_refused(tmp_path):
    folder = a_run(tmp_path)
    write_text(tmp_path / "run.json", sealed_json({**folder.read_run(), "format": 99}))
    with pytest.raises(CorruptFile, match="its format is 99, and this version reads 1 to 2"):
        folder.read_run()


@pytest.mark.parametrize(
    "text", ["", '{"identity": {"se', "[]", "{}", "null", '{"identity": {}}', "\xff", sealed_json({"identity": {}})]
)
def test_a_torn_or_foreign_run_json_is_a_clear_error_and_stays(tmp_path, text):
    folder = a_run(tmp_path)
    (tmp_path / "run.json").write_text(text, encoding="latin-1")
    for read in (lambda: RunFolder(tmp_path).open({"seed": 1}, {}), RunFolder(tmp_path).read_run):
        with pytest.raises(CorruptFile, match=r"run\.json does not describe a run: .*\. Choose another --out; or"):
            read()
    assert (tmp_path / "run.json").read_text(encoding="latin-1") == text
    assert folder.has(KEY)


def test_a_folder_that_is_a_file_or_lies_in_one_is_a_clear_error(tmp_path):
    (tmp_path / "run").write_text("mine")
    for path in (tmp_path / "run", tmp_path / "run" / "deeper"):
        with pytest.raises(CannotWrite, match="is no folder, and none can be made there; choose another --out"):
            RunFolder(path).open({"seed": 1}, {})
    assert (tmp_path / "run").read_text() == "mine"


def test_episodes_that_are_not_there_say_how_to_play_them(tmp_path):
    for folder, words in (
        (tmp_path, "activetouch compare --out"),
        (tmp_path / "compare-coarse", "--scene coarse --out"),
    ):
        with pytest.raises(FileNotFoundError, match=words):
            RunFolder(folder).lines(ShardKey("threshold", "a", 0))
    run = RunFolder(tmp_path / "run")
    run.open({}, {})
    with pytest.raises(FileNotFoundError, match=r"activetouch compare --config .*run\.json"):
        run.lines(ShardKey("threshold", "a", 0))


def test_episodes_of_another_commit_are_kept_with_a_warning(tmp_path, monkeypatch):
    folder = RunFolder(tmp_path)
    assert folder.open({"seed": 1}, {}) is None
    monkeypatch.setattr("experiments.search.run_folder.commit_of_code", lambda: "another")
    assert "another" in folder.open({"seed": 1}, {})


def test_a_key_reads_back_from_its_file_name():
    assert ShardKey.from_stem(KEY.stem) == KEY


def test_a_shard_reads_back_as_it_was_written(tmp_path):
    folder = a_run(tmp_path)
    assert folder.has(KEY)
    assert folder.complete_keys() == [KEY]
    assert folder.read(KEY) == SHARD


@pytest.mark.parametrize("kept", [0, 1, 40, 400, -1])
def test_a_torn_shard_counts_as_missing_and_is_replaced(tmp_path, kept):
    folder = a_run(tmp_path)
    file = tmp_path / "shards" / f"{KEY.stem}.jsonl"
    file.write_bytes(file.read_bytes()[:kept])  # as a copy that broke off leaves it
    assert not folder.has(KEY)
    assert folder.complete_keys() == []
    folder.write(KEY, SHARD)
    assert folder.lines(KEY) == LINES


@pytest.mark.parametrize("text", ["", "{", "[]", '{"physics": 1'])
def test_a_shard_without_its_whole_seal_counts_as_missing(tmp_path, text):
    folder = a_run(tmp_path)
    (tmp_path / "shards" / f"{KEY.stem}.seal.json").write_text(text)
    assert not folder.has(KEY)


def no_room(*_):
    raise OSError(errno.ENOSPC, "No space left on device")


def test_a_full_disk_loses_nothing_and_says_what_to_do(tmp_path, monkeypatch):
    folder = a_run(tmp_path)
    other = ShardKey("threshold", "hex-nut", 4)
    monkeypatch.setattr("os.fsync", no_room)
    with pytest.raises(CannotWrite, match=r"No space left on device\. What was there is kept; make room"):
        folder.write(other, SHARD)
    with pytest.raises(CannotWrite, match="No space left"):
        folder.write_episodes(LINES)
    with pytest.raises(CannotWrite, match="No space left"):
        folder.write_run({})
    monkeypatch.undo()
    assert folder.complete_keys() == [KEY]
    assert folder.read_run()["identity"]["seed"] == 1
    assert not list(tmp_path.glob("**/.*"))  # no debris
    folder.write(other, SHARD)
    assert folder.complete_keys() == [KEY, other]


@pytest.mark.parametrize("name", ["seal.json", "jsonl"])
def test_a_disk_that_fills_up_between_seal_and_episodes_leaves_no_half_shard(tmp_path, monkeypatch, name):
    folder, write = a_run(tmp_path, keys=()), write_text

    def until_full(path, text):
        if path.name.endswith(name):
            raise CannotWrite(f"{path}: no space left")  # as the real one does
        write(path, text)

    monkeypatch.setattr("experiments.search.run_folder.write_text", until_full)
    with pytest.raises(CannotWrite):
        folder.write(KEY, SHARD)
    monkeypatch.undo()
    assert not folder.has(KEY)
    folder.write(KEY, SHARD)
    assert folder.has(KEY)


WRITER = """
import sys
from pathlib import Path

import numpy as np

from experiments.search.run_folder import RunFolder, Seconds, Shard, ShardKey

folder, order, lines = Path(sys.argv[1]), int(sys.argv[2]), sys.argv[3].splitlines(keepends=True)
for number in np.random.default_rng(order).permutation(20).tolist():
    RunFolder(folder).write(ShardKey("threshold", "hex-nut", number), Shard(lines, Seconds(1.0, 2.0, 3.0, 40), "v1"))
"""


def test_two_writers_at_once_leave_every_shard_once_and_whole(tmp_path):
    keys = [ShardKey("threshold", "hex-nut", number) for number in range(20)]
    folder = a_run(tmp_path, keys=())
    command = [sys.executable, "-c", WRITER, str(tmp_path)]
    writers = [subprocess.Popen([*command, order, "".join(LINES)], cwd=ROOT) for order in "01"]
    seen = 0
    while any(writer.poll() is None for writer in writers):  # a reader meanwhile never sees half a shard
        there = sorted((tmp_path / "shards").glob("[!.]*.jsonl"))
        assert all(file.read_text() == "".join(LINES) for file in there)
        seen = max(seen, len(there))
    for writer in writers:
        assert writer.wait() == 0
    assert folder.complete_keys() == keys
    assert len(list((tmp_path / "shards").iterdir())) == 2 * len(keys)


def test_merging_takes_every_whole_shard_once(tmp_path):
    keys = [ShardKey("threshold", "hex-nut", number) for number in range(4)]
    a_run(tmp_path / "a", keys[:3])
    a_run(tmp_path / "b", keys[2:])
    torn = tmp_path / "a" / "shards" / f"{keys[0].stem}.jsonl"
    torn.write_text(torn.read_text()[:-3])
    assert merge([tmp_path / "a", tmp_path / "b"], tmp_path / "c") == keys[1:]
    assert (tmp_path / "c" / "episodes.jsonl").read_text() == "".join(LINES * 3)
    assert RunFolder(tmp_path / "c").read_run()["arguments"]["targets"] == ["hex-nut"]
    assert torn.exists()


def test_the_report_of_merged_runs_leaves_out_no_episodes(tmp_path):
    a_run(tmp_path / "a", episodes=25)
    a_run(tmp_path / "b", [ShardKey("threshold", "hex-nut", 0), KEY], episodes=100)
    merge([tmp_path / "a", tmp_path / "b"], tmp_path / "c")
    assert RunFolder(tmp_path / "c").read_run()["arguments"]["episodes"] == 100


def test_merging_again_or_into_one_of_them_changes_nothing(tmp_path):
    a_run(tmp_path / "a", [ShardKey("x", "t", 0)])
    a_run(tmp_path / "b", [ShardKey("y", "t", 0)])
    merge([tmp_path / "a", tmp_path / "b"], tmp_path / "a")
    before = {path: path.read_bytes() for path in (tmp_path / "a").glob("**/*.json*")}
    merge([tmp_path / "b", tmp_path / "a", tmp_path / "b"], tmp_path / "a")
    assert {path: path.read_bytes() for path in before} == before
    assert RunFolder(tmp_path / "a").read_run()["arguments"]["deciders"] == ["x", "y"]


def test_runs_of_another_identity_are_not_merged(tmp_path):
    a_run(tmp_path / "a")
    a_run(tmp_path / "b", identity={"seed": 2})
    with pytest.raises(RunMismatch, match=r"other seed\. Only runs of the same seed"):
        merge([tmp_path / "a", tmp_path / "b"], tmp_path / "c")
    assert not (tmp_path / "c").exists()
    with pytest.raises(RunMismatch, match="b holds another run"):
        merge([tmp_path / "a"], tmp_path / "b")
    with pytest.raises(FileNotFoundError, match="holds no run"):
        merge([tmp_path / "a", tmp_path / "nowhere"], tmp_path / "c")


def test_different_episodes_under_one_key_are_a_conflict(tmp_path):
    a_run(tmp_path / "a")
    a_run(tmp_path / "b", shard=Shard([line.replace("threshold", "threshoId") for line in LINES], TIME, "v1"))
    with pytest.raises(Conflict, match="threshold-hex-nut-00003"):
        merge([tmp_path / "a", tmp_path / "b"], tmp_path / "c")


@pytest.mark.parametrize(
    ("place", "what"),
    [("run.json", b'"seed": 1'), ("shards/{}.jsonl", b'"number": 7'), ("shards/{}.seal.json", b'"num_touches": 40')],
)
def test_a_digit_that_flips_is_noticed_in_every_file_that_numbers_depend_on(tmp_path, place, what):
    folder = a_run(tmp_path)
    file = tmp_path / place.format(KEY.stem)
    assert file.read_bytes().count(what) == 1
    file.write_bytes(file.read_bytes().replace(what, what[:-1] + bytes([what[-1] ^ 1])))
    if place == "run.json":
        with pytest.raises(CorruptFile, match="SHA-256"):
            folder.read_run()
    else:
        assert folder.read(KEY) is None
        assert folder.complete_keys() == []


def test_a_partly_filled_shard_is_one_and_a_fuller_one_takes_its_place(tmp_path):
    folder = a_run(tmp_path, shard=Shard(LINES[:4], TIME, "v1"))
    assert folder.complete_keys() == [KEY]
    assert folder.has(KEY, "v1", 4)
    assert not folder.has(KEY, "v1", 5)
    assert not folder.has(KEY)
    a_run(tmp_path / "b")
    merge([tmp_path, tmp_path / "b"], tmp_path / "c")
    assert RunFolder(tmp_path / "c").read(KEY) == SHARD


def test_one_search_is_a_shard_and_the_bound_is_one_line(tmp_path):
    bound = ShardKey(BOUND, "t", 0)
    folder = a_run(tmp_path, [KEY, bound], shard=Shard(LINES[:1], TIME, "v1"))
    assert folder.read(KEY).lines == LINES[:1]
    assert not folder.has(KEY)
    assert folder.has(bound)
    for key, lines in ((bound, LINES[:2]), (KEY, [*LINES, LINES[0]]), (KEY, [])):  # too many, or none
        folder.write(key, Shard(lines, TIME, "v1"))
        assert folder.read(key) is None


def holdings(counts, oracle):
    found = {(d, t): [Shard(LINES[:1] * num, TIME, "v1")] for (d, t), num in counts.items() if num}
    return Holdings(found | {(ORACLE, t): [Shard(LINES[:1] * num, TIME, "v1")] for t, num in oracle.items() if num})


def test_the_largest_selection_is_the_largest_of_all_that_are_complete(rng):
    for _ in range(200):
        counts = {(d, t): int(rng.integers(4)) for d in "xyz" for t in "abcd"}
        oracle = {t: int(rng.integers(2, 4)) for t in "abcd"}
        known = {cell: num for cell, num in counts.items() if 0 < num <= oracle[cell[1]]}
        sizes = [
            num * len(some) * sum(all(known.get((d, t), 0) >= num for t in some) for d in "xyz")
            for num in (1, 2, 3)
            for length in range(1, 5)
            for some in combinations("abcd", length)
        ]
        if not known:
            continue
        (decider, target), num = next(iter(known.items()))
        asked = Selection((decider,), (target,), num)
        found = holdings(counts, oracle).largest(asked)
        assert found.size == max(sizes)
        assert all(known[d, t] >= found.episodes for d in found.deciders for t in found.targets)
        beyond = holdings(counts, oracle).beyond(found)
        assert sum(beyond.values()) == sum(counts.values()) - found.size
        assert all(num > 0 for num in beyond.values())


def test_deciders_of_different_targets_are_compared_on_those_they_share():
    counts = dict.fromkeys([("x", "a"), ("x", "b"), ("x", "c"), ("y", "a"), ("y", "b"), ("y", "d")], 5)
    found = holdings(counts, dict.fromkeys("abcd", 5)).largest(Selection(("x",), ("a",), 5))
    assert found == Selection(("x", "y"), ("a", "b"), 5)


def test_of_what_is_as_large_the_order_that_was_asked_for_is_kept():
    asked = Selection(("y", "x"), ("b", "a"), 2)
    counts = {(d, t): 2 for d in "xy" for t in "ab"}
    assert holdings(counts, {"a": 2, "b": 2}).largest(asked) == asked


def test_shards_count_up_to_the_first_that_is_missing_short_or_of_another_version(tmp_path):
    bound, full, short = ShardKey(BOUND, "t", 0), Shard(LINES, TIME, "v1"), Shard(LINES[:3], TIME, "v1")

    def held(*shards):
        folder = RunFolder(tmp_path / str(len(list(tmp_path.iterdir()))))
        folder.open({}, {})
        for number, shard in enumerate(shards):
            if shard is not None:
                folder.write(ShardKey("x", "t", number), shard)
        folder.write(bound, Shard(LINES[:1], TIME, "v1"))
        folder.write(ShardKey(BOUND, "t", 1), Shard(LINES[:1], TIME, "v1"))
        found = Holdings.of(folder, {"x": {"t": "v1"}, BOUND: {"t": "v1"}})
        assert len(found.lines((BOUND, "t"))) == 1
        return found.counts().get(("x", "t"))

    assert held(full, full, short, full) == 53
    assert held(full, None, full) == 25
    assert held(full, Shard(LINES, TIME, "v2"), full) == 25
    assert held(None, full) is None


def test_shards_of_an_earlier_version_are_kept_out_of_what_the_folder_holds(tmp_path):
    folder = a_run(tmp_path)
    folder.open({"seed": 1}, {}, {"threshold": {"hex-nut": "v2"}})
    assert not folder.has(KEY, "v2")
    assert folder.complete_keys() == []


def test_folders_of_two_versions_of_a_decider_are_not_merged(tmp_path):
    a_run(tmp_path / "a")
    a_run(tmp_path / "b", shard=Shard(LINES, TIME, "v2"))
    with pytest.raises(Conflict, match="threshold for hex-nut that another version"):
        merge([tmp_path / "a", tmp_path / "b"], tmp_path / "c")
    assert not (tmp_path / "c").exists()


def test_a_merge_says_what_it_holds_and_how_to_report_on_it(tmp_path, capsys):
    a_run(tmp_path / "a", [ShardKey("x", "t", 0), ShardKey("x", "u", 0), ShardKey(ORACLE, "t", 0)])
    a_run(tmp_path / "b", [ShardKey("x", "t", 1), ShardKey("y", "t", 0)])
    Merge((tmp_path / "a", tmp_path / "b"), tmp_path / "c").run()
    x, y, *_ = capsys.readouterr().out.splitlines()
    assert x == f"x: {3 * len(LINES)} episodes of t, u"
    assert y == f"y: {len(LINES)} episodes of t"


def test_merging_nothing_is_a_clear_error(tmp_path):
    with pytest.raises(BadArgument, match="activetouch merge runs/a runs/b"):
        Merge((), tmp_path).run()
    assert list(tmp_path.iterdir()) == []


def test_what_is_no_shard_among_shards_is_left_alone(tmp_path):
    folder = a_run(tmp_path)
    (tmp_path / "shards" / "notes.jsonl").write_text("mine")
    assert folder.complete_keys() == [KEY]


def test_a_merge_that_is_interrupted_leaves_no_folder_that_another_run_takes_as_its_own(tmp_path, monkeypatch):
    a_run(tmp_path / "a", [ShardKey("x", "t", number) for number in range(2)])
    written = RunFolder.write

    def write_one(folder, key, shard):
        written(folder, key, shard)
        raise KeyboardInterrupt

    monkeypatch.setattr(RunFolder, "write", write_one)
    with pytest.raises(KeyboardInterrupt):
        merge([tmp_path / "a"], tmp_path / "c")
    with pytest.raises(RunMismatch, match="other seed"):
        RunFolder(tmp_path / "c").require({"seed": 7})
