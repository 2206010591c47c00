"""ConvNeXt as a feature extractor, from ``transformers``, with depthwise convolutions that train faster on a CPU.

The weight gradient of a depthwise convolution is where a CPU spends a third of ConvNeXt's training: the library
routine takes 2 to 12 times as long as the matrix products below, to the same rounding error (decision 0014).
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

import torch
from safetensors import SafetensorError
from torch import Tensor, nn
from torch.nn.functional import conv2d, pad
from transformers import ConvNextConfig, ConvNextModel

from activetouch.errors import MissingWeights


class ConvNeXtFeatures(ConvNextModel):
    """Pooled, normalised features ``(B, widths[-1])`` of images ``(B, channels, H, W)``."""

    def __init__(self, depths: tuple[int, ...], widths: tuple[int, ...], channels: int) -> None:
        stages, hidden = list(depths), list(widths)
        super().__init__(
            ConvNextConfig(num_channels=channels, num_stages=len(stages), depths=stages, hidden_sizes=hidden)
        )
        for module in self.modules():
            convolution = getattr(module, "dwconv", None)
            if isinstance(convolution, nn.Conv2d):
                module.dwconv = DepthwiseConvolution(convolution)

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


class DepthwiseConvolution(nn.Module):
    """The same function and parameters as a depthwise ``nn.Conv2d`` of odd size, with a faster weight gradient."""

    def __init__(self, convolution: nn.Conv2d) -> None:
        super().__init__()
        assert convolution.bias is not None, "the depthwise convolutions of a ConvNeXt have one"
        self.weight, self.bias = convolution.weight, convolution.bias

    def forward(self, images: Tensor) -> Tensor:
        """Images ``(B, C, H, W)`` to the same size."""
        weight, bias = self.weight, self.bias
        if torch.is_autocast_enabled("cpu"):
            dtype = torch.get_autocast_dtype("cpu")
            images, weight, bias = images.to(dtype), weight.to(dtype), bias.to(dtype)
        if not torch.is_grad_enabled():
            return conv2d(images, weight, bias, padding=weight.shape[-1] // 2, groups=len(weight))
        return _Depthwise.apply(images, weight, bias)


class _Depthwise(torch.autograd.Function):
    @staticmethod
    def forward(ctx: Any, images: Tensor, weight: Tensor, bias: Tensor) -> Tensor:
        ctx.save_for_backward(images, weight)
        return conv2d(images, weight, bias, padding=weight.shape[-1] // 2, groups=len(weight))

    @staticmethod
    def backward(ctx: Any, gradient: Tensor) -> tuple[Tensor | None, Tensor, Tensor]:
        images, weight = ctx.saved_tensors
        size, channels = weight.shape[-1], len(weight)
        gradient = gradient.contiguous(memory_format=torch.channels_last)
        of_images, _, of_bias = torch.ops.aten.convolution_backward(
            gradient, images, weight, [channels], [1, 1], [size // 2] * 2, [1, 1], False, [0, 0], channels,
            [ctx.needs_input_grad[0], False, True],
        )  # fmt: skip
        return of_images, _weight_gradient(images, gradient, size).to(weight.dtype), of_bias


def _weight_gradient(images: Tensor, gradient: Tensor, size: int) -> Tensor:
    """Gradient ``(C, 1, size, size)`` of a depthwise convolution's weights.

    For every vertical offset, one matrix product per channel correlates all columns of the images with all columns of
    the gradient, ``(W, W)``; the weight at a horizontal offset is the sum of a diagonal of that.
    """
    batch, channels, height, width = images.shape
    reach = size // 2
    rows = pad(images, (0, 0, reach, reach)).permute(1, 2, 0, 3).contiguous()  # (C, H + 2 reach, B, W)
    columns = gradient.permute(1, 3, 2, 0).reshape(channels, width, height * batch)
    products = torch.stack(
        [columns @ rows[:, dy : dy + height].reshape(channels, height * batch, width) for dy in range(size)], dim=1
    )  # (C, size, W of the gradient, W of the image)
    padded = pad(products.float(), (reach, reach))
    channel, row, line, column = padded.stride()
    diagonals = padded.as_strided((channels, size, width, size), (channel, row, line + column, column))
    return diagonals.sum(dim=2).unsqueeze(1)
