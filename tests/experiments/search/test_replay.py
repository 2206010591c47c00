"""A recorded search can be seen again."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from PIL import Image
from scipy.special import logsumexp

from activetouch.view import Bodies
from belief.problem import Confirm
from experiments.command_line.arguments import BadArgument
from experiments.scene_choice import SceneChoice
from experiments.search import film
from experiments.search import play as play_module
from experiments.search.comparison import prepared
from experiments.search.play import APPROACH, Setting, moments, play_episodes, replay
from experiments.search.replay import NoSuchEpisode, Replay
from experiments.search.replay_figures import draw_search
from experiments.search.run import read_episode

pytestmark = [pytest.mark.mujoco, pytest.mark.torch]
COARSE = Setting(SceneChoice("coarse", fidelity="quasistatic"))


@pytest.fixture(scope="module")
def run(tmp_path_factory):
    """A folder with 8 searches, and these."""
    found = prepared(COARSE, "threshold", targets="sphere", episodes=8, out=tmp_path_factory.mktemp("run"), jobs=1)
    found.play(jobs=1)
    labels = found.searches.problem.shape_labels
    return found.folder.path, [read_episode(line, labels) for line in found.lines()["threshold", "sphere"]]


@pytest.fixture(autouse=True)
def small_bodies(monkeypatch):
    """Pictures of bodies with fewer pixels, of fewer draws."""
    monkeypatch.setattr(Bodies, "of", staticmethod(partial(Bodies.of, pixels=24, draws=8)))


def play(run, numbers):
    return play_episodes(run.searches, run.deciders["threshold"], 0, numbers)[0]


@pytest.mark.usefixtures("usual_pictures")
def test_a_still_picture_is_drawn_of_the_last_search(run, tmp_path):
    Replay(run[0], decider="threshold", target="sphere", number=7, out=tmp_path / "search.png").run()
    with Image.open(tmp_path / "search.png") as picture:
        assert picture.width > 400


@pytest.mark.usefixtures("usual_pictures")
def test_a_search_with_a_joint_belief_shows_the_bodies_it_believes_in(tmp_path):
    joint = prepared(COARSE, "threshold", jobs=1)
    [episode], searches = play(joint, [0]), joint.searches
    frames, bodies = replay(searches.sensor, searches.problem, episode), Bodies.of(searches.sensor)
    for number, frame in enumerate(frames):  # the re-read touches give the belief that was recorded
        before = [f for f in frames[: number + 1] if f.step.object_index == frame.step.object_index and f.step.touch]
        assert frame.evidence.num_touches == len(before)
        own = frame.evidence.log_likelihood
        if before and frame.step.object_index == 0:
            assert np.exp(own - logsumexp(own)) == pytest.approx(frame.posterior, abs=1e-6)
    draw_search(episode, frames, searches.problem, tmp_path / "search.png", bodies)
    draw_search(episode, frames, searches.problem, tmp_path / "world.png", bodies, searches.sensor.scene)
    with Image.open(tmp_path / "search.png") as picture, Image.open(tmp_path / "world.png") as with_world:
        assert picture.width > 400
        assert with_world.height > 1.2 * picture.height  # a row more: the object at the pad
    other = prepared(replace(COARSE, observation_model="independent"), "threshold", jobs=1)
    assert Bodies.of(other.searches.sensor) is None
    shown = replay(other.searches.sensor, other.searches.problem, play(other, [0])[0])
    assert all(frame.evidence is None for frame in shown)


@pytest.fixture(scope="module")
def drawn_once():
    """The pictures of a film are drawn for its first format, and are those of the others."""
    draw, pictures = film.Film.draw, {}

    def drawn(self, moment):
        key = (self.theme, moment.words, moment.depth, moment.states, moment.milliseconds)
        return pictures[key] if key in pictures else pictures.setdefault(key, draw(self, moment))

    return drawn


@pytest.mark.parametrize("name", [pytest.param("search.webp", marks=pytest.mark.nightly), "search.gif"])
def test_a_search_is_animated_from_its_first_touch_to_its_end(run, drawn_once, name, tmp_path, monkeypatch):
    monkeypatch.setattr(film, "_DPI", 30)
    monkeypatch.setattr(film.Film, "draw", drawn_once)
    folder, episodes = run
    episode = min(episodes, key=lambda one: one.num_touches)
    number = episode.seed[-1]
    Replay(folder, decider="threshold", target="sphere", number=number, out=tmp_path / name, dark=True).run()
    with Image.open(tmp_path / name) as moving:
        first = np.asarray(moving.convert("RGB"))
        moving.seek(moving.n_frames - 1)
        assert moving.n_frames == len(episode.steps) + 3 * episode.num_touches
        assert not np.array_equal(first, np.asarray(moving.convert("RGB")))
    with pytest.raises(BadArgument, match="--dark is the ground of an animation"):
        Replay(folder, decider="threshold", target="sphere", out=tmp_path / "a.png", dark=True).run()


@pytest.mark.parametrize(
    "setting",
    [
        replace(COARSE, observation_model="independent"),
        replace(COARSE, unlisted=0.2),
        pytest.param(Setting(SceneChoice("hard", fidelity="quasistatic"), unlisted=0.2), marks=pytest.mark.nightly),
    ],
    ids=["without bodies", "with strangers", "many"],
)
def test_every_kind_of_search_has_pictures_that_say_what_happens(setting, monkeypatch):
    monkeypatch.setattr(film, "_DPI", 30)
    found = prepared(setting, "threshold", jobs=1)
    [episode], searches = play(found, [3]), found.searches
    shown = moments(searches.sensor, searches.problem, episode, APPROACH)
    drawing = film.Film(searches.sensor, searches.problem, episode.target, film.LIGHT)
    assert drawing.draw(shown[0]).size == drawing.draw(shown[-1]).size == (258, 117)
    is_confirmed = isinstance(episode.steps[-1].decision.action, Confirm)
    ended = shown[-1].states[episode.steps[-1].object_index]
    assert ended == ("rejected" if not is_confirmed else "found" if episode.success else "wrong")
    assert shown[-1].probs == pytest.approx(episode.steps[-1].belief.probs)
    monkeypatch.setattr(play_module, "MOST_PICTURES", 3)
    few = moments(searches.sensor, searches.problem, episode, APPROACH)
    assert len(few) <= 3
    assert few[-1].words == shown[-1].words


@pytest.mark.parametrize(
    ("asked", "message"),
    [
        ({"number": 99}, "--number 99.*8 searches of threshold for sphere, numbers 0 to 7"),
        ({"target": "cone"}, "no searches of 'threshold' for 'cone'.*: threshold for sphere"),
    ],
)
def test_a_search_that_is_not_there_is_refused_with_what_is(run, tmp_path, asked, message):
    how = {"decider": "threshold", "target": "sphere", **asked}
    with pytest.raises(NoSuchEpisode, match=message):
        Replay(run[0], **how, out=tmp_path / "search.png").run()
    assert list(tmp_path.iterdir()) == []
