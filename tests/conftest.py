import os

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from belief.observation_model import ConfusionModel
from belief.synthetic import random_model

os.environ["HF_HUB_OFFLINE"] = "1"  # before transformers is imported

# Seeds are fixed so that a failure is a finding, not weather; the machine's speed must not fail a test.
settings.register_profile("default", derandomize=True, deadline=None, suppress_health_check=[HealthCheck.too_slow])
settings.load_profile("default")


@pytest.fixture
def model() -> ConfusionModel:
    return random_model(np.random.default_rng(0))


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(0)
