"""Holders of arrays: nobody changes what they hold, neither through the caller's array nor through a copy of them."""

import copy
import pickle
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from belief import Belief, BeliefTracker, SceneBelief, SearchProblem, Touch
from belief.calibration import CALIBRATIONS, TemperatureScaling
from belief.cell_kernel import CellKernel
from belief.coarse_to_fine import NestedCells
from belief.conflict import ConflictTest, Novelty, SimulatedTouches, UsualMisfit
from belief.frozen import FrozenArrays, frozen
from belief.metrics import reliability_curve
from belief.observation_model import (
    ConfusionModel,
    FittedRigidBody,
    FixedHypotheses,
    FixedWorlds,
    GaussianModel,
    HeavyTailsModel,
    OutcomeTable,
    PLDAModel,
    RatioModel,
    RigidBodyModel,
    SensorHealthModel,
)
from belief.observation_model.action_kernel import ActionKernelModel
from belief.observation_model.calibration_data import LabelledTouches
from belief.observation_model.context_fit import OutcomeCode
from belief.observation_model.context_model import ContextModel
from belief.observation_model.doubted_sensor import DoubtedSensorModel
from belief.observation_model.moving_body import MovingBodyModel
from belief.observation_model.nested_bodies import NestedBodyModel
from belief.observation_model.outcome_mixture import OutcomeMixture, SharedMixture, Views
from belief.observation_model.plda import Components, LogitEmbedding
from belief.observation_model.varied_bodies import VariedBodyModel
from belief.problem import Elsewhere
from belief.statistics.online_stops import OnlineStops
from belief.synthetic import random_model
from belief.touch_batch import TouchBatch
from planners.classification import ActiveClassification, Answer
from planners.solve import TouchProblem
from planners.touch_problem import SearchTouchProblem

LABELS = ("ball", "cube")
ROWS = np.array([[2.0, 0.0], [0.0, 1.0], [1.0, 0.0], [0.5, 3.0]])
TRUTH = np.array([0, 1, 0, 1])
ONE = np.ones((1, 5, 4))
TABLE = np.array([[[0.9, 0.1], [0.2, 0.8]]])
IDENTITY = np.eye(1)


def embedding():
    return LogitEmbedding(np.full(2, -9.0), np.full(2, 9.0))


# Each from arrays that it is given, so that all of them can be written to afterwards.
HOLDERS = {
    "Belief": (lambda a: Belief(LABELS, a), [np.log([0.25, 0.75])]),
    "Touch": (lambda a, b: Touch(0, a, b), [ROWS[0], np.ones(3, np.float32)]),
    "Touch with an image": (lambda a, b: replace(Touch(0, a), image=b), [ROWS[0], np.ones((2, 2), np.uint8)]),
    "Elsewhere": (lambda a: Elsewhere((1.0, 0.5), a), [np.ones((2, 3, 4), np.float32)]),
    "TouchBatch": (TouchBatch, [np.zeros((1, 4), np.int64), ROWS[None], np.ones((1, 4, 3))]),
    "TouchBatch of touches": (lambda a: TouchBatch.of([[Touch(0, row) for row in a]]), [ROWS]),
    "LabelledTouches": (lambda a, b: LabelledTouches.of([Touch(0, row) for row in a], b, None), [ROWS, TRUTH]),
    "OutcomeTable": (OutcomeTable, [TABLE]),
    "OutcomeMixture": (OutcomeMixture, [np.array([[0.5, 0.5], [1.0, 0.0]]), np.full((1, 2, 2, 3), 1 / 3)]),
    "Views": (Views, [np.array([0, 0]), np.array([[0, 1], [1, 0]])]),
    "SharedMixture": (
        lambda a, b: SharedMixture(a, 1, b, Views(np.array([0, 0]), np.array([[0, 1], [1, 0]]))),
        [np.array([[0.5, 0.5]]), np.full((1, 1, 2, 4), 0.25, np.float32)],
    ),
    "LogitEmbedding": (LogitEmbedding, [np.full(2, -9.0), np.full(2, 9.0)]),
    "ConfusionModel": (lambda a: ConfusionModel(LABELS, a, TemperatureScaling(1.0, "ok")), [TABLE]),
    "GaussianModel": (
        lambda a, b: GaussianModel(LABELS, embedding(), a, Components(0 * b, 0 * b, b)),
        [np.array([[[0.0], [1.0]]]), IDENTITY],
    ),
    "HeavyTailsModel": (
        lambda a, b, c: HeavyTailsModel(LABELS, 1.0, a, b, c, 0.5),
        [np.eye(2)[None], np.ones(2), np.ones(2)],
    ),
    "PLDAModel": (
        lambda a, b: PLDAModel(LABELS, embedding(), a, Components(b, b, b)),
        [np.array([[[0.0], [1.0]]]), IDENTITY],
    ),
    "RatioModel": (
        lambda a, b: RatioModel(LABELS, TemperatureScaling(), a, 0.5, b),
        [np.array([0.5, 0.5]), ROWS[None]],
    ),
    "NestedCells": (lambda a, b: NestedCells((a, b)), [np.full(2, 0.5), np.full(4, 0.25)]),
    "NestedBodyModel": (
        lambda a, b: NestedBodyModel(LABELS, NestedCells((np.ones(1),)), None, 1.0, 0.0, a, b),
        [np.ones((3, 4), np.float32), np.zeros(3, np.float32)],
    ),
    "ActionKernelModel": (
        lambda a, b: ActionKernelModel(LABELS, a, b),
        [np.full((2, 2), 0.5), np.ones((2, 3, 2))],
    ),
    "ContextModel": (
        lambda a, b: ContextModel(LABELS, a, b),
        [np.full((3, 2, 2, 4), 0.25), np.full((2, 2), 0.5)],
    ),
    "OutcomeCode": (
        lambda a, b: OutcomeCode(((0, 1),), (a, a), (b,), 2),
        [np.array([0.5]), np.array([0, 3])],
    ),
    "ActiveClassification": (
        lambda a, b, c: ActiveClassification(ContextModel(LABELS, a), prior=b, costs=c),
        [TABLE, np.array([0.5, 0.5]), np.ones(1)],
    ),
    "Answer": (lambda a: Answer(0, 1, 0.9, True, (0,), 1.0, a), [np.full((2, 2), 0.5)]),
    "OnlineStops": (
        lambda a, b, c, d: OnlineStops(wrong=a, reached=b, seen=c, alarm=d),
        [np.zeros(14, np.int64), np.zeros((3, 14), np.bool_), np.zeros(14, np.int64), np.full(6, 1 / 6)],
    ),
    "FixedHypotheses": (FixedHypotheses, [np.ones((1, 2, 3, 4), np.float32)]),
    "FittedRigidBody": (
        lambda a, b: FittedRigidBody(LABELS, 3, 1.0, a, b),
        [np.ones((1, 5, 4)), np.ones((1, 5, 2))],
    ),
    "RigidBodyModel": (
        lambda a, b, c: RigidBodyModel(LABELS, 3, 1.0, b, c, hypotheses=FixedHypotheses(a)),
        [np.ones((1, 2, 3, 4), np.float32), np.ones((1, 5, 4)), np.ones((1, 5, 2))],
    ),
    "CellKernel": (
        CellKernel,
        [np.ones(2) / 2, *np.array([[0, 1, 0], [0, 1, 2]], np.int32), np.ones(2) / 2, np.arange(2), np.ones(2)],
    ),
    "MovingBodyModel": (
        lambda a, b, c: MovingBodyModel(
            LABELS, 3, 1.0, b, c, hypotheses=FixedHypotheses(a), prob=0.0, kernel=None, error=None
        ),
        [np.ones((1, 2, 3, 4), np.float32), np.ones((1, 5, 4)), np.ones((1, 5, 2))],
    ),
    "FixedWorlds": (FixedWorlds, [np.ones((1, 2, 2, 3, 4), np.float32)]),
    "SensorHealthModel": (
        lambda a, b: SensorHealthModel(
            RigidBodyModel(LABELS, 3, 1.0, ONE, ONE[..., :2], hypotheses=FixedHypotheses(np.ones((1, 2, 3, 4)))),
            FixedWorlds(a),
            ("soft",),
            b,
        ),
        [np.ones((1, 1, 2, 3, 4), np.float32), np.array([0.8, 0.1, 0.1])],
    ),
    "VariedBodyModel": (
        lambda a, b, c: VariedBodyModel(
            RigidBodyModel(LABELS, 3, 1.0, b, c, hypotheses=FixedHypotheses(a)), SimpleNamespace(shapes=np.array([0]))
        ),
        [np.ones((1, 2, 3, 4), np.float32), np.ones((1, 5, 4)), np.ones((1, 5, 2))],
    ),
    "DoubtedSensorModel": (
        lambda a, b, c: DoubtedSensorModel(
            RigidBodyModel(LABELS, 3, 1.0, b, c, hypotheses=FixedHypotheses(a)), SimpleNamespace(labels=("soft",))
        ),
        [np.ones((1, 2, 3, 4), np.float32), np.ones((1, 5, 4)), np.ones((1, 5, 2))],
    ),
    "Novelty": (Novelty, [ROWS, np.eye(2), np.zeros(4), np.ones(4)]),
    "SimulatedTouches": (SimulatedTouches, [ROWS, np.zeros(1, int), np.zeros(1), np.ones(1), np.zeros((2, len(ROWS)))]),
    "UsualMisfit": (UsualMisfit, [np.zeros((3, 1)), np.zeros((3, 2)), np.ones((3, 2))]),
    "ConflictTest": (
        lambda a, b, c: ConflictTest(Novelty(ROWS, np.eye(2), b[0], b[0]), UsualMisfit(a, a, a), a[0], b[0], c, 20),
        [np.zeros((2, 3)), np.zeros((2, 2)), np.zeros((2, 3, 20))],
    ),
    "ReliabilityCurve": (lambda a: reliability_curve(a, TRUTH), [np.full((4, 2), 0.5)]),
    "TouchProblem": (lambda a, b: TouchProblem(a, b, 0, 0.1), [TABLE, np.array([0.5, 0.5])]),
    "SearchTouchProblem": (
        lambda a, b: SearchTouchProblem(a, 2, "independent", 0, 0.1, b),
        [TABLE, np.array([0.5, 0.5])],
    ),
    **{
        name: (lambda a, kind=kind: kind().fit(a, TRUTH), [ROWS])
        for name, kind in CALIBRATIONS.items()
        if issubclass(kind, FrozenArrays)
    },
}


def arrays_in(value):
    """All arrays of an object and of what it holds."""
    if isinstance(value, np.ndarray):
        yield value
    elif isinstance(value, tuple):
        for part in value:
            yield from arrays_in(part)
    elif hasattr(value, "__dataclass_fields__"):
        for name in value.__dataclass_fields__:
            yield from arrays_in(getattr(value, name))


def made(name):
    make, given_ = HOLDERS[name]
    mine = [array.copy() for array in given_]
    return make(*mine), mine


def subclasses(kind):
    for child in kind.__subclasses__():
        yield child
        yield from subclasses(child)


def test_every_holder_of_this_package_is_tried():
    tried = {type(made(name)[0]).__name__ for name in HOLDERS}
    known = {kind.__name__ for kind in subclasses(FrozenArrays) if kind.__module__.startswith(("belief.", "planners."))}
    assert known - tried <= {"ArrayModel", "AffineCalibration"}


@pytest.mark.parametrize("name", HOLDERS)
@given(st.data())
def test_writing_to_an_array_that_was_given_changes_nothing(name, data):
    holder, mine = made(name)
    before = [array.copy() for array in arrays_in(holder)]
    array = data.draw(st.sampled_from(mine))
    array.flat[data.draw(st.integers(0, array.size - 1))] = 77
    for now, then in zip(arrays_in(holder), before, strict=True):
        np.testing.assert_array_equal(now, then)


@pytest.mark.parametrize("name", HOLDERS)
@pytest.mark.parametrize("again", [lambda x: x, copy.copy, copy.deepcopy, lambda x: pickle.loads(pickle.dumps(x))])
def test_arrays_are_read_only_and_stay_so_in_copies_and_pickles(name, again):
    holder = again(made(name)[0])
    found = list(arrays_in(holder))
    assert found
    for array, original in zip(found, arrays_in(made(name)[0]), strict=True):
        np.testing.assert_array_equal(array, original)
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0


def test_arrays_of_many_numbers_are_printed_by_their_shape():
    model = ContextModel(("a", "b"), np.full((3, 2, 1, 4), 0.25))
    assert "shape_labels=('a', 'b'), probs=<float64 (3, 2, 1, 4)>, weights=array([[1.]," in repr(model)


def test_a_view_of_an_array_that_can_be_written_to_is_copied():
    mine = np.zeros((2, 3))
    view = mine[0]
    view.flags.writeable = False
    kept = frozen(view)
    mine[0] = 1.0
    assert kept.tolist() == [0.0] * 3
    assert frozen(kept[1:]).base is kept


@pytest.mark.parametrize("follow", ["scene", "tracker"])
def test_one_array_for_all_touches_gives_the_beliefs_of_an_array_for_each(follow):
    def run(shared):
        model, array = random_model(np.random.default_rng(0), num_shapes=3), np.zeros(3)
        rng = np.random.default_rng(1)
        tracker = BeliefTracker(Belief.uniform(model.shape_labels), model)
        scene = SceneBelief(SearchProblem(model.shape_labels, ("p",), 2, "independent"), model)
        for _ in range(6):
            array = array if shared else np.zeros(3)
            array[:] = rng.normal(size=3)
            tracker.update(Touch(0, array)) if follow == "tracker" else scene.update(0, [Touch(0, array)])
        array[:] = -1e9
        touches = tracker.touches if follow == "tracker" else scene.touches(0)
        belief = tracker.belief if follow == "tracker" else scene.belief(0)
        return belief.probs.tolist(), [touch.logits.tolist() for touch in touches]

    assert run(shared=True) == run(shared=False)
