"""From a network in torch to a reader that needs no torch."""

from __future__ import annotations

import copy
import logging
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import torch
from numpy.typing import NDArray
from onnx import ModelProto, NodeProto, TensorProto, helper, numpy_helper
from torch import Tensor, nn

from activetouch.data.dataset import TouchSet
from activetouch.errors import TrainingDiverged
from activetouch.perception.classifier import TouchClassifier
from activetouch.perception.reader import INPUT, OUTPUTS, HypothesisEmbedding, TactileReader
from activetouch.poses import to_matrices

_FIXED = 2048
"""Hypotheses of each shape over which shape logits are averaged."""
_SMALL = 32  # arrays with fewer numbers keep their precision


def export_reader(
    classifier: TouchClassifier, image_shape: tuple[int, ...], hypotheses: HypothesisEmbedding | None = None
) -> TactileReader:
    """The reader of a network, with weights in half precision; ``hypotheses`` only where the card has an embedding."""
    classifier.card.require_images(image_shape)
    card = replace(classifier.card, image_shape=tuple(image_shape))
    # The exporter would take the size of a batch of one for a constant.
    example = torch.zeros((2, *image_shape), dtype=torch.uint8)
    graph = exported(classifier.network, (example,), ({0: "batch"},), (INPUT,), OUTPUTS)
    return TactileReader(card, graph, hypotheses)


def exported(
    network: nn.Module,
    examples: tuple[Tensor, ...],
    free: Sequence[Mapping[int, str]],
    inputs: Sequence[str],
    outputs: Sequence[str],
) -> bytes:
    """The ONNX graph of a network, with weights in half precision; ``free`` names each input's axes of any length."""
    network = copy.deepcopy(network).eval()
    network.load_state_dict({name: torch.from_numpy(value) for name, value in half_weights(network).items()})
    named = {name: torch.export.Dim(name) for axes in free for name in axes.values()}
    shapes = tuple({axis: named[name] for axis, name in axes.items()} for axes in free)
    with warnings.catch_warnings(), torch.inference_mode():
        warnings.simplefilter("ignore")
        logger = logging.getLogger("torch.onnx")
        level = logger.level
        logger.setLevel(logging.ERROR)  # it warns of packages that are not needed
        try:
            program = torch.onnx.export(
                network,
                examples,
                dynamo=True,
                dynamic_shapes=shapes,
                input_names=list(inputs),
                output_names=list(outputs),
                verbose=False,
            )
        finally:
            logger.setLevel(level)
    assert program is not None, "the exporter returns a program unless it writes a file"
    return _in_half_precision(program.model_proto)


def fixed_hypotheses(classifier: TouchClassifier, touches: TouchSet) -> HypothesisEmbedding:
    """The embedding of hypotheses of a trained network, with those of evenly spread training touches as fixed ones."""
    parts = [part.astype(np.float32) for part in half_weights(classifier.network.hypotheses).values()]
    layers = tuple(zip(parts[::2], parts[1::2], strict=True))  # weight and bias of each
    rows = np.linspace(0, len(touches.sizes) - 1, min(len(touches.sizes), _FIXED)).round().astype(int)
    rotations = to_matrices(touches.orientations[rows]).astype(np.float32)
    sizes = np.random.default_rng(0).permutation(touches.sizes)[: len(rows)].astype(np.float32)
    return HypothesisEmbedding(classifier.card, layers, rotations, sizes)


def _in_half_precision(model: ModelProto) -> bytes:
    """The bytes of a model with large arrays in half precision, the same for the same network: without source notes."""
    graph = model.graph
    casts: list[NodeProto] = []
    for tensor in graph.initializer:
        array = numpy_helper.to_array(tensor)
        half = array.astype(np.float16) if array.dtype == np.float32 and array.size >= _SMALL else None
        if half is None or not np.array_equal(half.astype(np.float32), array):
            continue  # a constant of the graph
        name = tensor.name
        casts.append(helper.make_node("Cast", [f"{name}.half"], [name], f"{name}.cast", to=TensorProto.FLOAT))
        tensor.CopyFrom(numpy_helper.from_array(half, f"{name}.half"))
    nodes = [*casts, *graph.node]
    for part in (model, graph, *nodes):
        part.ClearField("metadata_props")
        part.ClearField("doc_string")
    del graph.node[:], graph.value_info[:]
    graph.node.extend(nodes)
    return model.SerializeToString(deterministic=True)


def half_weights(network: nn.Module) -> dict[str, NDArray[np.float16]]:
    """The weights of a network by name, in half precision."""
    tensors = {name: value.half().numpy() for name, value in network.state_dict().items()}
    for name, value in tensors.items():
        if not np.isfinite(value).all():
            raise TrainingDiverged(
                f"the weights {name} are not finite in half precision. Train again, in another folder, with a lower "
                "--change.learning-rate"
            )
    return tensors
