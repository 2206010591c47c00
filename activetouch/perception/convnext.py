"""ConvNeXt as a feature extractor, from ``transformers``."""

from __future__ import annotations

from pathlib import Path

from safetensors import SafetensorError
from torch import Tensor
from transformers import ConvNextConfig, ConvNextModel

from activetouch.errors import MissingWeights


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


def pretrained(source: Path | str, depths: tuple[int, ...], widths: tuple[int, ...], channels: int) -> ConvNeXtFeatures:
    """Features with the weights of a published ConvNeXt, in the format of ``transformers``.

    A network for grey images takes the sum of the first layer's weights over the colours, which is what a grey image
    shown in three equal colours would meet.

    Args:
        source: a folder with ``config.json`` and ``model.safetensors``, or a name on the hub such as
            ``facebook/convnext-tiny-224``; only a name is looked for on the network.
        depths: blocks of each stage.
        widths: channels of each stage.
        channels: of the images: 1 or 3.

    Raises:
        MissingWeights: they are not to be had, or belong to another network.
    """
    local = Path(source).is_dir()
    if isinstance(source, Path) and not local:
        raise MissingWeights(f"there is no folder {source}; name one that holds config.json and model.safetensors")
    try:
        published = ConvNextModel.from_pretrained(str(source), local_files_only=local, use_safetensors=True)
    except (OSError, SafetensorError, ValueError, RuntimeError) as error:
        where = "in this folder" if local else "on the Hugging Face hub, as far as this machine can reach it"
        raise MissingWeights(
            f"no usable ConvNeXt weights {where}: {source} ({error}). Download config.json and model.safetensors of "
            "a ConvNeXt into a folder and name that folder, or train from scratch."
        ) from error
    found = (tuple(published.config.depths or ()), tuple(published.config.hidden_sizes or ()))
    if found != (depths, widths):
        raise MissingWeights(f"{source} holds a ConvNeXt of depths and widths {found}, not {(depths, widths)}")
    weights = published.state_dict()
    first = "embeddings.patch_embeddings.weight"
    if channels == 1:
        weights[first] = weights[first].sum(dim=1, keepdim=True)
    network = ConvNeXtFeatures(depths, widths, channels)
    network.load_state_dict(weights)
    return network
