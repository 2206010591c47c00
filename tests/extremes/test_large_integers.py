"""Python's integers have no largest one: those beyond floats or memory are refused with a sentence about the limit."""

from dataclasses import fields, replace

import numpy as np
import pytest

from activetouch import SCENES
from activetouch.distributions import LogUniform, Uniform
from activetouch.hand import Hand
from activetouch.pressing.contact import Pad
from activetouch.pressing.dynamic import Dynamic, GuardedMove
from activetouch.pressing.height_maps import Window
from activetouch.rotation_cells import views
from activetouch.solids.primitives import Cone, Cylinder, Ellipsoid, Prism, Sphere
from belief import Counts, SceneBelief, SearchProblem, Touch
from belief.arrangement import arrangement_marginals, num_states
from belief.calibration import TemperatureScaling
from belief.errors import ActiveTouchError
from belief.metrics import brier_score, calibration_report, expected_calibration_error, null_quantile
from belief.observation_model import fit_observation_model, spread_prior
from belief.statistics import clopper_pearson_interval, cluster_bootstrap, paired_bootstrap, wilson_interval
from belief.synthetic import random_model
from planners import make_decider
from planners.solve import SearchTouchProblem, TouchProblem, finite_horizon_value, solve

RNG = np.random.default_rng(0)
MODEL = random_model(RNG, num_shapes=3, num_poses=2)
TABLE, LABELS = MODEL.outcome_table(), MODEL.shape_labels
PROBS, TRUTH, LOGITS = np.full((4, 2), 0.5), [0, 1, 0, 1], np.random.default_rng(1).normal(size=(12, 3))
SCENE = SCENES["coarse"].scene
BODY = SCENE.sample_object("cone", RNG)
ONE = TouchProblem(TABLE.probs, np.full(3, 1 / 3), 0, 0.1)

COUNTS = {
    "Hand.around": Hand.around,
    "pouct": lambda n: make_decider(f"pouct(simulations={n})", TABLE),
    "simulations": lambda n: make_decider("pouct", TABLE, simulations=n),
    "num_objects of a scene": lambda n: SceneBelief(SearchProblem(LABELS, ("p", "q"), n, "independent"), MODEL),
    "num_objects to solve": lambda n: SearchTouchProblem(TABLE.probs, n, "independent", 0, 0.1),
    "rounds": lambda n: solve(ONE, rounds=(n,)),
    "max_touches": lambda n: finite_horizon_value(ONE, n),
    "num_shapes": lambda n: random_model(RNG, n, 2),
    "num_poses": lambda n: random_model(RNG, 2, n),
    "num_poses to fit": lambda n: fit_observation_model(LOGITS, np.arange(12) % 3, np.arange(12), num_poses=n),
    "num_folds": lambda n: fit_observation_model(LOGITS, np.arange(12) % 3, np.arange(12), num_folds=n),
    "num_bins": lambda n: expected_calibration_error(PROBS, TRUTH, num_bins=n),
    "num_resamples of a report": lambda n: calibration_report(PROBS, TRUTH, num_resamples=n),
    "num_resamples of a quantile": lambda n: null_quantile(PROBS, brier_score, RNG, num_resamples=n),
    "num_resamples of pairs": lambda n: paired_bootstrap([1, 0, 1], [0, 0, 1], RNG, num_resamples=n),
    "num_resamples of clusters": lambda n: cluster_bootstrap([1, 0, 1], [0, 0, 1], RNG, num_resamples=n),
    "num_worlds": spread_prior,
    "counts and objects": lambda n: num_states([n, n], n),
    "directions": lambda n: views(n, 4),
    "rolls": lambda n: views(4, 4 * n),
    "num_taxels": lambda n: Pad(num_taxels=n),
    "num_pixels": lambda n: Window(0.02, n),
    "num_facets": lambda n: Cone(0.01, 0.02, n),
    "num_sides": lambda n: Prism(n, 0.01, 0.02),
}
NUMBERS = {
    "successes": lambda n: wilson_interval(n, n),
    "trials": lambda n: clopper_pearson_interval(1, n),
    "touch_cost": lambda n: SearchProblem(LABELS, ("p",), 2, touch_cost=n),
    "touch_cost to solve": lambda n: TouchProblem(TABLE.probs, np.full(3, 1 / 3), 0, n),
    "touch_limit": lambda n: SearchProblem(LABELS, ("p",), 2, touch_limit=n),
    "Counts": lambda n: Counts({"a": n}),
    "counts": lambda n: arrangement_marginals(np.zeros((2, 2)), [n, 1]),
    "logits": lambda n: Touch(0, [n, 0, 0]),
    "a label": lambda n: brier_score(PROBS, [0, 1, 0, n]),
    "temperature": lambda n: TemperatureScaling(n, "ok"),
    "sharpness": lambda n: random_model(RNG, sharpness=n),
    "Uniform": lambda n: Uniform(0, n),
    "LogUniform": lambda n: LogUniform(1, n),
    "force": lambda n: SCENE.press_model.press(SCENE.pad, BODY, n),
    "a sphere": Sphere,
    "a cylinder": lambda n: Cylinder(0.01, n),
    "a cone": lambda n: Cone(n, 0.01),
    "an ellipsoid": lambda n: Ellipsoid((0.01, 0.01, n)),
    **{
        f"{type(base).__name__}.{name}": lambda n, base=base, name=name: replace(base, **{name: n})
        for base, names in (
            (Pad(), [field.name for field in fields(Pad)]),
            (Dynamic(), ["speed", "timestep"]),
            (GuardedMove(), ["speed", "timestep"]),
        )
        for name in names
    },
}


@pytest.mark.parametrize("number", [10**9, 10**12, 10**400], ids=["1e9", "1e12", "1e400"])
@pytest.mark.parametrize("name", COUNTS)
def test_a_count_beyond_memory_or_patience_is_refused_at_once(name, number):
    with pytest.raises((ValueError, ActiveTouchError), match=r"at most|must|more than|need"):
        COUNTS[name](number)


@pytest.mark.parametrize("number", [10**400, -(10**400)], ids=["large", "negative"])
@pytest.mark.parametrize("name", NUMBERS)
def test_an_integer_beyond_floats_is_refused_with_the_name_of_what_it_was_for(name, number):
    with pytest.raises((ValueError, ActiveTouchError), match=r"must|need|finite|positive|real numbers") as caught:
        NUMBERS[name](number)
    assert "convert" not in str(caught.value)
