"""Objects in a tray: how bodies rest, what presses meet, searches that end right, and sessions that robots play."""

import json
import pickle
import warnings
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import gymnasium
import numpy as np
import pytest
import scipy.spatial
from gymnasium.utils.env_checker import check_env

from activetouch import Scene, drawer
from activetouch.errors import WrongScene
from activetouch.named_scenes import SCENES
from activetouch.perception.many_bodies import NestedPlan
from activetouch.perception.reader import TactileReader
from activetouch.sensor_files import MODELS
from activetouch.shapes import EXTENDED_SHAPES as SHAPES
from activetouch.shapes import Box
from activetouch.solids.mesh import Mesh
from activetouch.tray.resting import about_vertical, rests
from activetouch.tray.sensor import DECIDERS, TraySensor
from activetouch.tray.world import Lying, Tray, TrayWorld
from belief.errors import CorruptFile, InvalidArgument, UnknownName
from belief.journal import Journal, read_journal
from belief.problem import Reject, Unsure
from belief.tray import PlaceTouch
from experiments.command_line.arguments import BadArgument
from experiments.meshes.find import Find
from experiments.scene_choice import SceneChoice
from experiments.search.certify import Certify, TooFewSearches
from experiments.search.compare import Compare
from experiments.search.drawer import searches
from experiments.search.drawer.drawer import Drawer
from experiments.search.drawer.searches import Searches
from experiments.search.play import Setting
from planners.certified import Certificate, NotCertified
from planners.decider import BadDecision
from planners.session_log import AlreadyTold, OtherModel
from planners.tray import ConfirmAt, Press, Standing, TrayDecision, TrayRules, raster, standing_of, stated, stop
from planners.tray_session import TraySession

_SMALL = Tray(size=(0.13, 0.1), num_objects=1, present=0.6)


@pytest.fixture(scope="module")
def sensor() -> TraySensor:
    """Two shapes, one object, a small tray."""
    return TraySensor.shipped("coarse", {name: SHAPES[name] for name in ("sphere", "cube")}, _SMALL)


@pytest.fixture(scope="module")
def two(sensor) -> TraySensor:
    """Two objects of four shapes."""
    shapes = {name: SHAPES[name] for name in ("sphere", "cube", "half_sphere", "torus")}
    return TraySensor.shipped("coarse", shapes, Tray(size=(0.16, 0.12), num_objects=2, present=0.7))


@pytest.mark.parametrize(
    ("shape", "lifts", "turns"),
    [
        (Box((0.01, 0.02, 0.03)), [0.01, 0.02, 0.03], [12, 12, 12]),
        (SHAPES["cube"], [0.016], [6]),
        (SHAPES["sphere"], [0.02], [1]),
        (SHAPES["torus"], [0.007], [1]),
        (SHAPES["hexagonal_prism"], [0.016, 0.02], [12, 4]),
    ],
)
def test_a_body_rests_on_its_stable_faces(shape, lifts, turns):
    found = rests(shape)
    np.testing.assert_allclose(np.sort(found.lifts), lifts, atol=3e-4)
    assert sorted(found.turns.tolist()) == sorted(turns)
    assert found.probs.sum() == pytest.approx(1.0)
    np.testing.assert_allclose(
        found.rotations @ found.rotations.transpose(0, 2, 1), np.eye(3)[None].repeat(len(lifts), 0), atol=1e-9
    )
    np.testing.assert_allclose(np.linalg.det(found.rotations), 1.0)


def test_a_flat_face_of_a_high_box_is_less_probable():
    found = rests(Box((0.01, 0.02, 0.03)))
    assert found.probs[np.argsort(found.lifts)].tolist() == sorted(found.probs.tolist(), reverse=True)


def test_a_body_does_not_rest_where_its_centre_of_mass_overhangs():
    base = np.array([(0, 0, 0), (0.01, 0, 0), (0.01, 0.01, 0), (0, 0.01, 0)], float)
    corners = np.vstack([base, base + np.array([0.05, 0.0, 0.03])])  # a prism that leans far over its ends
    hull = scipy.spatial.ConvexHull(corners)
    faces = hull.simplices.copy()
    a, b, c = corners[faces].transpose(1, 0, 2)
    inward = np.einsum("fi,fi->f", np.cross(b - a, c - a), hull.equations[:, :3]) < 0.0
    faces[inward] = faces[inward][:, ::-1]
    found = rests(Mesh("prism", corners, faces))
    on_an_end = np.abs(found.rotations @ np.array([0.0, 0.0, 1.0]))[:, 2] > 0.99
    assert not on_an_end.any()


def test_objects_do_not_overlap_and_are_in_the_tray():
    scene = replace(SCENES["coarse"].scene, shapes=SCENES["many"].scene.shapes)
    world = TrayWorld.drawn(scene, Tray(), 3, np.random.default_rng(0))
    assert len({one.shape for one in world.objects}) == len(world.objects) == 6
    points = []
    for one in world.objects:
        solid = list(scene.solids.values())[one.shape]
        corners = one.scale * one.rotation @ solid.surface.vertices + one.place[:, None]
        assert corners[2].min() == pytest.approx(0.0, abs=2e-4)
        assert (corners[:2].min(axis=1) >= 0.0035).all()
        assert (corners[:2].max(axis=1) <= np.array([0.4, 0.3]) - 0.0035).all()
        points.append(corners[:2].T)
    for n, one in enumerate(points):
        for other in points[:n]:
            distance = np.hypot(*(one[::7, None] - other[None, ::7]).transpose(2, 0, 1)).min()
            assert distance > 0.003


def test_a_tray_that_is_too_small_says_so():
    with pytest.raises(InvalidArgument, match="fit"):
        TrayWorld.drawn(SCENES["coarse"].scene, Tray(size=(0.03, 0.03), num_objects=1), 0, np.random.default_rng(0))
    with pytest.raises(InvalidArgument, match="need more than"):
        TrayWorld.drawn(SCENES["coarse"].scene, Tray(num_objects=6), 0, np.random.default_rng(0))


def test_a_tray_in_another_unit_says_in_which_it_is():
    for wrong in ({"size": (400.0, 300.0)}, {"size": (4e-4, 3e-4)}, {"gap": 4.0}, {"height_noise": 0.3}):
        with pytest.raises(InvalidArgument, match=r"must be a number in \[[\d., ]+\] m, got"):
            Tray(**wrong)
    with pytest.raises(BadArgument, match=r"--size must be a number in \[10, 3000\] mm, got 0.4"):
        Drawer(size=(0.4, 0.3)).run()
    for wrong in ({"size": (0.3,)}, {"size": (0.3, 0.2, 0.1)}, {"sizes": ()}):
        with pytest.raises(InvalidArgument, match="must be 2 values, got"):
            Tray(**wrong)
    with pytest.raises(InvalidArgument, match="the smallest of the sizes must not exceed"):
        Tray(sizes=(1.1, 0.9))
    with pytest.raises(InvalidArgument, match=r"sizes must be a number in \[0.01, 100\]"):
        Tray(sizes=(1.0, 1e308))
    with pytest.raises(InvalidArgument, match=r"tolerance must be a number in \[0, 0.1\] m, got 0.5"):
        NestedPlan(tolerance=0.5)


def test_a_press_meets_the_highest_object_or_the_floor(sensor):
    turn = rests(SHAPES["cube"]).rotations[0]
    low, high = (Lying(1, 1.0, turn, np.array([x, 0.05, 0.016])) for x in (0.04, 0.09))
    high = high._replace(scale=1.2, place=np.array([0.09, 0.05, 1.2 * 0.016]))
    world = TrayWorld(sensor.scene, replace(_SMALL, height_noise=0.0), [low, high])
    on_low, on_high, between, beside = (
        world.press(x, 0.05, np.random.default_rng(0)) for x in (0.03, 0.09, 0.065, 0.115 + 0.025)
    )
    assert (on_low.met, on_high.met, between.met, beside.met) == (0, 1, 1, None)
    assert on_low.height == pytest.approx(0.032, abs=1e-4)
    assert on_high.height == pytest.approx(1.2 * 0.032, abs=1e-4)
    assert beside.image is None
    assert beside.height == 0.0
    assert on_low.image is not None
    assert on_low.image.shape == (4, 4)


def test_the_table_predicts_the_heights_of_presses(sensor):
    table, rng = sensor.table, np.random.default_rng(0)
    for row in (0, 3):
        resting = rests(list(sensor.scene.solids.values())[table.shape_of[row]])
        turn = (row - np.searchsorted(table.shape_of, table.shape_of[row])) * np.pi / 12
        spin = np.array([[np.cos(turn), -np.sin(turn), 0], [np.sin(turn), np.cos(turn), 0], [0, 0, 1]])
        place = np.array([0.065, 0.05, resting.lifts[0]])
        body = Lying(int(table.shape_of[row]), 1.0, spin @ resting.rotations[0], place)
        world = TrayWorld(sensor.scene, replace(_SMALL, height_noise=0.0), [body])
        for i, j in ((0, 0), (2, -1), (-3, 2), (4, 0)):
            met = world.press(0.065 + i * table.pitch, 0.05 + j * table.pitch, rng)
            at = row, i + table.reach, j + table.reach
            assert (met.image is not None) == (table.hit[at] > 0.5)
            if met.image is not None:
                assert met.height == pytest.approx(float(table.height[at]), abs=0.002 + 2 * float(table.spread[at]))


def test_a_cube_in_one_turn_is_met_where_it_lies(sensor):
    """x and y of the tray, of the image and of the table are the same: a corner of a bar that lies along x is met."""
    bar = TraySensor.shipped("coarse", {"bar": Box((0.03, 0.008, 0.008)), "sphere": SHAPES["sphere"]}, _SMALL).table
    rows = np.flatnonzero(bar.shape_of == 0)
    along = rows[np.argmax(bar.extents[rows, 0])]
    reach = bar.reach
    far = round(0.04 / bar.pitch)
    assert bar.hit[along, reach + far, reach] == 1.0
    assert bar.hit[along, reach, reach + far] == 0.0


@pytest.mark.parametrize("decider", sorted(DECIDERS))
def test_searches_end_with_an_answer(sensor, decider):
    found = [sensor.search("cube", decider, seed=seed) for seed in range(4)]
    assert {one.answer for one in found} <= {"here", "absent", "unsure"}
    assert sum(bool(one.success) for one in found) >= 3
    again = sensor.search("cube", decider, seed=0)
    assert again == found[0]
    assert all(one.travel > 0.0 and one.num_touches == len(one.steps) for one in found)


def test_two_objects_are_told_apart(two):
    found = [two.search(target, seed=(1, number)) for number, target in enumerate(two.shape_labels)]
    assert sum(bool(one.success) for one in found) >= 3


def test_what_is_stated_ends_a_search():
    rules = TrayRules(sure=0.9, most_touches=5)
    here = Standing([((0.1, 0.2), 0.93)], 0.01, 0.06)
    assert stop(here, 3, rules) == ConfirmAt((0.1, 0.2))
    assert stop(Standing([((0.1, 0.2), 0.01)], 0.95, 0.04), 3, rules) == Reject()
    assert stop(Standing([], 0.5, 0.5), 4, rules) is None
    assert stop(Standing([], 0.5, 0.5), 5, rules) == Unsure()
    assert [stated(here, action) for action in (ConfirmAt((0.1, 0.21)), ConfirmAt((0.1, 0.3)), Reject(), Unsure())] == [
        *(0.93, 0.0, 0.01, 0.93)
    ]


def test_presses_tell_where_a_target_is_that_is_known_to_be_there(sensor):
    """After misses, the place that is left is pressed, although nothing is to be known but where the target is."""
    there = replace(sensor, tray=replace(sensor.tray, present=1.0))
    session = there.session("cube")
    for x in np.arange(0.02, 0.075, 0.01):
        session.tell(missed=True, place=(float(x), 0.03))
    assert session.standing.unfound == pytest.approx(1.0)
    assert session.decision.scores["gain"] > 0.1
    assert session.place()[1] > 0.035


def test_presses_tell_which_assignment_of_touches_is_true(sensor):
    """If the likeliest world knows the answer, presses are of what the other one says."""
    belief = sensor.belief("cube")
    empty = belief.update(PlaceTouch((4, 4)))
    met = sensor.touched("cube", 3)
    session = sensor.session("cube")
    session.tell_met(met.press(*met.world.objects[0].place[:2].tolist()))
    one = session.belief.worlds[0].found[0]
    sure = replace(session.belief.worlds[0], log_answers=np.log([1.0 - 2e-12, 1e-12, 1e-12]), log_weight=0.0)
    none = replace(empty.worlds[0], log_answers=np.log([1e-12, 1.0 - 1e-12]), log_weight=float(np.log(0.5)))
    torn = replace(session.belief, worlds=(sure, none))
    assert torn.weights.tolist() == pytest.approx([2 / 3, 1 / 3])
    decision = sensor.decider().choose(torn, (0.0, 0.0), np.random.default_rng(0))
    assert decision.scores["gain"] > 0.05
    assert np.hypot(*(np.subtract(torn.centre(decision.action.cell), torn.place_of_target(one)))) < 0.03
    decided = replace(session.belief, worlds=(sure,))
    gave_up = sensor.decider().choose(decided, (0.0, 0.0), np.random.default_rng(0))
    assert gave_up.action == Unsure()  # no press tells more
    assert stated(standing_of(decided), gave_up.action) == pytest.approx(1.0)


def test_a_robot_plays_a_session(sensor):
    world = TrayWorld.drawn(sensor.scene, replace(sensor.tray, present=1.0), 1, np.random.default_rng(3))
    session, rng = sensor.session("cube"), np.random.default_rng(4)
    while isinstance(session.ask(), Press):
        assert session.ask() is session.ask()
        met = world.press(*session.place(), rng)
        if met.image is None:
            session.tell(missed=True)
        else:
            session.tell(met.image, met.height)
    action = session.ask()
    assert isinstance(action, ConfirmAt)
    assert np.hypot(*(world.objects[0].place[:2] - action.place)) < 0.008
    with pytest.raises(InvalidArgument, match="has ended"):
        session.place()
    before, number = session.standing, len(session.steps)
    assert before.target >= 0.95
    with pytest.raises(InvalidArgument, match="has not ended"):
        session.episode  # noqa: B018
    session.tell()
    assert (session.ask(), session.outcome, session.episode.success) == (None, "confirmed", None)
    with pytest.raises(InvalidArgument, match="has ended"):
        session.tell(missed=True, place=(0.05, 0.05))
    session.reveal([(label, x, y) for label, x, y in world.lay])
    assert session.episode.success
    assert session.episode.is_there
    assert (session.undo(), session.ask()) == ("done", action)
    assert session.undo() == "touch"
    assert len(session.steps) == number - 1
    assert isinstance(session.ask(), Press)


@pytest.mark.parametrize(("decider", "seed"), [("information_per_cost", 5), ("random", (5, 2))])
def test_a_session_that_is_killed_at_every_step_is_the_search(two, decider, seed, tmp_path):
    """Beliefs, decisions and their chance are those of the search, whatever was taken back in between."""
    expected = two.search("cube", decider, seed)
    keyed, log = two.touched("cube", seed), tmp_path / "log.jsonl"
    session, ended = two.session("cube", decider, seed, log=log), False
    while not ended:
        action, place = session.ask(), None
        if isinstance(action, Press):
            place = session.place()
            session.tell(missed=True, place=(0.05, 0.05))
            assert session.undo() == "miss"
            assert (session.ask(), session.place()) == (action, place)
            session.tell_met(keyed.press(*place))
        else:
            session.tell()
        with pytest.raises(AlreadyTold):
            session.tell(missed=True, step=session.step - 1)
        ended = session.ask() is None
        if ended:
            session.reveal(keyed.world.lay)
        session.close()
        session = two.session("cube", decider, seed, log=log)
    assert replace(session.episode, seed=expected.seed) == expected
    session.close()
    twin = pickle.loads(pickle.dumps(session))
    assert twin.standing == session.standing
    for other, message in (
        ({"seed": 6}, "another search: its seed"),
        ({"decider": "raster"}, "another decider"),
    ):
        with pytest.raises(InvalidArgument, match=message):
            two.session("cube", **{"decider": decider, "seed": seed, **other}, log=log)
    three = {name: SHAPES[name] for name in ("sphere", "cube", "half_sphere")}
    with pytest.raises(OtherModel, match="another reader"):
        replace(two, scene=replace(two.scene, shapes=three)).session("cube", decider, seed, log=log)
    header, line = read_journal(log)[:2]
    truth = {"told": "truth", "objects": [["cube", 9.0, 0.1]]}
    for number, odd in enumerate(({**line, "told": "done"}, {**line, "place": [9.0, 0.1]}, truth)):
        Journal.create(tmp_path / f"odd{number}", [header, odd]).close()
        with pytest.raises(CorruptFile, match="no log of a session"):
            two.session("cube", decider, seed, log=tmp_path / f"odd{number}")


def test_a_session_refuses_what_makes_no_sense(sensor):
    session = sensor.session("cube")
    image = np.zeros((4, 4), np.uint8)
    for wrong in ({}, {"image": image}, {"height": 0.01}, {"missed": True, "height": 0.01}):
        with pytest.raises(InvalidArgument, match="missed=True"):
            session.tell(**wrong)
    for height in (0.0, -1.0, np.nan, np.inf, "0.01", [0.01], 10**5000, True):
        with pytest.raises(InvalidArgument, match="above the floor"):
            session.tell(image, height)
    with pytest.raises(InvalidArgument, match=r"in \(0, 1\] m, got 25.0: is it in mm\?"):
        session.tell(image, 25.0)
    for place in ((1.0, 0.0), (np.nan, 0.0), (0.0, -0.1), (0.1,), (0.1, 0.1, 0.1), "ab", 5, ("a", 0.1)):
        with pytest.raises(InvalidArgument, match="in the tray"):
            session.tell(missed=True, place=place)
        with pytest.raises(InvalidArgument, match="in the tray"):
            session.reveal([("cube", *place) if isinstance(place, tuple) else ("cube", place)])
    for objects in (["cube"], "cube", None, [5]):
        with pytest.raises(InvalidArgument, match="objects are a list such as"):
            session.reveal(objects)
    assert not session.steps
    session.reveal([(1, 0.05, 0.05)])
    assert session.objects == (("cube", 0.05, 0.05),)
    with pytest.raises(InvalidArgument, match="nothing was told"):
        session.undo()
    with pytest.raises(UnknownName, match="cone"):
        sensor.session("cone")
    with pytest.raises(UnknownName, match="decider"):
        sensor.session("cube", "best")
    blind = TraySession(sensor.belief("cube"), sensor.decider(), sensor.rules)
    with pytest.raises(InvalidArgument, match="no reader"):
        blind.tell(image, 0.01)
    blind.reader = SimpleNamespace(identity="", read=lambda image: (np.full(4, np.nan), None))
    with pytest.raises(ValueError, match="the embedding that the reader made must be finite"):
        blind.tell(image, 0.01)


class Answers:
    """Answers the same whenever it is asked."""

    def __init__(self, answer):
        self.answer = answer

    def choose(self, belief, at, rng):
        return self.answer


@pytest.mark.parametrize(
    ("answer", "action"),
    [
        (TrayDecision(Press((np.int64(3), np.uint8(4))), {"gain": np.float32(0.5), "more": 1}), Press((3, 4))),
        (TrayDecision(Press([3, 4])), Press((3, 4))),
        (TrayDecision(ConfirmAt((np.float32(0.0625), 0))), ConfirmAt((0.0625, 0.0))),
        (TrayDecision(Reject()), Reject()),
    ],
)
def test_a_decider_may_answer_with_numbers_of_numpy(sensor, answer, action, tmp_path):
    session = sensor.session("cube", Answers(answer), log=tmp_path / "log")
    assert session.ask() == action
    session.tell(missed=True) if isinstance(action, Press) else session.tell()
    session.close()
    resumed = sensor.session("cube", Answers(answer), log=tmp_path / "log")
    assert (resumed.step, resumed.outcome) == (1, session.outcome)


@pytest.mark.parametrize(
    "answer",
    [
        None,  # which would look like the end of the search
        "touch",
        Press((3, 4)),
        TrayDecision("touch"),
        TrayDecision(Reject),
        *(TrayDecision(Press(cell)) for cell in (5, (3,), (-1, 0), (10**4, 0), (1.5, 2), (True, 2), "ab", (None, 1))),
        *(TrayDecision(ConfirmAt(place)) for place in (0.1, (9.0, 9.0), (np.nan, 0.1), ("a", 0.1), (0.1, 0.1, 0.1))),
        *(TrayDecision(Reject(), scores) for scores in ({"gain": np.nan}, {"gain": "x"}, {1: 0.5}, None)),
    ],
)
def test_what_is_no_decision_of_the_tray_is_refused_when_it_is_asked_for(sensor, answer):
    session = sensor.session("cube", Answers(answer))
    with pytest.raises(BadDecision, match="the decider Answers answered"):
        session.ask()
    assert (session.outcome, session.step) == (None, 0)


@pytest.mark.parametrize("decider", [None, 5, object(), Answers, SimpleNamespace(decide=print)])
def test_what_is_no_decider_of_a_tray_is_refused_at_the_start(sensor, decider):
    with pytest.raises(InvalidArgument, match="an object with a method choose, such as"):
        sensor.session("cube", decider)


@pytest.mark.parametrize("settings", ["spacing=0", "spacing=-1", "spacing=1e-9", "named=2", "most_touches=0"])
def test_settings_of_a_raster_have_their_ranges(sensor, settings):
    with pytest.raises(InvalidArgument, match=settings.split("=")[0]):
        sensor.session("cube", f"raster({settings})")


def test_the_truth_of_before_the_log_is_in_it(sensor, tmp_path):
    session = sensor.session("cube")
    session.tell(missed=True)
    session.reveal([("cube", 0.05, 0.06)])
    session.save(tmp_path / "log")
    session.close()
    resumed = sensor.session("cube", log=tmp_path / "log")
    assert resumed.objects == session.objects == (("cube", 0.05, 0.06),)


def test_a_tray_of_one_shape_holds_one_object(sensor):
    shapes = {"cube": SHAPES["cube"]}
    alone = TraySensor.shipped("coarse", shapes, Tray(size=(0.13, 0.1), num_objects=1, present=1.0))
    session = alone.session("cube")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        while isinstance(session.ask(), Press) and session.step < 8:
            session.tell(missed=True)
    assert len({step.place for step in session.steps}) == 8
    assert session.decision.scores["gain"] > 0.0
    for other in ({"num_objects": 2}, {"present": 0.9}, {"num_objects": 2, "unlisted": 0.5}):
        with pytest.raises(InvalidArgument, match="cube is the only one; give more shapes"):
            replace(alone, tray=replace(alone.tray, **other)).session("cube")
    with pytest.raises(InvalidArgument, match=r"0.02 x 0.1 m is too small for the target: is its size in m\?"):
        replace(sensor, tray=replace(sensor.tray, size=(0.02, 0.1))).session("cube")


def test_touches_elsewhere_than_asked_are_evidence(sensor):
    session = sensor.session("cube")
    session.tell(missed=True, place=(0.065, 0.05))
    assert session.steps[0].place == (0.065, 0.05)
    assert session.belief.pressed == (session.belief.cell_at(0.065, 0.05),)
    assert 0.2 < standing_of(session.belief).absent < 0.6


def test_a_sensor_without_a_reader_of_any_object_is_refused():
    with pytest.raises(UnknownName, match="keyed"):
        TraySensor.shipped("keyed")

    with pytest.raises(WrongScene, match="reader of any object"):
        TraySensor(Scene(), TactileReader.load(MODELS / "keyed" / "reader.safetensors"))


def test_rows_of_a_raster_cover_the_tray():
    places = np.array(raster((0.4, 0.3), 0.036))
    grid = np.stack(np.meshgrid(np.linspace(0, 0.4, 41), np.linspace(0, 0.3, 31)), axis=-1).reshape(-1, 1, 2)
    assert np.abs(grid - places).max(axis=2).min(axis=1).max() <= 0.019
    steps = np.linalg.norm(np.diff(places, axis=0), axis=1)
    assert steps.max() < 0.04


def test_pushed_objects_are_found_as_well(sensor):
    pushed = replace(sensor, tray=replace(_SMALL, push=0.004))
    found = [pushed.search("cube", seed=seed) for seed in range(3)]
    assert sum(bool(one.success) for one in found) >= 2


def test_the_command_continues_and_refuses_other_settings(tmp_path, capsys):
    given = {"sensor": "coarse", "shapes": {name: SHAPES[name] for name in ("sphere", "cube")}, "tray": _SMALL}
    first = drawer(["information_per_cost"], num_searches=2, out=tmp_path, jobs=1, **given)
    lines = (tmp_path / "episodes.jsonl").read_text().splitlines()
    assert len(lines) == 3
    more = drawer(["information_per_cost", "raster"], num_searches=3, out=tmp_path, jobs=1, **given)
    assert more.episodes["information_per_cost"][:2] == first.episodes["information_per_cost"]
    row = more.rows()[0]
    assert row["searches"] == 3
    page = more.save(tmp_path).read_text(encoding="utf-8")
    assert "Where in the tray is it?" in page
    assert (tmp_path / "search_1.png").exists()
    with pytest.raises(InvalidArgument, match="other settings"):
        drawer(["raster"], num_searches=1, out=tmp_path, jobs=1, seed=5, **given)
    (tmp_path / "episodes.jsonl").write_text("\n".join([lines[0], json.dumps({"decider": 1})]))
    with pytest.raises(CorruptFile, match="episodes"):
        drawer(["raster"], num_searches=1, out=tmp_path, jobs=1, **given)


def test_compare_and_find_play_the_drawer(monkeypatch, tmp_path):
    played = []
    monkeypatch.setattr("experiments.search.drawer.drawer.report", lambda *given: played.append(given))
    choice = SceneChoice("drawer(present=0.5)")
    Compare(targets=("cube",), episodes=2, setting=Setting(choice), out=tmp_path, jobs=1).run()
    Find(folder=tmp_path, target="mug", drawer=True, searches=3, objects=4, threshold=0.9, out=tmp_path, jobs=1).run()
    Drawer(sensor="coarse", size=(200.0, 150.0), push=2.0, sure=0.8, out=tmp_path, jobs=1).run()
    usual = ("information_per_cost", "raster")
    assert played == [
        (Searches(tray=Tray(present=0.5)), usual, ("cube",), 2, tmp_path, 1, None),
        (Searches("gel", tmp_path, (), Tray(num_objects=4), TrayRules(sure=0.9)), usual, ("mug",), 3, tmp_path, 1),
        (
            *(Searches("coarse", tray=Tray(size=(0.2, 0.15), push=0.002), rules=TrayRules(sure=0.8)), usual),
            *((), 24, tmp_path, 1, None),
        ),
    ]
    for wrong in (Setting(choice, unlisted=0.1), Setting(replace(choice, meshes=(tmp_path, tmp_path)))):
        with pytest.raises(BadArgument, match="the scene drawer takes"):
            Compare(setting=wrong, out=tmp_path).run()


def test_strangers_are_told_from_the_shapes_of_the_files(two):
    """A bar among spheres and cubes is none of them; without a prior for strangers, it is taken for one."""
    bar = {"bar": Box((0.03, 0.006, 0.01))}
    shapes = {name: SHAPES[name] for name in ("sphere", "cube", "half_sphere")}
    tray = Tray(size=(0.16, 0.12), num_objects=1, present=0.3, unlisted=0.9)
    sensor = TraySensor.shipped("coarse", shapes, tray, strangers=bar)
    number = next(n for n in range(30) if sensor.world("cube", n).objects[0].shape == 3)
    found = sensor.search("cube", seed=number)
    assert found.objects[0][0] == "stranger 1"
    assert found.answer == "absent"
    assert found.success


@pytest.fixture(scope="module")
def fine() -> TraySensor:
    """A fine pad and three shapes, among which a cylinder may stand."""
    shapes = {name: SHAPES[name] for name in ("sphere", "cube", "torus")}
    tray = Tray(size=(0.13, 0.1), num_objects=1, present=0.9, unlisted=0.3, sizes=(1.0, 1.0))
    return TraySensor.shipped("gel", shapes, tray, strangers={"cylinder": SHAPES["cylinder"]})


def probabilities(sensor: TraySensor, shape: int, height: float, num_touches: int) -> tuple[float, float]:
    """That an object is the cube, after touches of its middle and of two corners: with lookalikes, and without."""
    world = TrayWorld(sensor.scene, sensor.tray, [Lying(shape, 1.0, np.eye(3), np.array([0.065, 0.05, height]))])
    world.strangers = sensor.strangers
    found = []
    for asked in (sensor.belief("cube").lookalikes, None):
        session = sensor.session("cube")
        session.belief = replace(session.belief, lookalikes=asked)
        for aside in (0.0, 0.015, -0.015)[:num_touches]:
            place = 0.065 + aside, 0.05 + aside
            session.tell_met(world.press(*place, np.random.default_rng(1)), place)
        found.append(session.standing.target)
    return found[0], found[1]


def test_a_stranger_that_feels_like_the_target_at_one_touch_is_told_from_it_at_three(fine):
    first, first_plain = probabilities(fine, 3, 0.02, 1)
    assert first == pytest.approx(first_plain, abs=0.02)
    three, three_plain = probabilities(fine, 3, 0.02, 3)
    assert three_plain > 0.9
    assert three < 0.2


def test_an_object_of_the_shape_stays_the_target(fine):
    for num_touches in (1, 3):
        asked, plain = probabilities(fine, 1, 0.016, num_touches)
        assert asked == pytest.approx(plain, abs=0.02)
        assert asked > 0.95


def test_a_body_is_fitted_to_its_touches_anywhere_in_a_cell_and_in_any_turn_that_looks_alike(fine):
    """The cube is turned by 97.3 degrees, and the belief tells turns within 90 apart."""
    misfits = []
    for shape, turn, height in ((1, np.radians(97.3), 0.016), (3, 0.0, 0.02)):
        place = np.array([0.0634, 0.0512, height])
        world = TrayWorld(fine.scene, fine.tray, [Lying(shape, 1.0, about_vertical(np.array([turn]))[0], place)])
        world.strangers = fine.strangers
        session = fine.session("cube")
        for at in ((0.063, 0.051), (0.078, 0.055), (0.055, 0.064), (0.05, 0.045)):
            session.tell_met(world.press(*at, np.random.default_rng(1)), at)
        belief = session.belief
        one = max(belief.worlds[0].found, key=lambda found: found.touches)
        misfits.append(belief.lookalikes.misfit(belief, one, 1))
    assert misfits[0] < 0.5
    assert misfits[1] > 1.0


def test_touches_without_images_are_not_compared(fine):
    world = TrayWorld(fine.scene, fine.tray, [Lying(1, 1.0, np.eye(3), np.array([0.065, 0.05, 0.016]))])
    belief = fine.belief("cube")
    for at in ((0.065, 0.05), (0.08, 0.065)):
        met = world.press(*at, np.random.default_rng(1))
        belief = belief.update(PlaceTouch(belief.cell_at(*at), met.height, *fine.read(met.image)))
    assert set(belief.doubts.values()) == {-np.inf}


def test_lookalikes_are_asked_only_where_strangers_are_weighed(fine):
    assert fine.belief("cube").lookalikes is not None
    for changed in ({"unlisted": 0.0}, {"push": 0.003}):
        assert replace(fine, tray=replace(fine.tray, **changed)).belief("cube").lookalikes is None


def test_the_environment_is_one_of_gymnasium(sensor):
    env = gymnasium.make("activetouch/TraySearch-v0", sensor=sensor)
    check_env(env.unwrapped, skip_render_check=True)
    observation, info = env.reset(seed=3, options={"target": "cube"})
    assert info["target"] == "cube"
    assert observation[4].argmin() == 0  # the pad is at the corner
    rewards, ends = [], False
    for step in range(60):
        place = np.unravel_index(int(observation[0].argmax()), observation.shape[1:])  # where it may be most probably
        action = (np.array(place) + 0.5) / observation.shape[1:] if step % 3 else env.action_space.sample()
        observation, reward, ends, truncated, info = env.step(np.float32(action))
        rewards.append(reward)
        assert not truncated
        pressed = sensor.grid.cell_at(*(np.float32(action) * sensor.tray.size).tolist())
        assert observation[4].argmin() == np.ravel_multi_index(pressed, observation.shape[1:])
        if ends:
            break
    assert ends
    assert rewards[-1] > 0.5 if info["is_success"] else rewards[-1] < 0.0
    assert all(-1.0 < reward < 0.0 for reward in rewards[:-1])


def test_the_answers_of_searches_in_trays_are_certified(sensor, tmp_path, monkeypatch):
    """Searches end at the stated probability that calibration has found for each answer, in the certified world."""
    monkeypatch.setattr(
        TraySensor, "shipped", lambda name, meshes, tray, rules, _: replace(sensor, tray=tray, rules=rules)
    )
    monkeypatch.setattr(searches, "_MADE", {})
    setting = Setting(SceneChoice("drawer(size=(0.13, 0.1), present=0.6)"), Path("coarse"), 1)
    given = {"decider": "random", "risk": 0.2, "setting": setting, "jobs": 1, "out": tmp_path / "c.json"}
    with pytest.raises(TooFewSearches, match="each half needs 17 stops with an answer"):
        Certify(**given, searches=40).run()
    assert not (tmp_path / "c.json").exists()
    Certify(**given, searches=150).run()
    found = Certificate.load(tmp_path / "c.json")
    assert found.answers == ("here", "absent")
    assert all(wrong <= 0.2 * stops for stops, wrong in zip(found.stops, found.wrong, strict=True))
    assert "P(wrong | answer) ≤ 0.2 for every answer" in str(found)
    certified = sensor.certified(found, "random")
    here, absent = (max(0.5, limit) for limit in found.thresholds)
    assert certified.rules == replace(sensor.rules, sure=here, sure_absent=absent)
    ends = [certified.search("cube", "random", seed=seed) for seed in range(20)]
    for one in ends:
        assert one.stated >= {"here": here, "absent": absent, "unsure": 0.0}[one.answer]
        assert all(step.target < here and step.absent < absent for step in one.steps[:-1])
    shapes = {name: SHAPES[name] for name in ("sphere", "cube")}
    tray = {"sensor": "coarse", "shapes": shapes, "tray": _SMALL, "num_searches": 2, "jobs": 1}
    played = drawer(["random"], targets=["cube"], certificate=tmp_path / "c.json", **tray).episodes["random"]
    expected = [certified.search("cube", "random", seed=(0, number)) for number in (0, 1)]
    assert [one.steps for one in played] == [one.steps for one in expected]
    for wrong in (
        lambda: sensor.certified(found, "raster"),
        lambda: sensor.certified(found, "random", ["sphere", "cone"]),
        lambda: replace(sensor, tray=replace(sensor.tray, present=0.5)).certified(found, "random"),
    ):
        with pytest.raises(NotCertified):
            wrong()
    with pytest.raises(InvalidArgument, match="one decider"):
        drawer(["random", "raster"], certificate=found, **tray)
    with pytest.raises(BadArgument, match="the scene drawer takes"):
        Certify(**{**given, "setting": replace(setting, unlisted=0.1)}, searches=150).run()
