"""A stranger's agent is scored, honest files pass their check, and forged ones do not."""

import gzip
import json
import shutil
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from belief.codec import to_fields
from belief.errors import ActiveTouchError, BrokenContract, UnknownName
from belief.statistics import paired_bootstrap
from experiments.command_line.arguments import BadArgument
from experiments.search.benchmark import cards, hidden
from experiments.search.benchmark.cards import Card
from experiments.search.benchmark.checking import Recorded, _resampled_means, check, groups, tables
from experiments.search.benchmark.command import Benchmark, Refused
from experiments.search.benchmark.hidden import HiddenSeeds
from experiments.search.benchmark.submission import (
    DEVELOPMENT,
    Header,
    Played,
    PlayedBatch,
    Submission,
    processor,
)
from experiments.search.play import play_episodes
from planners.fingerprint import code_versions
from planners.process_agent import COMMAND_FILE, ProcessAgent, is_without_network
from tests.test_numbers import TASKS, has_its_tables

pytestmark = pytest.mark.mujoco
EXAMPLES = Path(__file__).parents[3] / "examples" / "benchmark"
RECORDS = Path(__file__).parents[3] / "records" / "submissions"
CARELESS = "information_gain(confirm=0.6, reject=0.4)"  # which fails now and then
DIGESTS = {  # of the content of each card: a change of a task is another name
    "bodies-v1": "d712eae0c5921c9d84f55d9deabebc5c204880af4103098da5141920d41e1e21",
    "coarse-v1": "f3c17a972d0145adf7b210da1857585ecc15b9e47b877f3626fc1fbf77a9202c",
    "drawer-v1": "d8379669230ef6a805c9b574d839b968dafe8f674168679a27aaef94d8bfd463",
    "gel-v1": "c9118d43d7fc0edb4519b2ac06775f6c9cfe94f55df378a49a410d036d55124b",
    "hard-v1": "ab0898fd665c999d42727eb8ec3c88e6033fb773cf5ed61dcddf2f769d1ad35b",
    "keyed-v1": "6ff2d9e265172c7860b7a0f7f500d078720c1121878fdd5c79d38c89e04e92f5",
    "many-v1": "6fafac230dcae8799780405382924e6f29ed5b739194f2e125272810e31f44f7",
    "paper-v1": "b6d8405da91599f43fa85f8b4666a3c02fb3c2392ba0112adc7d82cf1bd2510b",
}


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A task of 26 searches for two shapes, in place of those of the package."""
    folder = tmp_path_factory.mktemp("tasks")
    card = Card.named("coarse-v1")
    setting = {**card.setting, "choice": {"scene": "coarse", "fidelity": "quasistatic"}}
    card = replace(card, name="small-v1", setting=setting, targets=("cube", "cone"), episodes=13)
    (folder / "small-v1.json").write_text(json.dumps(to_fields(card)))
    (folder / "other-v1.json").write_text(json.dumps(to_fields(replace(card, name="other-v1", seed=3))))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(cards, "TASKS", folder)
        yield card


@pytest.fixture(scope="module")
def honest(small, tmp_path_factory):
    """Files of three agents."""
    folder = tmp_path_factory.mktemp("files")
    paths = {name: folder / f"{number}.gz" for number, name in enumerate((CARELESS, "information_gain", "fixed_poses"))}
    for name, path in paths.items():
        Benchmark(agent=name, task="small-v1", out=path, jobs=1).run()
    return paths


def test_a_task_does_not_change_under_its_name():
    assert {card.name: card.digest for card in Card.every()} == DIGESTS
    for card in Card.every():
        assert card.name.rpartition("-v")[2].isdigit()
        assert set(card.sought) <= set(card.tray.made.shape_labels if card.tray else card.problem.shape_labels)


def test_the_table_of_the_tasks_is_that_of_the_committed_files():
    assert has_its_tables(TASKS), "run python docs/generate/tables.py"


SUBMITTED = sorted({*RECORDS.glob("coarse-v1/*.gz"), *RECORDS.glob("[!b]*/information_*.jsonl.gz")})
"""All but the tasks whose sensor takes minutes, and agents that make no touch."""
SLOW = ("drawer-v1", "hard-v1", "keyed-v1", "many-v1")
"""Tasks whose sensor takes five seconds and more."""
AGAIN = ("fixed_poses", "information_gain")
"""Agents some of whose searches are played again here; `make nightly` does it for all files."""


@pytest.mark.parametrize("path", SUBMITTED, ids=lambda path: f"{path.parent.name}-{path.name}")
def test_a_committed_file_passes(path):
    is_played_again = path.parent.name not in SLOW and path.name.partition(".")[0] in AGAIN
    [entry] = check([path], share=0.05 if is_played_again else 0.0, jobs=1)
    assert entry.faults == ()
    assert entry.submission.header.task == path.parent.name


def test_a_task_of_another_sensor_is_not_played(small):
    with pytest.raises(BadArgument, match="is that of the sensor 000"):
        replace(small, sensor_sha256="000").run({"threshold": "threshold"}, 1)


def test_honest_files_pass_and_the_table_tells_agents_apart_or_not(honest, capsys):
    Benchmark(check=tuple(honest.values()), jobs=1).run()
    said = capsys.readouterr().out
    assert "Refused" not in said
    assert said.count("26 of 26 searches played again") == 3
    [results, beside] = tables(check([*honest.values()], 0.0))
    assert {row[0] for row in results.rows} == {*honest}
    assert len(beside.rows) == 2
    [small] = {len(Submission.load(path).searches) for path in honest.values()}
    assert small == 26


def test_the_command_says_why_an_agent_fails(small, tmp_path, capsys):
    Benchmark(agent=CARELESS, task="small-v1", out=tmp_path / "a.gz", jobs=1).run()
    failed = sum(not search.success for search in Submission.load(tmp_path / "a.gz").searches)
    assert f"Why {CARELESS} fails in {failed}: " in capsys.readouterr().out


def test_a_score_stands_beside_those_of_a_baseline_and_of_a_guess(small, tmp_path, monkeypatch, capsys):
    known = replace(small, name="coarse-v1").beside()
    assert [row[0] for row in known.rows] == ["information_gain", "random_confirm"]
    assert not small.beside().rows
    (tmp_path / "known.json").write_text(json.dumps({"small-v1": {"baseline": [0.875, 3.0, 0.5]}}))
    monkeypatch.setattr(cards, "BASELINES", tmp_path / "known.json")
    Benchmark(agent=CARELESS, task="small-v1", out=tmp_path / "a.gz", jobs=1).run()
    assert "baseline    0.875     3.00   0.500" in capsys.readouterr().out


def test_a_small_share_plays_a_batch_again(honest):
    entries = [check([honest[CARELESS]], share=1e-9, jobs=1)[0].replayed for _ in range(2)]
    assert entries == [13, 13]  # one of two batches


def test_what_is_played_on_another_processor_passes_within_rounding(honest, tmp_path):
    found = Submission.load(honest[CARELESS])
    searches = [
        replace(one, touches="f" * 15 + str(number), probs=tuple(min(prob + 1e-4, 1.0) for prob in one.probs))
        for number, one in enumerate(found.batches[0].searches)
    ]
    there = [replace(found.batches[0], searches=tuple(searches)), found.batches[1]]
    other = Submission(replace(found.header, processor="abacus"), there)
    other.save(tmp_path / "other.gz")
    Submission(found.header, there).save(tmp_path / "here.gz")
    one, here = check([tmp_path / "other.gz", tmp_path / "here.gz"], jobs=1)
    assert not one.faults
    assert "another kind of processor" in one.notes[0]
    assert "other touches or beliefs" in here.faults[0]


def forgeries(honest, rng):
    """Forty changed submissions, with what was changed, sealed anew."""

    def changed(batch, number, **fields):
        batches = list(found.batches)
        searches = list(batches[batch].searches)
        searches[number] = replace(searches[number], **fields)
        batches[batch] = replace(batches[batch], searches=tuple(searches))
        return batches

    def timed(batches):
        """Times with the number of touches that the searches now have."""
        return [
            replace(b, seconds=replace(b.seconds, num_touches=sum(s.num_touches for s in b.searches))) for b in batches
        ]

    found = Submission.load(honest[CARELESS])
    every = [(b, n) for b, batch in enumerate(found.batches) for n in range(len(batch.searches))]
    losing = [place for place in every if not found.batches[place[0]].searches[place[1]].success]
    longer = [place for place in every if found.batches[place[0]].searches[place[1]].num_touches > 1]
    assert len(losing) >= 3

    def one_of(places):
        return places[rng.integers(len(places))]

    for b, n in losing[:3]:
        yield "outcome", found.header, changed(b, n, success=True)
        yield "how it ended", found.header, changed(b, n, outcome="exhausted")
    for _ in range(4):
        b, n = one_of(longer)
        one = found.batches[b].searches[n]
        at = next(i for i, action in enumerate(one.actions) if isinstance(action, int))
        less = one.actions[:at] + one.actions[at + 1 :], one.probs[:at] + one.probs[at + 1 :]
        yield "fewer touches", found.header, timed(changed(b, n, actions=less[0], probs=less[1]))
        other = (*one.actions[:at], (one.actions[at] + 1) % 6, *one.actions[at + 1 :])
        yield "another pose", found.header, changed(b, n, actions=other)
        yield "more certain", found.header, changed(b, n, probs=(*one.probs[:-1], min(one.probs[-1] + 0.01, 0.999)))
        yield "touches", found.header, changed(b, n, touches="0" * 16)
    for b, n in losing[:3]:
        won = next(one for one in found.batches[b].searches if one.success)
        yield "copied search", found.header, timed(changed(b, n, **vars(won)))
        dropped = [one for number, one in enumerate(found.batches[b].searches) if number != n]
        batches = list(found.batches)
        batches[b] = replace(batches[b], searches=tuple(dropped))
        yield "left out", found.header, timed(batches)
        batches[b] = replace(batches[b], searches=(*dropped, won))
        yield "left out and filled up", found.header, timed(batches)
    first, second = found.batches
    yield "renumbered", found.header, [replace(first, first=1), second]
    yield "other order", found.header, [replace(first, searches=first.searches[::-1]), second]
    yield "targets", found.header, [replace(first, target=second.target), replace(second, target=first.target)]
    yield "targets and order", found.header, [replace(second, target="cube"), replace(first, target="cone")]
    yield "seeds", replace(found.header, task="other-v1", task_sha256=Card.named("other-v1").digest), found.batches
    yield "task", replace(found.header, task_sha256="0" * 64), found.batches
    yield "hidden", replace(found.header, seeds="0" * 64), found.batches
    yield "name", replace(found.header, agent="information_gain"), found.batches
    yield "a name without policies", replace(found.header, agent="ppo"), found.batches
    for header in ({"elapsed": 1e-3}, {"jobs": 0}, {"elapsed": 1e6}):
        yield "time", replace(found.header, **header), found.batches
    for seconds in ({"decision": -1.0}, {"decision": 0.0}, {"num_touches": 1}, {"physics": 1e-6, "network": 1e-6}):
        batches = [replace(batch, seconds=replace(batch.seconds, **seconds)) for batch in found.batches]
        yield "times", found.header, batches


@pytest.mark.slow
def test_forged_files_are_refused(honest, tmp_path):
    told = list(forgeries(honest, np.random.default_rng(0)))
    paths = []
    for number, (name, header, batches) in enumerate(told):
        paths.append(tmp_path / f"{number}-{name}.gz")
        Submission(header, batches).save(paths[-1])
    assert len(paths) >= 40
    passed = [entry.path.name for entry in check(paths, jobs=1) if not entry.faults]
    assert passed == []


def test_an_agent_that_knows_the_objects_without_touching_them_is_found(small, tmp_path):
    card = replace(small, name="known-v1", episodes=50)
    (cards.TASKS / "known-v1.json").write_text(json.dumps(to_fields(card)))
    run = card.run({"guesses": "random_confirm"}, 1)
    labels = card.problem.shape_labels

    class Knows:
        def begin(self, world, seed):
            place = world.arrangement.index(seed[1])
            return Recorded({seed: ("reject",) * place + ("confirm",)}).begin(world, seed)

        def decide(self, info, rng):
            raise AssertionError("it plays episodes")

    for name, decider in (("knows", Knows()), ("guesses", run.deciders["guesses"])):
        batches = []
        for target, numbers in card.batches():
            episodes, seconds = play_episodes(run.searches, decider, labels.index(target), numbers)
            batches.append(PlayedBatch(target, numbers.start, seconds, tuple(map(Played.of, episodes))))
        about = {"agent": "mine", "seeds": DEVELOPMENT, "versions": code_versions(), "processor": processor()}
        header = Header(1, card.name, card.digest, words="", jobs=1, elapsed=100.0, **about)
        Submission(header, batches).save(tmp_path / f"{name}.gz")
    knows, guesses = check([tmp_path / "knows.gz", tmp_path / "guesses.gz"], jobs=1)
    assert ["without a touch" in fault for fault in knows.faults] == [True]
    assert not guesses.faults
    (cards.TASKS / "known-v1.json").unlink()


def test_a_file_that_was_edited_without_a_new_seal_is_refused(honest, tmp_path):
    text = gzip.decompress(honest[CARELESS].read_bytes())
    for number, (old, new) in enumerate([(b"false", b"true"), (b'"agent": "', b'"agent": "x'), (b"\n", b"\n\n")]):
        edited = tmp_path / f"{number}.gz"
        edited.write_bytes(gzip.compress(text.replace(old, new, 1)))
        [entry] = check([edited])
        assert entry.faults


def test_a_copy_is_refused_and_the_same_searches_are_noted(honest, tmp_path):
    found = Submission.load(honest["fixed_poses"])
    Submission(replace(found.header, agent="mine"), found.batches).save(tmp_path / "copy.gz")
    slower = [replace(b, seconds=replace(b.seconds, decision=1.1 * b.seconds.decision)) for b in found.batches]
    Submission(replace(found.header, agent="mine", elapsed=found.header.elapsed + 1.0), slower).save(
        tmp_path / "same.gz"
    )
    _, copy, same = check([honest["fixed_poses"], tmp_path / "copy.gz", tmp_path / "same.gz"], 0.0)
    assert "is a copy of" in copy.faults[-1]
    assert "all its searches are those of" in same.notes[0]
    assert not same.faults


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"no gzip",
        gzip.compress(b""),
        gzip.compress(b"{}\n"),
        gzip.compress(b"[" * 100_000),
        gzip.compress(b"\xff\n"),
        gzip.compress(b"0" * (65 << 20)),
        gzip.compress(b"{}\n")[:-4],
        b"0" * (9 << 20),
    ],
    ids=range(9),
)
def test_a_file_that_holds_no_submission_says_so(content, tmp_path):
    (tmp_path / "bad.gz").write_bytes(content)
    with pytest.raises(BadArgument, match="holds no submission"):
        Submission.load(tmp_path / "bad.gz")
    with pytest.raises(Refused, match="1 of 1 files refused"):
        Benchmark(check=(tmp_path / "bad.gz",), jobs=1).run()


def test_values_of_other_types_are_refused_and_code_that_a_file_names_is_not_run(honest, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "own_code.py").write_text("open('it_ran', 'w').close()")
    found = Submission.load(honest[CARELESS])
    named = Submission(replace(found.header, agent="own_code:attribute"), found.batches)
    named.save(tmp_path / "named.gz")
    assert not check([tmp_path / "named.gz"], jobs=1)[0].faults
    assert not (tmp_path / "it_ran").exists()
    body = gzip.decompress(named.content()).decode().splitlines()
    fields = json.loads(body[1])
    for name, value in {"target": 3, "first": "0", "seconds": [], "searches": [{}], "more": 1}.items():
        with pytest.raises(ActiveTouchError):
            cards.from_fields(PlayedBatch, {**fields, name: value})
    with pytest.raises(ActiveTouchError):
        cards.from_fields(Header, {**to_fields(found.header), "jobs": 1.5})
    for value in ("agent\x1b[31m", "a" * 500):
        Submission(replace(found.header, words=value), found.batches).save(tmp_path / "words.gz")
        with pytest.raises(BadArgument, match="of the header"):
            Submission.load(tmp_path / "words.gz")


def test_letters_are_those_of_sets_without_a_difference():
    rng = np.random.default_rng(1)
    base = rng.normal(size=300)
    shifts = {"w": 0.0, "x": 0.045, "y": 0.09, "z": 2.0}
    values = {name: base + shift + rng.normal(scale=0.3, size=300) for name, shift in shifts.items()}
    letters = groups(values, np.random.default_rng(0))
    assert letters["z"] == "a"
    assert not set(letters["y"]) & set(letters["w"])
    assert set(letters["x"]) & set(letters["y"])
    assert set(letters["x"]) & set(letters["w"])
    assert groups({"alone": base}, rng) == {"alone": "a"}


def test_intervals_of_agents_that_share_their_resamples_are_those_of_pairs():
    table = np.random.default_rng(0).normal((0.2, 0.0, -0.3), size=(150, 3))
    means = _resampled_means(table, np.random.default_rng(1), 8000)
    for one, other in ((0, 1), (1, 2)):
        shared = np.quantile(means[:, one] - means[:, other], [0.025, 0.975])
        _, *plain = paired_bootstrap(table[:, one], table[:, other], np.random.default_rng(2), 0.95, 8000)
        assert shared == pytest.approx(plain, abs=0.015)  # of widths of about 0.45


AGENT = """
import json, sys
for line in sys.stdin:
    asked = json.loads(line)
    if asked["do"] == "hello":
        answer = {HELLO}
    else:
        answer = {ANSWER}
    print(json.dumps(answer), flush=True)
"""


def program(folder, answer, hello='{"ok": True}'):
    """The command of a program that answers with an expression of what was asked."""
    (folder / "agent.py").write_text(AGENT.replace("{ANSWER}", answer).replace("{HELLO}", hello))
    return f"{sys.executable} agent.py"


def played(small, agent, path, **options):
    Benchmark(agent=agent, task="small-v1", out=path, jobs=1, **options).run()
    return Submission.load(path)


def test_a_program_in_python_plays_as_the_function_does(small, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    shutil.copy(EXAMPLES / "in_turn.py", tmp_path)
    body = "__import__('in_turn').act(__import__('numpy').array(asked['observation']))"
    command = program(tmp_path, f"{{'action': {body}}}", '{"ok": True, "state": "posterior"}')
    one = played(small, f"process:{command}", tmp_path / "one.gz")
    other = played(small, "policy:in_turn:act(state='posterior')", tmp_path / "other.gz")
    assert one.searches == other.searches
    assert not [entry.faults for entry in check([tmp_path / "one.gz", tmp_path / "other.gz"], jobs=1) if entry.faults]


def test_a_program_sees_the_image_and_which_search_it_is_in(small, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    answer = """(open("seen", "a").write(line), {"action": "touch", "pose": "y90"} if not asked["touches"]
        else {"action": "confirm"})[1]"""
    found = played(small, f"process:{program(tmp_path, answer)}", tmp_path / "one.gz")
    seen = [json.loads(line) for line in (tmp_path / "seen").read_text().splitlines()]
    assert {row["episode"] for row in seen} == set(range(26))
    for row in seen:
        assert (row["image"] is None) == (row["touches"] == [])
        assert sum(row["belief"].values()) == pytest.approx(1.0)
    assert np.shape(seen[-1]["image"]) == Card.named("small-v1").rules.scene.image_shape
    assert all(search.num_touches == 1 for search in found.searches)


@pytest.mark.skipif(
    shutil.which("perl") is None or subprocess.run(["perl", "-MJSON::PP", "-e", "1"], check=False).returncode != 0,
    reason="needs perl with JSON::PP",
)
def test_a_folder_with_a_program_in_perl_plays_hidden_seeds(small, tmp_path, monkeypatch):
    shutil.copy(EXAMPLES / "agent.pl", tmp_path)
    (tmp_path / COMMAND_FILE).write_text("perl agent.pl\n")
    monkeypatch.setattr(hidden, "COMMITMENTS", tmp_path / "commitments.json")
    Benchmark(commit="9.9", seeds=tmp_path / "secret.json").run()
    (tmp_path / "commitments.json").write_text("{}")
    with pytest.raises(BadArgument, match="there is none of this release"):
        HiddenSeeds.load(tmp_path / "secret.json")
    secret = HiddenSeeds(**json.loads((tmp_path / "secret.json").read_text()))
    (tmp_path / "commitments.json").write_text(json.dumps({"9.9": secret.digest}))
    path = tmp_path / "perl.gz"
    found = played(small, f"folder:{tmp_path}", path, seeds=tmp_path / "secret.json")
    assert found.header.seeds == secret.digest
    assert np.mean([search.success for search in found.searches]) > 0.8
    [entry] = check([path], hidden=secret, jobs=1)
    assert not entry.faults
    assert "its seeds are hidden" in check([path])[0].faults[0]
    with pytest.raises(FileExistsError):
        HiddenSeeds.create(tmp_path / "secret.json", "9.9")


def test_hidden_seeds_are_of_one_task_and_of_many_bits(small):
    one, other = HiddenSeeds("1", "0" * 64), HiddenSeeds("1", "1" * 64)
    seeds = {one.seed(small), other.seed(small), one.seed(Card.named("other-v1"))}
    assert len(seeds) == 3
    assert max(seeds) > 2**100
    for secret in ("", "x" * 64, "0" * 63):
        with pytest.raises(BadArgument, match="hexadecimal"):
            HiddenSeeds("1", secret)


def test_a_limited_agent_has_no_network_no_environment_and_little_memory(small, tmp_path, monkeypatch):
    pytest.importorskip("resource")
    monkeypatch.setenv("A_SECRET", "1")
    lines = """
import os, resource, socket
try:
    socket.create_connection(("127.0.0.1", PORT), timeout=2)
    reached = True
except OSError:
    reached = False
"""
    import socket

    with socket.create_server(("127.0.0.1", 0)) as server:
        command = program(tmp_path, "{'action': 'confirm'}")
        text = lines.replace("PORT", str(server.getsockname()[1])) + (tmp_path / "agent.py").read_text()
        told = "[reached, os.environ.get('A_SECRET'), resource.getrlimit(resource.RLIMIT_FSIZE)[0]]"
        text = text.replace("import json, sys", f"import json, sys\nopen('seen', 'w').write(json.dumps({told}))")
        (tmp_path / "agent.py").write_text(text)
        (tmp_path / COMMAND_FILE).write_text(command)
        played(small, f"folder:{tmp_path}", tmp_path / "one.gz")
    reached, secret, size = json.loads((tmp_path / "seen").read_text())
    assert reached is not is_without_network()
    assert secret is None
    assert size == 64 << 20


@pytest.mark.parametrize(
    ("answer", "hello", "said"),
    [
        ("{'action': 'touch', 'pose': 'nowhere'}", "{}", "an answer is"),
        ("{'action': 99}", "{}", "an answer is"),
        ("{'action': True}", "{}", "an answer is"),
        ("{'ok': False, 'message': 'lost'}", "{}", "lost"),
        ("[1]", "{}", "answered"),
        ("sys.exit(3)", "{}", "ended, or gave no answer"),
        ("'a' * 100_000", "{}", "answered no line of JSON"),
        ("__import__('time').sleep(60)", "{}", "gave no answer within"),
        ("{}", "{'state': 'all'}", '"state"'),
        ("{}", "{'touch_limit': 0}", '"touch_limit"'),
    ],
)
def test_a_program_that_answers_wrongly_is_named(answer, hello, said, small, tmp_path, monkeypatch):
    monkeypatch.setattr("planners.process_agent._PATIENCE", 2.0)
    agent = ProcessAgent(program(tmp_path, answer, hello), str(tmp_path))
    with pytest.raises(BrokenContract, match=said):
        small.run({"it": agent}, 1).play(1)


def test_an_agent_that_cannot_start_is_named(small, tmp_path):
    for agent in (ProcessAgent("no-such-program"), ProcessAgent("")):
        with pytest.raises(BrokenContract, match=r"cannot be started|is empty"):
            small.run({"it": agent}, 1)
    with pytest.raises(BrokenContract, match=COMMAND_FILE):
        ProcessAgent.of_folder(tmp_path)


def test_the_command_lists_tasks_and_refuses_what_does_not_fit(honest, tmp_path, capsys):
    Benchmark().run()
    assert "small-v1" in capsys.readouterr().out
    with pytest.raises(UnknownName):
        Benchmark(agent="threshold", task="smal-v1", out=tmp_path / "a.gz").run()
    with pytest.raises(BadArgument, match="one at a time"):
        Benchmark(agent="threshold", check=(honest[CARELESS],)).run()
    with pytest.raises(BadArgument, match="--words"):
        Benchmark(agent="threshold", task="small-v1", words="a\nb", out=tmp_path / "a.gz").run()
    with pytest.raises(BadArgument, match="--commit needs"):
        Benchmark(commit="1").run()


def test_a_search_keeps_what_it_did():
    search = Played((1, "reject", 2, 3), (0.2, 0.1, 0.2, 0.3), "", "truncated", False)
    assert search.num_touches == 2


def test_the_file_of_another_agent_is_not_written_over(small, honest, tmp_path):
    path = tmp_path / "mine.jsonl.gz"
    shutil.copy(next(iter(honest.values())), path)
    before, agent = path.read_bytes(), Submission.load(path).header.agent
    with pytest.raises(BadArgument, match="holds the searches of") as refused:
        Benchmark(agent="random_confirm", task=small.name, out=path, jobs=1).run()
    assert agent in str(refused.value)
    assert path.read_bytes() == before
