"""Policies that see tactile images and no belief: what they observe, their encoder, and how they play a task.

python zoo.py images_tuned                     (trains one)
activetouch benchmark --task coarse-v1 --agent "process:python image_policy.py runs/zoo/images_tuned-0.zip"

A policy observes the last image of every pose, how often each pose was used, the time, and the target.
"""

import json
import sys
from collections.abc import Iterator
from typing import Any

import numpy as np
import onnx
import torch
from gymnasium import spaces
from numpy.typing import NDArray
from onnx import numpy_helper
from stable_baselines3.common.torch_layers import BaseFeaturesExtractor

from activetouch import TactileSensor
from activetouch.envs.batched_episodes import BankEpisodes
from activetouch.perception.classifier import TouchNetwork
from activetouch.perception.reader import HypothesisEmbedding, TactileReader

TOUCH_LIMIT, HYPOTHESES, LEAST = 12, 256, -8.0
"""Touches of one object at most; hypotheses of each shape; least logarithm of a share of a shape."""


def observed(images: NDArray[Any], uses: NDArray[Any], touches: NDArray[Any], is_target: NDArray[Any]) -> NDArray[Any]:
    """Images ``(B, P, H, W)`` in [0, 1], n/(n + 1) for the uses of each pose, time, and target: ``(B, S)``."""
    time = touches[:, None] / TOUCH_LIMIT
    return np.concatenate([images.reshape(len(images), -1), uses / (1.0 + uses), time, is_target], 1, dtype=np.float32)


class ImageEpisodes(BankEpisodes):
    """Tests of a bank whose touches had these ``images``, ``(N, R, P, H, W)`` in [0, 1]."""

    def __init__(self, images: NDArray[np.float32], *task: Any, **settings: Any) -> None:
        self._images, self._felt = images, np.zeros((task[3], *images.shape[2:]), np.float32)
        super().__init__(*task, **settings)

    def _touch(self, rows: NDArray[np.int64], poses: NDArray[np.int64]) -> None:
        rounds = (self._first_rounds[rows, poses] + self.uses[rows, poses]) % self.bank.num_rounds
        self._felt[rows, poses] = self._images[self.objects[rows], rounds, poses]
        super()._touch(rows, poses)

    def begin(self, rows: NDArray[np.int64], *given: Any) -> None:
        """See :meth:`BankEpisodes.begin`."""
        self._felt[rows] = 0.0
        super().begin(rows, *given)

    def observe(self) -> NDArray[np.float32]:
        """See :func:`observed`."""
        is_target = self.targets[:, None] == np.arange(self.log_probs.shape[1])
        return observed(self._felt, self.uses, self.num_touches, is_target)


class Encoder(BaseFeaturesExtractor):
    """Log shares of the shapes in the image of each pose, by the network of the shipped reader; 0 for unused poses.

    Args:
        space: of the observations.
        sensor: name of the shipped sensor.
        frozen: whether the network keeps the weights of the reader.
        new: whether it begins with random weights, and a linear layer, in place of hypotheses, tells the shapes.
    """

    def __init__(self, space: spaces.Box, sensor: str, frozen: bool = False, new: bool = False) -> None:
        shipped = TactileSensor.shipped(sensor)
        card, self.image_shape = shipped.reader.card, shipped.scene.image_shape
        self._poses, self._pixels, self._shapes = (
            len(shipped.pose_labels),
            int(np.prod(self.image_shape)),
            len(card.shape_labels),
        )
        super().__init__(space, space.shape[0] - self._poses * (self._pixels - self._shapes))
        self._reader, self._new = shipped.reader, new
        self.network = TouchNetwork(card)
        del self.network.hypotheses
        self.shapes = torch.nn.Linear(card.embedding, self._shapes * (1 if new else HYPOTHESES), bias=new)
        self.requires_grad_(not frozen)
        self.shapes.requires_grad_(new)

    def begin(self) -> None:
        """Take the weights of the reader, after a new policy of SB3 has made all weights random."""
        if not self._new:
            self.network.load_state_dict(reader_weights(self._reader.network))
            self.shapes.weight.copy_(torch.from_numpy(hypotheses(self._reader)))

    def forward(self, observations: torch.Tensor) -> torch.Tensor:
        """Codes of the poses, uses, time and target."""
        images, others = observations.tensor_split([self._poses * self._pixels], dim=1)
        used = others[:, : self._poses].reshape(-1) > 0.0
        codes = torch.zeros(len(used), self._shapes)
        if used.any():
            seen = self.network(255.0 * images.reshape(-1, *self.image_shape)[used])[0]
            scores = self.shapes(seen).reshape(len(seen), self._shapes, -1).logsumexp(dim=2)
            codes[used] = scores.log_softmax(dim=1).clamp(min=LEAST) / -LEAST
        return torch.cat([codes.reshape(len(observations), -1), others], dim=1)


def hypotheses(reader: TactileReader) -> NDArray[np.float32]:
    """Some of the reader's hypotheses of each shape, embedded, ``(K M, D)``."""
    known = reader.hypotheses
    assert isinstance(known, HypothesisEmbedding)
    rows = np.arange(HYPOTHESES)
    kinds = np.repeat(np.arange(len(reader.card.shape_labels)), HYPOTHESES)
    rotations, sizes = (
        np.concatenate([part[rows]] * len(reader.card.shape_labels)) for part in (known.rotations, known.sizes)
    )
    return known.embed(kinds, rotations, sizes)


def reader_weights(graph: bytes) -> dict[str, torch.Tensor]:
    """The weights in the ONNX graph of a reader, by name of the network in torch."""
    arrays = {tensor.name: numpy_helper.to_array(tensor) for tensor in onnx.load_from_string(graph).graph.initializer}
    return {
        name.removesuffix(".half"): torch.from_numpy(array.astype(np.float32))
        for name, array in arrays.items()
        if name.startswith(("backbone.", "head."))
    }


def answers(lines: Iterator[str], path: str) -> Iterator[dict[str, Any]]:
    """Answers of the policy in a file to the questions of `activetouch benchmark`."""
    from stable_baselines3 import PPO

    model, hello, felt = PPO.load(path, device="cpu"), {}, {}
    for asked in map(json.loads, lines):
        if asked["do"] == "hello":
            hello = asked
            yield {"ok": True}
            continue
        shapes, poses, made = hello["shapes"], hello["poses"], asked["touches"]
        if not made:  # a new object of this search
            felt[asked["episode"]] = np.zeros((len(poses), *model.policy.features_extractor.image_shape), np.float32)
        else:
            felt[asked["episode"]][poses.index(made[-1])] = np.asarray(asked["image"]) / np.float32(255.0)
        uses = np.array([[made.count(pose) for pose in poses]])
        is_target = np.array([[shape == asked["target"] for shape in shapes]])
        seen = observed(felt[asked["episode"]][None], uses, np.array([len(made)]), is_target)
        yield {"action": int(model.predict(seen, deterministic=True)[0][0])}


if __name__ == "__main__":
    torch.set_num_threads(1)
    for answer in answers(sys.stdin, sys.argv[1]):
        print(json.dumps(answer), flush=True)
