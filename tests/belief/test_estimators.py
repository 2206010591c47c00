"""Calibrations and observation models as estimators of scikit-learn: its checks and tools, labels of any kind."""

import pickle
import re
import subprocess
import sys
from functools import partial

import numpy as np
import pytest

pytest.importorskip("sklearn")

from sklearn.base import clone
from sklearn.calibration import CalibratedClassifierCV
from sklearn.discriminant_analysis import LinearDiscriminantAnalysis
from sklearn.ensemble import RandomForestClassifier
from sklearn.frozen import FrozenEstimator
from sklearn.linear_model import LogisticRegression
from sklearn.metrics import log_loss
from sklearn.model_selection import GridSearchCV, GroupKFold, cross_val_score
from sklearn.naive_bayes import GaussianNB
from sklearn.pipeline import make_pipeline
from sklearn.preprocessing import FunctionTransformer, StandardScaler
from sklearn.utils.estimator_checks import check_estimator

from belief.calibration import CALIBRATIONS, TemperatureScaling, logits_from_probs
from belief.estimators import CalibratedClassifier, ObservationModelClassifier
from belief.observation_model import fit_observation_model, read_observation_model
from belief.observation_model.registry import fits
from belief.observation_model.selection import log_posteriors_by_touch
from belief.touch_batch import TouchBatch

NAMES = np.array(["mug", "ball", "box"])
FEW = {name: fits()[name] for name in ("confusion", "ratio")}
Observed = partial(ObservationModelClassifier, candidates=FEW)
ByConfusion = partial(ObservationModelClassifier, candidates={"confusion": FEW["confusion"]})


@pytest.fixture(scope="module")
def touches():
    """Logits of 150 objects that were touched four times, their labels and objects."""
    rng, groups = np.random.default_rng(0), np.repeat(np.arange(150), 4)
    own = rng.normal(size=(150, 3))[groups]
    return 3.0 * (np.eye(3)[groups % 3] + 0.4 * own + 0.4 * rng.normal(size=(600, 3))), groups % 3, groups


@pytest.fixture(scope="module")
def features(touches):
    """Features, from which a classifier makes such logits."""
    logits, labels, groups = touches
    return logits @ np.random.default_rng(1).normal(size=(3, 7)), NAMES[labels], groups


# scikit-learn's checks give any number of columns. Where X holds the logits, there is one for each class.
NEED_A_COLUMN_FOR_EACH_CLASS = (
    *("estimators_overwrite_params", "estimators_fit_returns_self", "readonly_memmap_input", "estimators_dtypes"),
    *("n_features_in_after_fitting", "positive_only_tag_during_fit", "dtype_object", "pipeline_consistency"),
    *("estimators_nan_inf", "estimators_pickle", "classifiers_classes", "classifiers_train"),
)


@pytest.mark.parametrize(
    ("estimator", "failing"),
    [
        pytest.param(CalibratedClassifier(LogisticRegression(max_iter=1000), cv=2), (), marks=pytest.mark.nightly),
        (CalibratedClassifier(GaussianNB(), "temperature"), ()),
        (ByConfusion(GaussianNB(), num_folds=2, cv=2), ()),
        pytest.param(ByConfusion(LogisticRegression(max_iter=1000), num_folds=2, cv=2), (), marks=pytest.mark.nightly),
        (CalibratedClassifier(), NEED_A_COLUMN_FOR_EACH_CLASS),
        (ByConfusion(num_folds=2), NEED_A_COLUMN_FOR_EACH_CLASS),
    ],
)
@pytest.mark.filterwarnings("ignore")  # of data that are made to be odd
def test_the_checks_of_scikit_learn_pass(estimator, failing):
    reason = "X has a column of logits for each class"
    found = check_estimator(
        estimator, expected_failed_checks={f"check_{name}": reason for name in failing}, on_skip=None
    )
    assert sum(one["status"] == "passed" for one in found) >= (35 if failing else 50)
    assert {one["check_name"] for one in found if one["status"] == "xfail"} == {f"check_{name}" for name in failing}
    for one in found:
        if one["status"] == "xfail" and one["check_name"] not in ("check_classifiers_train",):
            assert re.search(r"columns of logits for \d classes|unexpectedly", str(one["exception"]))


@pytest.mark.parametrize("name", CALIBRATIONS)
def test_a_calibration_of_logits_is_the_same_calibration(name, touches):
    logits, labels, _ = touches
    own = CALIBRATIONS[name]().fit(logits, labels)
    for kind in (name, CALIBRATIONS[name]()):
        fitted = CalibratedClassifier(calibration=kind).fit(logits, labels)
        assert fitted.calibration_.to_fields() == own.to_fields()
        np.testing.assert_array_equal(fitted.predict_proba(logits), own.predict_proba(logits))


def test_an_observation_model_of_logits_is_the_same_model(touches):
    logits, labels, groups = touches
    fitted = Observed().fit(logits, NAMES[labels], groups, groups % 2)
    columns = np.searchsorted(np.sort(NAMES), NAMES[labels])
    order = np.argsort(NAMES)
    choice = fit_observation_model(
        logits, columns, groups, groups % 2, shape_labels=sorted(NAMES.tolist()), candidates=FEW
    )
    assert fitted.choice_.losses == choice.losses
    assert fitted.model_.to_json() == read_observation_model(choice.model.to_json()).to_json()
    assert fitted.classes_.tolist() == NAMES[order].tolist()
    by_touch = np.exp(log_posteriors_by_touch(choice.model, TouchBatch(np.zeros((1, 4), int), logits[None, :4])))
    np.testing.assert_allclose(fitted.predict_proba(logits[:4], groups[:4]), np.repeat(by_touch[:, -1], 4, axis=0))
    np.testing.assert_allclose(fitted.predict_proba(logits[:1]), by_touch[:, 0])
    shuffled = np.random.default_rng(0).permutation(600)
    together = fitted.predict_proba(logits, groups)
    np.testing.assert_allclose(fitted.predict_proba(logits[shuffled], groups[shuffled]), together[shuffled])
    # Four touches are right more often than one, and state less than the product of four independent ones.
    alone, read = fitted.predict(logits), fitted.predict(logits, groups=groups)
    assert (read == NAMES[labels]).mean() > (alone == NAMES[labels]).mean() + 0.02


LABELS = [
    np.array(["mug", "ball", "box"]),
    np.array(["mug", "ball", "box"], object),
    np.array([1, 2, 3]),
    np.array([3, 1, 2], np.uint8),
    np.array([-1.0, 0.0, 7.0]),
]


@pytest.mark.parametrize("make", [CalibratedClassifier, Observed])
@pytest.mark.parametrize("names", LABELS, ids=lambda names: f"{names.dtype}")
def test_labels_are_of_any_kind(make, names, touches):
    logits, labels, groups = touches
    plain = make().fit(logits, labels, groups).predict_proba(logits)
    fitted = make(classes=names).fit(logits, names[labels], groups)
    np.testing.assert_array_equal(fitted.predict_proba(logits), plain)
    assert fitted.predict(logits).dtype == names.dtype
    assert fitted.score(logits, names[labels]) == (plain.argmax(axis=1) == labels).mean() > 0.6
    order = np.argsort(names)  # by default, columns are of the sorted labels
    ordered = make().fit(logits[:, order], names[labels], groups)
    np.testing.assert_allclose(ordered.predict_proba(logits[:, order]).sum(1), 1.0)
    assert ordered.classes_.tolist() == names[order].tolist()


@pytest.mark.parametrize("make", [CalibratedClassifier, Observed])
def test_two_classes_may_be_booleans_and_one_column(make, touches):
    logits, labels, groups = touches
    odds, is_mug = logits[:, :1] - logits[:, 1:2], labels == 0
    fitted = make().fit(odds, is_mug, groups)
    assert fitted.classes_.tolist() == [False, True]
    both = np.hstack([0 * odds, odds])
    np.testing.assert_array_equal(fitted.predict_proba(odds), make().fit(both, is_mug, groups).predict_proba(both))
    assert fitted.predict_proba(odds).shape == (600, 2)
    assert fitted.score(odds, is_mug) > 0.7


@pytest.mark.parametrize("classifier", [LogisticRegression(), GaussianNB(), RandomForestClassifier(10, random_state=0)])
def test_a_classifier_is_calibrated_on_rows_that_it_has_not_seen(classifier, features):
    X, y, groups = features
    fitted = CalibratedClassifier(classifier).fit(X[:300], y[:300], groups[:300])
    raw = clone(classifier).fit(X[:300], y[:300])
    np.testing.assert_array_equal(fitted.estimator_.predict(X), raw.predict(X))
    theirs = CalibratedClassifierCV(classifier, ensemble=False).fit(X[:300], y[:300])
    ours, before, other = (log_loss(y[300:], one.predict_proba(X[300:])) for one in (fitted, raw, theirs))
    assert ours < before + 0.01
    assert ours < other + 0.02
    assert fitted.n_features_in_ == 7


def test_rows_of_a_group_are_in_one_fold():
    """The label can be told by the object alone, so a classifier which has seen the object is right, and others not."""
    rng = np.random.default_rng(0)
    groups = rng.permutation(np.arange(600) // 6)
    X, y = np.eye(100)[groups] + 1e-3 * rng.normal(size=(600, 100)), NAMES[rng.integers(3, size=100)][groups]
    classifier = LogisticRegression(C=1e4)
    leaked, held = (CalibratedClassifier(classifier, "temperature").fit(X, y, some) for some in (None, groups))
    assert leaked.calibration_.temperature < 1.0
    assert held.calibration_.status != "ok" or held.calibration_.temperature > 10.0
    folds = [*GroupKFold(5).split(X, y, groups)]  # a splitter, or folds as such, are taken as they are
    for cv in (GroupKFold(5), folds):
        again = CalibratedClassifier(classifier, "temperature", cv=cv).fit(X, y, groups)
        assert again.calibration_.status != "ok" or again.calibration_.temperature > 10.0
    with pytest.raises(ValueError, match="not finite"):
        CalibratedClassifier(classifier, cv=folds[:2]).fit(X, y)


def test_the_tools_of_scikit_learn_take_them(features, touches):
    X, y, groups = features
    logits, labels, _ = touches
    pipeline = make_pipeline(StandardScaler(), CalibratedClassifier(LinearDiscriminantAnalysis()))
    scores = cross_val_score(pipeline, X, y, groups=groups, cv=GroupKFold(5), scoring="neg_log_loss")
    assert (scores > -0.8).all()
    scores = cross_val_score(
        Observed(), logits, NAMES[labels], groups=groups, cv=GroupKFold(5), params={"groups": groups}
    )
    assert (scores > 0.6).all()
    probs = np.exp(logits) / np.exp(logits).sum(axis=1, keepdims=True)
    from_probs = make_pipeline(FunctionTransformer(logits_from_probs), CalibratedClassifier())
    np.testing.assert_allclose(
        from_probs.fit(probs, labels).predict_proba(probs),
        CalibratedClassifier().fit(logits, labels).predict_proba(logits),
        atol=1e-6,
    )
    search = GridSearchCV(CalibratedClassifier(), {"calibration": [*CALIBRATIONS]}, cv=3, scoring="neg_log_loss")
    assert search.fit(logits, labels).best_params_["calibration"] in CALIBRATIONS
    nested = clone(pipeline).set_params(calibratedclassifier__estimator__shrinkage="auto")
    assert nested.get_params()["calibratedclassifier__estimator"].solver == "svd"
    assert clone(CalibratedClassifier(calibration=TemperatureScaling(2.0, "ok"))).calibration.temperature == 2.0


def test_a_frozen_classifier_is_calibrated_with_labels_of_which_some_are_missing(features):
    X, y, groups = features
    frozen = FrozenEstimator(GaussianNB().fit(X[:300], y[:300]))
    rows = np.flatnonzero(y[300:] != "box") + 300
    fitted = CalibratedClassifier(frozen, classes=NAMES).fit(X[rows], y[rows], groups[rows])
    assert fitted.predict_proba(X).shape == (600, 3)
    assert fitted.estimator_ is frozen
    with pytest.raises(ValueError, match="3 columns of logits for 2 classes"):
        CalibratedClassifier(frozen).fit(X[rows], y[rows])
    rare = y.copy()
    rare[:4] = "cup"  # one object, and so in no other fold
    with pytest.warns(UserWarning, match="least populated class"):
        found = CalibratedClassifier(GaussianNB()).fit(X, rare, groups)
    assert found.predict_proba(X).shape == (600, 4)


@pytest.mark.parametrize("make", [CalibratedClassifier, Observed])
@pytest.mark.parametrize(
    ("change", "said"),
    [
        (lambda X, y: (np.where(np.arange(600)[:, None] == 5, np.nan, X), y), "NaN"),
        (lambda X, y: (np.where(np.arange(600)[:, None] == 5, np.inf, X), y), "infinity"),
        (lambda X, y: (X[:0], y[:0]), "0 sample"),
        (lambda X, y: (X[:9], y), "inconsistent"),
        (lambda X, y: (X, np.array(["mug"] * 600)), "600 labels of 1 class"),
        (lambda X, y: (X, y + 0.5 * np.arange(600)), "Unknown label type"),
        (lambda X, y: (X, np.stack([y, y], axis=1)), "1d array"),
        (lambda X, y: (X[:, :2], y), "2 columns of logits for 3 classes"),
        (lambda X, y: (X.astype(str), y), "could not convert|strings|numeric"),
        (lambda X, y: (X, np.where(y == 0, None, y)), "Unknown label type|not supported"),
    ],
)
def test_what_cannot_be_fitted_is_an_error_that_says_why(make, change, said, touches):
    X, y = change(*touches[:2])
    with pytest.raises((ValueError, TypeError), match=said):
        make().fit(X, y)


def test_other_arguments_are_errors_that_say_why(touches):
    logits, labels, _ = touches
    with pytest.raises(ValueError, match="structured_matrix"):
        CalibratedClassifier(calibration="isotonic").fit(logits, labels)
    with pytest.raises(ValueError, match="label 2, which is not in classes="):
        CalibratedClassifier(classes=(0, 1, 3)).fit(logits, labels)
    with pytest.raises(ValueError, match=r"object 0\.0 has shape 0, and shape 1 in row 4"):
        Observed().fit(logits, labels, np.zeros(600))
    with pytest.raises(ValueError, match="3 columns of logits for 4 classes"):
        CalibratedClassifier(classes="abcd").fit(logits, np.array([*"abc"])[labels])
    with pytest.warns(UserWarning, match="all 200 labels are 0"):
        one = CalibratedClassifier(classes=NAMES).fit(logits[labels == 0], NAMES[labels[labels == 0]])
    assert one.predict_proba(logits).shape == (600, 3)
    with pytest.warns(UserWarning, match="take the logarithms of probabilities"):
        CalibratedClassifier().fit(np.full((6, 3), 1 / 3), np.arange(6) % 3)


@pytest.mark.parametrize("dtype", [np.float16, np.float32, np.int8, np.longdouble, object])
def test_numbers_may_be_of_any_type(dtype, touches):
    logits, labels, groups = touches
    probs = CalibratedClassifier().fit(logits.astype(dtype), labels).predict_proba(logits.astype(dtype))
    np.testing.assert_allclose(probs.sum(axis=1), 1.0)
    assert Observed().fit(logits.astype(dtype), labels, groups).predict_proba(logits.astype(dtype)).dtype == float


def test_they_are_pickled_like_scikit_learns_own_and_kept_in_files_that_run_no_code(features):
    X, y, groups = features
    for made in (CalibratedClassifier(GaussianNB()), Observed(GaussianNB())):
        fitted = made.fit(X, y, groups)
        np.testing.assert_array_equal(pickle.loads(pickle.dumps(fitted)).predict_proba(X), fitted.predict_proba(X))
    kept = read_observation_model(fitted.model_.to_json())
    assert kept.shape_labels == ("ball", "box", "mug")


def test_without_scikit_learn_the_error_names_the_extra():
    code = "import sys; sys.modules['sklearn'] = None; import belief.calibration, belief.estimators"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert re.search(r"MissingPackage: scikit-learn is not installed: pip install '.*\[recorded\]'", done.stderr)
