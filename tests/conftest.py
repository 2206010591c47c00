import os
from collections import Counter
from functools import cache

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from belief.observation_model import ConfusionModel, FixedHypotheses, RigidBodyModel
from belief.synthetic import random_model

os.environ["HF_HUB_OFFLINE"] = "1"  # before transformers is imported

# Seeds are fixed so that a failure is a finding, not weather; the machine's speed must not fail a test.
settings.register_profile(
    "default", derandomize=True, max_examples=40, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("default")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests come first, so that no worker is left with one of them while the others have finished."""
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    items.sort(key=lambda item: -slow[item.path])


@pytest.fixture
def model() -> ConfusionModel:
    return random_model(np.random.default_rng(0))


@pytest.fixture
def body() -> RigidBodyModel:
    """A joint model of four shapes in three poses, whose repeats are discounted."""
    rng = np.random.default_rng(0)
    hypotheses, references = rng.normal(size=(3, 4, 80, 4)).astype(np.float32), 2.0 * rng.normal(size=(3, 9, 4))
    labels, logits = tuple(f"shape_{k}" for k in range(4)), rng.normal(size=(3, 9, 4))
    return RigidBodyModel(
        labels, 80, 1.0, references, logits, correlation=0.4, drift=0.05, hypotheses=FixedHypotheses(hypotheses)
    )


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)


@pytest.fixture(scope="module")
def sensors_loaded_once():
    """Shipped sensors are loaded once for a file of tests, however many scripts or blocks of code ask for them."""
    from activetouch import TactileSensor

    with pytest.MonkeyPatch.context() as patch:
        shipped, kept = TactileSensor.shipped, cache(TactileSensor.shipped)

        def once(*which, **more):
            return (shipped if more or len(which) > 1 else kept)(*which, **more)

        patch.setattr(TactileSensor, "shipped", once)
        yield


@pytest.fixture
def few_hypotheses(monkeypatch):
    """Readers of any object predict 128 contacts for each shape and pose: what is run counts, not how well it reads."""
    from activetouch.perception.contacts import hypotheses

    monkeypatch.setattr(hypotheses, "FEWEST", 128)
    monkeypatch.setattr(hypotheses, "MOST", 128)
