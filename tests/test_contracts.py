"""The checks of contracts find every promise that a part of a user's own may break."""

from dataclasses import dataclass, field

import numpy as np
import pytest

from activetouch.rendering import PressureRenderer, check_renderer
from belief import Confirm, Probe, Reject, Touch
from belief.errors import ActiveTouchError, BrokenContract
from belief.observation_model import OutcomeTable, check_observation_model
from belief.synthetic import random_model
from planners import Decision, check_decider


def stop(info):
    return Decision(Confirm() if info.target_prob > 0.5 else Reject())


@dataclass
class Hostile:
    """A decider that stops after a touch, and breaks a promise."""

    promise: str
    asked: list = field(default_factory=list)
    unpicklable: object = None

    def __post_init__(self):
        if self.promise == "process":
            self.unpicklable = lambda: None

    def decide(self, info, rng):
        self.asked.append(info)
        if self.promise == "decision":
            return "confirm"
        if self.promise == "stops" or not info.history:
            return Decision(Probe(0))
        if self.promise == "nothing else" and len(self.asked) % 2:
            return Decision(Confirm())
        if self.promise == "global chance":
            return Decision(Confirm(), {"chance": float(len(self.asked))})
        if self.promise == "scores":
            return Decision(Confirm(), {"value": float("nan")})
        if self.promise == "pose":
            return Decision(Probe(99))
        return stop(info)


@pytest.mark.parametrize(
    ("promise", "words"),
    [
        ("decision", "."),
        ("pose", "."),
        ("stops", "never stops"),
        ("nothing else", "depend on nothing else"),
        ("global chance", "depend on nothing else"),
        ("scores", "scores"),
        ("process", "another process"),
    ],
)
def test_a_decider_that_breaks_a_promise_is_found(promise, words):
    with pytest.raises(ActiveTouchError, match=words):
        check_decider(Hostile(promise), np.random.default_rng(0))


def test_a_decider_that_keeps_its_promises_passes():
    assert len(check_decider(Hostile("none"), np.random.default_rng(0), num_searches=6)) == 6


class Spoilt:
    """A good observation model, of which one answer is spoilt."""

    def __init__(self, model, **answers):
        self._model, self._answers = model, answers

    def __getattr__(self, name):
        found = getattr(self._model, name)
        if name not in self._answers:
            return found
        answer = self._answers[name]
        return (lambda *given: answer(found, *given)) if callable(answer) else answer


def only(value):
    """log_likelihood that is right for no touches, and this value for any."""
    return lambda found, touches: found(touches) if not touches else np.full_like(found(touches), value)


chance = np.random.default_rng(1)


@pytest.mark.parametrize(
    ("answers", "words"),
    [
        ({"shape_labels": ("a", "a", "b", "c")}, "different names"),
        ({"shape_labels": ()}, "different names"),
        ({"log_likelihood": lambda found, touches: found(touches) + 1.0}, "zeros"),
        ({"log_likelihood": lambda found, touches: found(touches)[:-1]}, "zeros"),
        ({"log_likelihood": lambda found, touches: found(touches)[: 4 - bool(touches)]}, "must have shape"),
        ({"log_likelihood": only(np.nan)}, "must be a number"),
        ({"log_likelihood": only(np.inf)}, "must be a number"),
        ({"log_likelihood": only(-np.inf)}, "not -inf for all"),
        (
            {
                "log_likelihood": lambda found, touches: (
                    found(touches) if not touches else np.where(np.arange(4) == 1, 0.0, -np.inf)
                )
            },
            "itself",
        ),
        (
            {"log_likelihood": lambda found, touches: found(touches) + (chance.random() if touches else 0.0)},
            "differs between two calls",
        ),
        ({"outcome_table": lambda found: OutcomeTable(np.full((3, 2, 2), 0.5))}, "must have 4 shapes"),
        (
            {
                "sample": lambda found, shape, poses, rng: (
                    [Touch(0, np.zeros(4)) for _ in poses] + [Touch(0, np.zeros(4))]
                )
            },
            "has poses",
        ),
    ],
)
def test_an_observation_model_that_breaks_a_promise_is_found(answers, words):
    model = random_model(np.random.default_rng(0), num_shapes=4, num_poses=3)
    check_observation_model(Spoilt(model), np.random.default_rng(0))
    with pytest.raises(BrokenContract, match=words):
        check_observation_model(Spoilt(model, **answers), np.random.default_rng(0))


class Renderer:
    """A good renderer, of which the images are spoilt."""

    isotropic = True

    def __init__(self, spoil):
        self._spoil, self._times = spoil, 0

    def __call__(self, contact):
        self._times += 1
        return self._spoil(PressureRenderer()(contact), contact, self._times)


def _changed(image, contact, times):
    contact.pressure[...] = 0.0
    return image


@pytest.mark.parametrize(
    "spoil",
    [
        lambda image, contact, times: image + 20.0,
        lambda image, contact, times: (255 * image).astype(np.uint8),
        lambda image, contact, times: image[:-1],
        lambda image, contact, times: np.stack([image] * 2, axis=2),
        lambda image, contact, times: np.full_like(image, np.nan),
        lambda image, contact, times: image.tolist(),
        lambda image, contact, times: image * (0.5 + 0.1 * (times % 3)),
        lambda image, contact, times: np.zeros_like(image),
        lambda image, contact, times: image if contact.force < 2.0 else image[:64, :64],
        _changed,
    ],
    ids=["range", "uint8", "shape", "channels", "nan", "list", "chance", "blind", "size", "writes"],
)
def test_a_renderer_that_breaks_a_promise_is_found(spoil):
    with pytest.raises((ActiveTouchError, ValueError)):
        check_renderer(Renderer(spoil))


@pytest.mark.parametrize("thing", ["pressure", PressureRenderer, 3, lambda contact: None])
def test_what_is_no_renderer_is_found(thing):
    with pytest.raises(ActiveTouchError):
        check_renderer(thing)


def test_a_renderer_that_keeps_its_promises_passes():
    assert check_renderer(Renderer(lambda image, contact, times: image)) == (128, 128)
