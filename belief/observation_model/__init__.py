"""From touches to likelihoods: p(touch | shape, pose), estimated on touches of objects the classifier never saw.

A classifier's softmax is a *posterior* under its training set, and over-confident; multiplying such outputs counts the
prior once per touch. An observation model turns touches into a likelihood instead. The likelihood takes all touches of
one object at once, so that a model may discount touches that repeat each other.

To add a model, derive from :class:`ArrayModel`, and enter it in
:data:`belief.observation_model.registry.OBSERVATION_MODELS`.
"""

from belief.observation_model.baselines.confusion import ConfusionModel
from belief.observation_model.baselines.embedding import FeatureEmbedding, LogitEmbedding
from belief.observation_model.baselines.gaussian import GaussianModel
from belief.observation_model.baselines.plda import PLDAModel
from belief.observation_model.baselines.signature import SignatureModel
from belief.observation_model.check import check_observation_model
from belief.observation_model.likelihood_ratio import RatioModel
from belief.observation_model.model import ArrayModel, ObservationModel
from belief.observation_model.outcome_table import OutcomeTable
from belief.observation_model.quantisation import information_of_touch
from belief.observation_model.serialisation import read_observation_model, read_origin

__all__ = [
    "ArrayModel",
    "ConfusionModel",
    "FeatureEmbedding",
    "GaussianModel",
    "LogitEmbedding",
    "ObservationModel",
    "OutcomeTable",
    "PLDAModel",
    "RatioModel",
    "SignatureModel",
    "check_observation_model",
    "information_of_touch",
    "read_observation_model",
    "read_origin",
]
