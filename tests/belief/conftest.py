"""Every kind of observation model there is, constructed and fitted: the laws run on each."""

from functools import cache
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.linalg import helmert

from belief import Touch
from belief.calibration import TemperatureScaling
from belief.observation_model import ConfusionModel, GaussianModel, HeavyTailsModel, PLDAModel, RatioModel
from belief.observation_model.plda import Components, LogitEmbedding
from belief.synthetic import random_model

LABELS = ("ball", "cube", "cone")


def plda_world(of_object=0.2, of_pose=0.5, of_touch=0.5, num_poses=2, seed=0):
    """A PLDA model of three shapes, each component of which has this variance in every direction, about 1.4 apart."""
    rng = np.random.default_rng(seed)
    logits = 2.0 * np.eye(3) + 0.4 * rng.normal(size=(num_poses, 3, 3))
    embedding = LogitEmbedding(np.full(3, -99.0), np.full(3, 99.0))
    means = (logits - logits.mean(axis=2, keepdims=True)) @ helmert(3).T
    parts = (variance * np.eye(2) for variance in (of_object, of_pose, of_touch))
    return PLDAModel(LABELS, embedding, means, Components(*parts))


def collection(world, num_objects=240, rounds=3, seed=1, shapes=3):
    """Touches of objects in every pose, in rounds, with made-up features; the true shapes, and names of the objects."""
    rng = np.random.default_rng(seed)
    poses = np.tile(np.arange(world.num_poses), (1, rounds))
    touches, truth, names = [], [], []
    mixing = rng.normal(size=(3, 5))
    for i in range(num_objects):
        batch = world.sample_batch(i % shapes, poses, rng)
        for pose, logits in zip(batch.poses[0], batch.logits[0], strict=True):
            features = logits @ mixing + 0.1 * rng.normal(size=5)
            touches.append(Touch(int(pose), logits, features.astype(np.float32)))
        truth += [i % shapes] * poses.size
        names += [f"object {i}"] * poses.size
    return touches, np.array(truth), np.array(names)


@cache
def parts():
    """What the models are made of: collections of the world's touches, and tables."""
    world = plda_world()
    once = collection(world, rounds=1)
    data = collection(world)
    table = np.random.default_rng(2).dirichlet(np.ones(3), size=(2, 3))
    zeros = table.copy()
    zeros[0, 1, :2] = 0.0
    zeros /= zeros.sum(axis=2, keepdims=True)
    return SimpleNamespace(
        data=data,
        alone=[part[::2] for part in once],  # one touch of each object, in pose 0
        no_cones=collection(world, shapes=2),
        floored=ConfusionModel(LABELS, table, TemperatureScaling(1e-6, "separable", floor=0.05)),
        impossible=ConfusionModel(LABELS, zeros, TemperatureScaling(1.0, "ok")),
    )


def fit(kind, collected, **options):
    """A model of this kind fitted to touches, shapes and objects."""
    return kind.fit(*collected, shape_labels=LABELS, num_poses=2, **options)


MODELS = {
    "confusion": lambda: random_model(np.random.default_rng(1), num_shapes=3, num_poses=2),
    "confusion, floored calibration": lambda: parts().floored,
    "confusion, impossible outcomes": lambda: parts().impossible,
    "confusion, fitted": lambda: fit(ConfusionModel, parts().data),
    "gaussian": lambda: fit(GaussianModel, parts().data),
    "heavy tails": lambda: fit(HeavyTailsModel, parts().data),
    "heavy tails, one touch per object": lambda: fit(HeavyTailsModel, parts().alone),
    "plda": plda_world,
    "plda, scales of objects": lambda: fit(PLDAModel, parts().data, spread=0.5),
    "plda, fitted": lambda: fit(PLDAModel, parts().data),
    "plda, one touch per object": lambda: fit(PLDAModel, parts().alone),
    "plda, a shape never seen": lambda: fit(PLDAModel, parts().no_cones),
    "ratio": lambda: fit(RatioModel, parts().data),
    "ratio of a temperature": lambda: fit(RatioModel, parts().data, calibration=TemperatureScaling()),
    "ratio, a shape never seen": lambda: fit(RatioModel, parts().no_cones),
}
model_named = cache(lambda name: MODELS[name]())


@pytest.fixture(params=MODELS)
def any_model(request):
    """Each observation model in turn."""
    return model_named(request.param)


@pytest.fixture(params=[name for name in MODELS if not name.startswith(("plda", "gaussian", "heavy"))])
def summarising_model(request):
    """Each model whose evidence is of one size, however many the touches: not PLDA and its relatives."""
    return model_named(request.param)


@pytest.fixture
def all_models():
    """All of them at once."""
    return [model_named(name) for name in MODELS]


@pytest.fixture
def world():
    """The PLDA model that the fitted ones learnt from."""
    return plda_world()
