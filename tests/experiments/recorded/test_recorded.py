"""``recorded``: from files to a report, on bts3 and on a user's CSV."""

import json
import re
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest

from activetouch import RecordedSensor, TactileSensor
from activetouch.errors import BadRecording
from activetouch.recorded import RecordedTouches, check_recorded, read_recorded, reader
from activetouch.recorded.checking import Leaks
from activetouch.recorded.touches import splits_of
from belief.errors import BrokenContract, CannotWrite, InvalidArgument, UnknownName
from experiments.command_line.arguments import BadArgument
from experiments.recorded.play import RANDOM, Named
from experiments.recorded.recorded import Recorded, recorded
from experiments.recorded.report import best_of, by_object, trust
from experiments.search.run import RunMismatch
from planners.episode import Episode, Outcome
from planners.search import Identification

BTS3 = Path(__file__).parents[2] / "fixtures" / "bts3"


@pytest.fixture(scope="module")
def own(tmp_path_factory):
    """A user's CSV, in which objects differ by action 'rub' more than by 'press', and its results."""
    folder = tmp_path_factory.mktemp("own")
    rng = np.random.default_rng(0)
    lines = ["object,action,session," + ",".join(f"f{i}" for i in range(5))]
    means = rng.normal(size=(6, 5))
    for session in range(8):
        for thing in range(6):
            for action, scale in (("press", 0.4), ("rub", 1.5)):
                row = scale * means[thing] + 0.5 * rng.normal(size=5)
                lines.append(f"thing{thing},{action},{session}," + ",".join(map(str, row)))
    (folder / "touches.csv").write_text("\n".join(lines))
    deciders = ("information_gain(max_touches={max_touches})", "best fixed order", "random_confirm")
    small = {"objects": 3, "scenes": 2, "rounds": 1, "deciders": deciders}
    Recorded(folder, "csv", out=folder / "run", save=folder / "sensor", **small).run()
    return folder / "run"


@pytest.fixture
def one_classifier(monkeypatch):
    """Only one kind of classifier to choose from, which saves most of the time."""
    monkeypatch.setattr(reader, "KINDS", dict(list(reader.KINDS.items())[1:2]))


def test_a_csv_gives_a_comparison_of_deciders(own):
    result = json.loads((own / "results.json").read_text())
    touches = {row[0]: float(row[1].split()[0]) for row in result["tables"]["identification"]}
    assert touches["information gain"] < touches["random order"]
    names = [row[0] for row in result["tables"]["searches"]]
    found = ["information_gain", "best fixed order", "random_confirm"]
    assert names == [*found, "no touch: a guess"]
    assert result["tables"]["searches"][-1] == ["no touch: a guess", "0.333", "0", "-0.333", None]
    success = {row[0]: float(row[1].split()[0]) for row in result["tables"]["searches"]}
    assert success["information_gain"] > success["random_confirm"]
    assert "Searches: find the target" in (own / "report.html").read_text()


def test_the_sensor_that_is_saved_names_the_objects(own):
    sensor = TactileSensor.load(own.parent / "sensor")
    touches, _ = read_recorded(own.parent, "csv")
    read = sensor.read(touches.features, touches.actions.tolist())
    known = np.array([touch.logits.argmax() for touch in read]) == touches.objects
    assert known[touches.actions == 1].mean() > 0.8
    assert known[touches.actions == 0].mean() < known[touches.actions == 1].mean()
    assert sensor.origin["touches"] == 96


def test_shares_of_few_objects_have_no_interval_of_width_zero(own):
    tables = json.loads((own / "results.json").read_text())["tables"]
    cells = [row[1] for row in tables["searches"]] + [row[i] for row in tables["identification"] for i in (2, 5)]
    widths = [float(high) - float(low) for cell in cells for low, high in re.findall(r"\[(.*), (.*)\]", cell)]
    assert sum(cell.startswith("1.000 [") for cell in cells) > 1
    assert min(widths) > 0.0


def test_the_results_hold_every_setting(own):
    result = json.loads((own / "results.json").read_text())
    names = {field.name for field in fields(Recorded)} - {"data", "format", "action", "out", "save"}
    assert names <= result.keys()


def test_every_object_counts_equally_whatever_its_number_of_identifications():
    made = [(0, 3), (1, 1), (1, 1), (1, 1)]
    named = [Named(RANDOM, thing, Identification(0, 0, 0.95, (0,) * n, True)) for thing, n in made]
    assert by_object(named, lambda one: len(one.poses))[0].tolist() == [3.0, 1.0]


@pytest.mark.parametrize(
    ("wrong", "words"),
    [
        (
            [[1, 0, 1, 0]] * 40,
            "Do not trust these probabilities, which are too high: 160 stops at 40 objects state 0.980 .* 0.500 .*; ",
        ),
        ([[0, 0]] * 40, r"Stated probabilities agree with what is right: .* 1.000 \[0.912, 1.000\]\.$"),
        (
            [[1], [0], [0]],
            r"Stated probabilities cannot be judged by so few objects: .* right in 0.667 \[0.000, 1.000\]; record more",
        ),
    ],
)
def test_the_verdict_says_whether_stated_probabilities_can_be_trusted(wrong, words):
    named = [
        Named(RANDOM, thing, Identification(0, answer, 0.98, (0,), True))
        for thing, answers in enumerate(wrong)
        for answer in answers
    ]
    assert re.match(words, trust(named)[0])
    assert trust([]) == []


def test_the_best_decider_is_named_only_where_a_difference_was_found():
    rng = np.random.default_rng(0)
    value = rng.normal(size=30)
    noisy = {"a": value, "b": value - 1.0 + 0.1 * rng.normal(size=30), "c": value + 0.1 * rng.normal(size=30)}
    assert re.match("Return: [ac]; from [ac] no difference was found.$", best_of("Return", noisy))
    assert best_of("Return", {"a": value, "b": noisy["b"]}) == "Return: a."
    same = "Return: no difference between a, b was found."
    assert best_of("Return", {"a": value, "b": value}) == same
    assert best_of("Return", {"a": value[:2], "b": value[:2] - 1.0}) == same  # too few


@pytest.mark.parametrize("is_easy", [False, True])
@pytest.mark.usefixtures("one_classifier")
def test_the_printed_verdict_says_how_many_objects_are_named(is_easy, tmp_path, rng, capsys):
    lines = ["object,action,session,x"]
    for session in range(5):
        for thing in range(5):
            for action in ("press", "rub"):
                lines.append(f"thing{thing},{action},{session},{9.0 * is_easy * thing + rng.normal()}")
    (tmp_path / "touches.csv").write_text("\n".join(lines))
    Recorded(tmp_path, "csv", scenes=0, rounds=1, out=tmp_path / "run").run()
    verdict = json.loads((tmp_path / "run" / "results.json").read_text())["verdict"]
    printed, report = capsys.readouterr().out, (tmp_path / "run" / "recorded.md").read_text()
    for sentence in verdict:
        assert " ".join(sentence.split()) in " ".join(printed.split())
        assert sentence in report
    if is_easy:
        assert "0.9, and the share of attempts that reach it: information gain 1.00 (1.000)" in verdict[-1]
        assert re.match(
            r"Stated probabilities .* stops .* at 5 objects state 0.9.* and are right in 1.000 \[", verdict[0]
        )
        assert verdict[1].startswith("Fewest touches until an object is named: no difference between random order, ")
    else:
        assert re.match("Few objects are named with probability 0.9 within 2 touches: information gain 0.", verdict[-1])


def test_the_searches_are_recorded_as_episodes(own):
    lines = (own / "episodes.jsonl").read_text().splitlines()
    assert len(lines) == 3 * 2 * 3
    episode = Episode.from_dict(json.loads(lines[0]), ("a", "b", "c"))
    assert episode.outcome in Outcome
    assert sorted(episode.arrangement) == [0, 1, 2]


@pytest.mark.usefixtures("one_classifier")
def test_bts3_is_read_in_order_of_recording(tmp_path):
    small = {"scenes": 1, "rounds": 1, "max_touches": 2, "deciders": ("random_confirm",)}
    Recorded(BTS3, "bts3", out=tmp_path, **small).run()
    result = json.loads((tmp_path / "results.json").read_text())
    right = {row[0]: float(row[2].split()[0]) for row in result["tables"]["identification"]}
    assert 0.2 < right["random order"] < 0.6  # after two touches; a guess is right in 0.024


@pytest.mark.usefixtures("one_classifier")
def test_results_and_sensors_of_other_settings_and_recordings_are_kept(own, tmp_path):
    touches, _ = read_recorded(own.parent, "csv")
    small = {"scenes": 0, "rounds": 1, "save": tmp_path / "sensor", "out": tmp_path / "run"}
    recorded(touches, **small)
    recorded(touches, **small)  # the same one again
    files = [path for path in tmp_path.rglob("*") if path.is_file()]
    held = [path.read_bytes() for path in files]
    with pytest.raises(RunMismatch, match=r"run holds another run: other seed; other threshold. Choose another folder"):
        recorded(touches, **small, seed=1, threshold=0.8)
    fewer = replace(touches, provenance="elsewhere")
    with pytest.raises(RunMismatch, match="sensor holds another run: other provenance"):
        recorded(fewer, **small | {"out": tmp_path / "other"})
    assert [path.read_bytes() for path in files] == held


@pytest.mark.usefixtures("one_classifier")
def test_categories_of_unseen_objects_are_named_as_often_as_stated(tmp_path, rng):
    kinds, things = np.repeat(range(3), 6), np.repeat(range(18), 8)
    means = 2.0 * rng.normal(size=(3, 4))[kinds] + rng.normal(size=(18, 4))
    rows = means[things] + rng.normal(size=(144, 4))
    np.savez(tmp_path / "a.npz", features=rows, object=things.astype(str), category=kinds[things].astype(str))
    small = {"objects": 3, "scenes": 1, "rounds": 2, "deciders": ("random_confirm",), "folds": 3}
    sensor = tmp_path / "sensor"
    Recorded(tmp_path, "npz", "categories", out=tmp_path / "run", save=sensor, **small).run()
    result = json.loads((tmp_path / "run" / "results.json").read_text())
    assert (result["labels"], result["num_objects"], len(result["kernels"])) == (3, 18, 3)
    assert result["tables"]["searches"][0][-1] == 3 * 3
    stated, right = (float(word) for word in re.findall(r"state (0\.\d+) and are right in (\d\.\d+)", str(result))[0])
    assert stated - right < 0.1
    assert TactileSensor.load(sensor).shape_labels == ("0", "1", "2")


def test_a_threshold_that_a_guess_reaches_is_refused(own, tmp_path):
    with pytest.raises(BadArgument, match=r"above 0\.167, the probability of each of the 6 objects .*got 0.1"):
        Recorded(own.parent, "csv", threshold=0.1, out=tmp_path).run()


def test_more_objects_on_the_table_than_there_are_is_refused(own, tmp_path):
    with pytest.raises(BadArgument, match="--objects 7: there are 6 to search among"):
        Recorded(own.parent, "csv", objects=7, out=tmp_path).run()


def test_an_unknown_decider_is_refused_before_anything_is_read(tmp_path):
    with pytest.raises(UnknownName, match="point_based"):
        Recorded(tmp_path / "nowhere", "csv", deciders=("best fixed order", "point_base"), out=tmp_path).run()


def test_a_decider_that_needs_a_sensor_is_refused_before_anything_is_read(tmp_path):
    with pytest.raises(BadArgument, match=r'best_order needs a file .* is "best fixed order"'):
        Recorded(tmp_path / "nowhere", "csv", deciders=("best_order",), out=tmp_path).run()


def as_people_have_them(kind, folder, rng):
    """A small set of a kind that people record, in a folder, and the options for it."""
    num, sessions, options = 6, {"three repeats": 3, "two repeats": 2, "a single repeat of some": 3}.get(kind, 5), {}
    things, numbers, actions = (axis.ravel() for axis in np.indices((num, sessions, 2)))
    means = 3.0 * rng.normal(size=(num, 2, 4))
    rows = means[things, actions] + rng.normal(size=(len(things), 4))
    names, acts = np.array([f"thing{i}" for i in things]), np.array(["press", "rub"])[actions]
    columns = {"object": names, "action": acts, "session": numbers, **{f"f{i}": rows[:, i] for i in range(4)}}
    if kind == "two factors of the action":
        columns |= {"motion": acts, "force": 1 + numbers % 2}
        del columns["action"]
        options["action"] = ("motion", "force")
    if kind == "a random split":
        del columns["session"]
        options["shuffle"] = True
    if kind == "controls":
        columns |= {f"untouched:f{i}": 0.1 * rng.normal(size=len(things)) for i in range(4)}
    if kind == "logits":
        logits = 3.0 * np.eye(num)[things] + 2.0 * rng.normal(size=(len(things), num))
        columns = {name: columns[name] for name in ("object", "action", "session")}
        columns |= {f"thing{i}": logits[:, i] for i in range(num)}
        options["logits"] = True
    kept = np.ones(len(things), np.bool_)
    if kind == "missing pairs":
        kept = ~((things < 2) & (actions == 1)) & ~((things == 5) & (actions == 0))
    if kind == "a single repeat of some":
        kept = (things > 1) | (numbers == 0)
        options["drop"] = True
    if kind.endswith("pictures"):
        shape = (40, 6) if kind == "pictures" else (5, 6, 3)
        pictures = 3.0 * rng.normal(size=(num, *shape))[things] + rng.normal(size=(len(things), *shape))
        np.savez(folder / "a.npz", features=pictures, object=names, action=acts, session=numbers)
        return "npz", options
    lines = [
        ",".join(columns),
        *(",".join(map(str, row)) for row in zip(*(c[kept] for c in columns.values()), strict=True)),
    ]
    (folder / "a.csv").write_text("\n".join(lines))
    return "csv", options


SETS = (
    "two factors of the action",
    "a random split",
    "three repeats",
    "two repeats",
    "a single repeat of some",
    "missing pairs",
    "controls",
    "pictures",
    "coloured pictures",
    "logits",
)


@pytest.mark.parametrize("kind", SETS)
@pytest.mark.usefixtures("one_classifier")
def test_sets_as_people_have_them_run_at_the_first_try(kind, tmp_path, rng):
    form, options = as_people_have_them(kind, tmp_path, rng)
    small = {"objects": 2, "scenes": 1, "rounds": 1, "deciders": ("random_confirm",)}
    Recorded(tmp_path, form, out=tmp_path / "run", **small, **options).run()
    result = json.loads((tmp_path / "run" / "results.json").read_text())
    for name, _, right, *_ in result["tables"]["identification"][:-1]:
        assert float(right.split()[0]) > 0.4, name
    assert re.search("names one of the objects rightly in: all features", str(result["verdict"]))
    assert ("untouched" in result["leaks"]) == (kind == "controls")
    assert ("border pixels" in result["leaks"]) == kind.endswith("pictures")
    if kind == "two factors of the action":
        assert result["actions"] == ["press 1", "press 2", "rub 1", "rub 2"]
    if kind == "a single repeat of some":
        assert any(
            "2 objects are left out as they lack sessions: thing0 (1 of press" in note for note in result["notes"]
        )
        assert result["labels"] == 4
    if kind == "missing pairs":
        assert any("3 of 6 objects lack sessions: thing0 (0 of rub); thing1 (0 of rub)" in n for n in result["notes"])


@pytest.mark.usefixtures("one_classifier")
def test_what_the_label_is_read_from_without_a_touch_is_said_first(tmp_path, rng):
    things, numbers = (axis.ravel() for axis in np.indices((6, 8)))
    means = rng.normal(size=(6, 4))
    touch = means[things] + rng.normal(size=(48, 4))
    drift = things[:, None] + 0.02 * rng.normal(size=(48, 3))  # of the sensor, from object to object
    nuisances = {
        "temperature": {"temperature": 21.0 + rng.normal(size=6)[things] + 0.02 * rng.normal(size=48)},
        "label": {"label": things + 1e-3 * rng.normal(size=48)},
        "the control 'untouched'": {f"untouched:frame {i}": drift[:, i] for i in range(3)},
        "before contact": {f"before contact {i}": drift[:, i] for i in range(3)},
    }
    for said, nuisance in nuisances.items():
        columns = {"object": things, "session": numbers, **{f"f{i}": touch[:, i] for i in range(4)}, **nuisance}
        lines = [",".join(columns), *(",".join(map(str, row)) for row in zip(*columns.values(), strict=True))]
        (tmp_path / "a.csv").write_text("\n".join(lines))
        touches, _ = read_recorded(tmp_path, "csv")
        assert said.lower() in recorded(touches, scenes=0, rounds=1).verdict()[0].lower()
        assert any(said in remark for remark in check_recorded(touches))
    pictures = rng.normal(size=(48, 6, 6)) + rng.normal(size=(6, 1, 1))[things]
    pictures[:, 0] = drift[:, :1]
    np.savez(tmp_path / "a.npz", features=pictures, object=things)
    assert "'border pixels' alone names" in check_recorded(read_recorded(tmp_path / "a.npz", "npz")[0])[0]


def test_real_grasps_give_no_warning_of_a_leak_but_the_accuracy_of_single_features():
    touches, _ = read_recorded(BTS3, "bts3")
    assert check_recorded(touches) == ()
    leaks = Leaks.of(touches, splits_of(touches, 5))
    assert "One touch names one of the objects rightly in: all features 0.2" in leaks.summary()
    assert leaks.single.max() < 0.1 < leaks.groups["all features"]
    assert (leaks.within > 0.01).all()


def test_a_classifier_of_ones_own_is_used_and_its_failures_are_said(tmp_path, rng):
    things, numbers = (axis.ravel() for axis in np.indices((4, 12)))
    angles = rng.uniform(0.0, 2.0 * np.pi, 48)  # rings about one centre, which discriminants cannot tell apart
    rings = (1.0 + things)[:, None] * np.stack([np.cos(angles), np.sin(angles)], axis=1)
    touches = RecordedTouches(rings, 0 * things, things, numbers, ("press",), tuple("abcd"))

    class Radius:
        def fit(self, rows, labels):
            self.known = np.array([np.hypot(*rows[labels == k].T).mean() for k in np.unique(labels)])

        def predict_proba(self, rows):
            scores = np.exp(-10.0 * np.abs(np.hypot(*rows.T)[:, None] - self.known))
            return scores / scores.sum(axis=1, keepdims=True)

    small = {"scenes": 0, "rounds": 1}
    right = [
        float(recorded(touches, **small, **own).tables()[0].rows[0][2].split()[0])
        for own in ({}, {"classifier": Radius()})
    ]
    assert right[1] == 1.0 > right[0]
    sensor = RecordedSensor.fit(touches, Radius())
    assert len(sensor.read(rings[:2], ["press"] * 2)) == 2
    with pytest.raises(CannotWrite, match=r"a classifier of your own is code: .*--logits"):
        sensor.save(tmp_path / "sensor")

    class Broken(Radius):
        def predict_proba(self, rows):
            return np.full((len(rows), 9), 0.1)

    class Raises(Radius):
        def fit(self, rows, labels):
            raise KeyError("no")

    for made, words in ((Broken(), r"must give probabilities \(8, 4\), got \(8, 9\)"), (Raises(), "fit failed .*no")):
        with pytest.raises(BrokenContract, match=words):
            recorded(touches, **small, classifier=made)
    with pytest.raises(InvalidArgument, match="a classifier has fit and predict_proba"):
        recorded(touches, **small, classifier=3)
    with pytest.raises(BadRecording, match="a feature of the name of each of the objects, and a, b, c, d have none"):
        recorded(touches, **small, logits=True)


@pytest.mark.usefixtures("one_classifier")
def test_with_one_action_rules_that_are_the_same_have_one_row(rng):
    things, numbers = (axis.ravel() for axis in np.indices((5, 6)))
    rows = 3.0 * rng.normal(size=(5, 3))[things] + rng.normal(size=(30, 3))
    touches = RecordedTouches(rows, 0 * things, things, numbers, ("press",), tuple("abcde"))
    report = recorded(touches, scenes=1, rounds=1, objects=2)
    tables = [[row[0] for row in table.rows] for table in report.tables()]
    assert tables[0] == ["the only action", "no touch: a guess"]
    assert tables[1] == ["value_of_information", "point_based", "information_gain", "no touch: a guess"]
    assert any("one row shows them" in sentence for sentence in report.verdict())
