"""A plain convolutional network, as a reference for what the ConvNeXts buy."""

from __future__ import annotations

from torch import Tensor, nn


class _MeanOverImage(nn.Module):
    def forward(self, images: Tensor) -> Tensor:
        return images.mean(dim=(2, 3))


def small_cnn(widths: tuple[int, ...], channels: int, cells: int = 1) -> nn.Sequential:
    """Convolutions 3 × 3 of stride 2 and ReLU, then the mean over the image.

    With more than one cell along the edge, the means over all cells, joined by a dense layer and ReLU.

    Nothing is normalised: statistics over a batch differ too much between batches of small spots on an empty pad, and
    those over an image would hide how strong the contact is.
    """
    layers: list[nn.Module] = []
    for width_in, width_out in zip((channels, *widths), widths, strict=False):
        convolution = nn.Conv2d(width_in, width_out, kernel_size=3, stride=2, padding=1)
        nn.init.kaiming_normal_(convolution.weight, nonlinearity="relu")
        assert convolution.bias is not None, "a convolution has one unless told otherwise"
        nn.init.zeros_(convolution.bias)
        layers += [convolution, nn.ReLU()]
    if cells == 1:
        return nn.Sequential(*layers, _MeanOverImage())
    joined = nn.Linear(cells**2 * widths[-1], widths[-1])
    return nn.Sequential(*layers, nn.AdaptiveAvgPool2d(cells), nn.Flatten(), joined, nn.ReLU())
