import os
import sys
from collections import Counter
from functools import cache, wraps
from hashlib import sha256
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest
from hypothesis import HealthCheck, settings

from belief.observation_model import ConfusionModel, FixedHypotheses, RigidBodyModel
from belief.synthetic import random_model
from tests.small_pictures import small_pictures

os.environ["HF_HUB_OFFLINE"] = "1"  # before transformers is imported

# Seeds are fixed so that a failure is a finding, not weather; the machine's speed must not fail a test.
settings.register_profile(
    "default", derandomize=True, max_examples=25, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("default")


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Files with slow tests and then large ones come first: no worker is left with one while others have finished."""
    slow = Counter(item.path for item in items if item.get_closest_marker("slow"))
    size = {path: path.stat().st_size for path in {item.path for item in items}}
    items.sort(key=lambda item: (-slow[item.path], -size[item.path]))


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


@pytest.fixture(scope="session", autouse=True)
def _shipped_sensors_loaded_once():
    """Sensors that come with the package are loaded once for all tests, and compute once what they keep."""
    if "activetouch.sensor.tactile" not in sys.modules:  # no test of this run has one
        yield
        return
    from activetouch import TactileSensor, sensor_files
    from activetouch.perception.reader import HypothesisEmbedding, TactileReader

    read, fit, make = TactileReader.load, sensor_files.fitted_model, TactileSensor._model
    read_once, fit_once, shipped, made = cache(read), cache(fit), [], []
    embed, embedded = HypothesisEmbedding._of_every_shape, {}

    @wraps(embed)
    def embed_or_share(network, rotations, sizes):
        """Scenes that differ in forces or faults have the same hypotheses."""
        key = id(network), sha256(rotations.tobytes() + sizes.tobytes()).digest()
        if key in embedded:
            return embedded[key][1]
        found = embed(network, rotations, sizes)
        if found.nbytes <= 2**22:
            found.flags.writeable = False
            embedded[key] = network, found  # both are kept, so that no other network gets its id
            if len(embedded) > 48:
                del embedded[next(iter(embedded))]
        return found

    def is_shipped(path):
        return sensor_files.MODELS in Path(path).parents

    @wraps(fit)  # so that the code of a run is not that of the tests
    def fit_or_share(folder, independent=False):
        if not is_shipped(folder):
            return fit(folder, independent)
        shipped.append(fit_once(folder, independent).model)
        return fit_once(folder, independent)

    def make_or_share(reader, scene, fitted, unknown_state):
        is_known = fitted is not None and not unknown_state and reader.card.imaging is None
        if not is_known or not any(model is fitted.model for model in shipped):
            return make(reader, scene, fitted, unknown_state)
        for model, hypotheses, of_scene, found in made:
            if model is fitted.model and hypotheses is reader.hypotheses and of_scene == scene:
                return found
        made.append((fitted.model, reader.hypotheses, scene, make(reader, scene, fitted, unknown_state)))
        return made[-1][-1]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(TactileReader, "load", staticmethod(lambda path: (read_once if is_shipped(path) else read)(path)))
        patch.setattr(sensor_files, "fitted_model", fit_or_share)
        patch.setattr(TactileSensor, "_model", staticmethod(make_or_share))
        patch.setattr(HypothesisEmbedding, "_of_every_shape", embed_or_share)
        yield


@pytest.fixture(scope="session", autouse=True)
def _operators_of_the_exporter_read_once():
    """The exporter to ONNX parses the source of 500 operators at every call, which is most of its time."""
    if "torch" not in sys.modules:
        yield
        return
    import torch

    export = torch.onnx.export

    def with_kept_operators(*arguments, **options):
        registry = import_module("torch.onnx._internal.exporter._registration").ONNXRegistry
        if registry not in seen:
            seen.append(registry)
            patch.setattr(registry, "from_torchlib", staticmethod(cache(registry.from_torchlib)))
        return export(*arguments, **options)

    seen = []
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(torch.onnx, "export", with_kept_operators)
        yield


USUAL_PICTURES = []


@pytest.fixture(scope="session", autouse=True)
def _small_pictures():
    """See :mod:`tests.small_pictures`."""
    if "experiments.search.comparison" not in sys.modules:  # no test of this run writes one
        yield
        return
    small = small_pictures()
    USUAL_PICTURES.extend((module, name, getattr(module, name)) for module, name, _ in small)
    with pytest.MonkeyPatch.context() as patch:
        for module, name, value in small:
            patch.setattr(module, name, value)
        yield


@pytest.fixture(scope="module")
def usual_pictures():
    """Reports have the pictures of users, where a test is about them."""
    with pytest.MonkeyPatch.context() as patch:
        for part in USUAL_PICTURES:
            patch.setattr(*part)
        yield


@pytest.fixture
def few_hypotheses(monkeypatch):
    """Sensors of any object are prepared with few contacts and touches: what is run counts, not how well it reads."""
    from activetouch.perception import described_pads, preparation, proportions, sensor_worlds
    from activetouch.perception.contacts import hypotheses

    for module, name, number in (
        (described_pads, "PADS", 6),
        (proportions, "_HYPOTHESES", 64),
        (sensor_worlds, "_SIMULATED", 1024),
        (hypotheses, "FEWEST", 64),
        (hypotheses, "MOST", 64),
        (preparation, "_TOUCHES", 10),
    ):
        monkeypatch.setattr(module, name, number)
    made = sensor_worlds.EmbeddedWorlds.__init__
    monkeypatch.setattr(made, "__defaults__", (64, *made.__defaults__[1:]))
