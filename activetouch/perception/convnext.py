"""ConvNeXt as a feature extractor, from ``transformers``."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from safetensors import SafetensorError
from torch import Tensor
from transformers.models.convnext import ConvNextConfig, ConvNextModel

from activetouch.errors import MissingWeights

IMAGENET = "facebook/convnext-tiny-224"
"""ConvNeXt-Tiny of ImageNet-1K on the Hugging Face hub."""


class ConvNeXtFeatures(ConvNextModel):
    """Pooled, normalised features ``(B, widths[-1])`` of images ``(B, channels, H, W)``."""

    def __init__(self, depths: tuple[int, ...], widths: tuple[int, ...], channels: int) -> None:
        stages, hidden = list(depths), list(widths)
        super().__init__(
            ConvNextConfig(num_channels=channels, num_stages=len(stages), depths=stages, hidden_sizes=hidden)
        )

    def forward(self, images: Tensor) -> Tensor:
        """See the class."""
        return super().forward(images).pooler_output

    def load_published(self, weights: str) -> str:
        """Take the weights of a published ConvNeXt: "imagenet", or a folder; returns what they are, in words.

        A network for grey images takes the sum of the first layer's weights over the colours, so that it sees a grey
        image as the published one sees three equal colours. Only "imagenet" goes online.
        """
        is_hub, here = weights == "imagenet", Path(weights)
        if not is_hub and not (here / "config.json").is_file():
            raise MissingWeights(
                f"--weights {weights}: {'it has no config.json' if here.is_dir() else 'there is no such folder'}. Give "
                "imagenet, or a folder with config.json and model.safetensors of a ConvNeXt"
            )
        source = IMAGENET if is_hub else str(here)
        try:
            loaded: Any = ConvNextModel.from_pretrained(source, local_files_only=not is_hub, output_loading_info=True)
        except (OSError, SafetensorError, ValueError, RuntimeError) as error:
            where = "the Hugging Face hub cannot be reached, or HF_HUB_OFFLINE is set, and this machine has no copy"
            reason = where if is_hub else " ".join(str(error).split())
            raise MissingWeights(
                f"--weights {weights}: no weights of {source} ({reason}). Download config.json and model.safetensors "
                f"of {IMAGENET} into a folder elsewhere, and give --weights FOLDER; or leave --weights out"
            ) from error
        published, report = loaded
        mine, theirs = ((c.depths, c.hidden_sizes, c.patch_size) for c in (self.config, published.config))
        if mine != theirs or published.config.num_channels != 3 or report["missing_keys"]:
            raise MissingWeights(
                f"--weights {weights}: {source} has depths, widths and patches {theirs} and lacks "
                f"{len(report['missing_keys'])} arrays; the network is of {mine}, and reads three colours"
            )
        tensors = published.state_dict()
        if self.config.num_channels == 1:
            first = "embeddings.patch_embeddings.weight"
            tensors[first] = tensors[first].sum(dim=1, keepdim=True)
        self.load_state_dict(tensors)
        return f"the ImageNet-1K weights of {IMAGENET}" if is_hub else f"the weights in {here}"
