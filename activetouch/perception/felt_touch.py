"""Touches whose logits nobody may ask for."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from activetouch.perception.hypothesis_embedding import Floats32, HypothesisEmbedding
from belief import Touch
from belief.frozen import frozen


class FeltTouch(Touch):
    """A touch of a reader that embeds hypotheses: its logits are computed when they are first asked for.

    A belief about one rigid body reads the embedding alone, and the logits need the embeddings of thousands of
    hypotheses. A copy in another process, or on disk, is a plain :class:`Touch`.

    Args:
        pose: index of the exploration pose.
        embedding: of the image, ``(D,)``.
        hypotheses: over which the logits are averaged.
    """

    features: Floats32
    _hypotheses: HypothesisEmbedding

    def __init__(self, pose: int, embedding: Floats32, hypotheses: HypothesisEmbedding) -> None:
        vars(self).update(pose=pose, features=frozen(embedding), _hypotheses=hypotheses)

    @property
    def num_shapes(self) -> int:
        """K."""
        return len(self._hypotheses.card.shape_labels)

    def __getattr__(self, name: str) -> NDArray[np.float64]:
        if name != "logits":
            raise AttributeError(name)
        logits = frozen(self._hypotheses.shape_logits(self.features[None])[0])
        vars(self)["logits"] = logits
        return logits

    def __reduce__(self) -> tuple[Any, ...]:
        return Touch, (self.pose, self.logits, self.features)
