"""How the taxels of a described pad answer to pressure: ranges of what is not known, and one answer among them.

The pressure on a taxel becomes a reading in this order: neighbours share it (blur), all taxels leak into each other
(crosstalk), it is amplified and clipped to full scale, or divided by the largest of the touch; it is raised to a power
(law), noise is added, and what is below the threshold reads zero.

>>> import numpy as np
>>> felt = TaxelResponse(Taxels.grid(1, 3, 0.003), law=2.0, threshold=0.1, is_relative=True)
>>> felt.readings(np.array([0.1, 0.2, 0.4]), np.random.default_rng(0)).round(3).tolist()
[0.0, 0.25, 1.0]
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import Annotated, Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from activetouch.distributions import (
    Constant,
    Distribution,
    LogUniform,
    Uniform,
    kronecker,
    require_support,
    roberts_steps,
)
from activetouch.pressing.contact import Contact
from activetouch.pressing.taxels import Taxels
from activetouch.solids.triangles import Floats
from belief.constraints import Checked, NotNegative, Positive, Probability, Within
from belief.errors import InvalidArgument
from belief.validation import are_finite

_LOGARITHMIC = ("stiffness", "gain")
_LIMITS = {
    "stiffness": (1e5, 1e12),
    "law": (0.2, 5.0),
    "threshold": (0.0, 0.9),
    "blur": (0.0, 3.0),
    "crosstalk": (0.0, 1.0),
    "gain": (0.01, 100.0),
    "noise": (0.0, 0.5),
}
_UNITS = {"stiffness": " N/m³", "blur": " pitches"}
_REACH = 4.0  # standard deviations at which a blur ends
_SATURATED = 9.9  # of full scale: larger readings are refused as of another unit


@dataclass(frozen=True)
class Response:
    """What is not known of a pad, as distributions; by default, what holds for most pads of foam or rubber.

    Attributes:
        stiffness: of the elastic layer [N/m³]: its modulus of elasticity divided by its thickness. The default is of
            layers of 1 to 4 mm with 0.05 to 1 MPa.
        law: power to which a reading raises the pressure.
        threshold: reading below which a taxel reads zero, relative to full scale.
        blur: standard deviation with which a taxel reads its neighbours [pitches].
        crosstalk: part of the mean of all taxels that adds to each.
        gain: factor on all pressures.
        noise: standard deviation, relative to full scale.

    Raises:
        InvalidArgument: one of them is no distribution, or goes beyond what is simulated.

    >>> Response(law=Constant(1.0)).ranges()["law"]
    (1.0, 1.0)
    """

    stiffness: Distribution = field(default_factory=lambda: LogUniform(1.25e7, 1e9))
    law: Distribution = field(default_factory=lambda: Uniform(0.5, 2.5))
    threshold: Distribution = field(default_factory=lambda: Uniform(0.0, 0.25))
    blur: Distribution = field(default_factory=lambda: Uniform(0.0, 0.7))
    crosstalk: Distribution = field(default_factory=lambda: Uniform(0.0, 0.05))
    gain: Distribution = field(default_factory=lambda: LogUniform(0.5, 2.0))
    noise: Distribution = field(default_factory=lambda: Uniform(0.0, 0.02))

    def __post_init__(self) -> None:
        for part in fields(self):
            require_support(part.name, getattr(self, part.name), *_LIMITS[part.name], _UNITS.get(part.name, ""))

    @classmethod
    def of(cls, ranges: Mapping[str, Any]) -> Response:
        """From the least and largest value of each number by name, or one value where it is known.

        Stiffness and gain are log-uniform, the others uniform.

        Raises:
            InvalidArgument: an unknown name, or something that is no range.

        >>> Response.of({"law": 1.0, "stiffness": [1e7, 1e8]}).stiffness
        LogUniform(low=10000000.0, high=100000000.0)
        """
        found: dict[str, Distribution] = {}
        for name, given in ranges.items():
            if name not in _LIMITS:
                raise InvalidArgument(f"a response has no {name!r}, only {', '.join(_LIMITS)}")
            ends = list(given) if isinstance(given, list | tuple) else [given, given]
            is_range = len(ends) == 2 and all(
                isinstance(end, int | float) and not isinstance(end, bool) for end in ends
            )
            if not is_range or not are_finite(*ends):
                raise InvalidArgument(f"{name} must be a number or a range [low, high], got {given!r:.80}")
            low, high = map(float, ends)
            try:
                kind = LogUniform if name in _LOGARITHMIC else Uniform
                found[name] = Constant(low) if low == high else kind(low, high)
            except ValueError as error:
                raise InvalidArgument(f"{name}: {error}") from error
        return cls(**found)

    def ranges(self) -> dict[str, tuple[float, float]]:
        """Least and largest value of each number, as :meth:`of` takes them."""
        return {part.name: getattr(self, part.name).support for part in fields(self)}

    def at(self, shares: Floats) -> dict[str, Floats]:
        """The responses at shares of the ranges, ``(n, 7)`` in [0, 1], as arrays ``(n,)`` by name.

        >>> {name: round(float(one[0]), 3) for name, one in Response().at(np.full((1, 7), 0.5)).items()}["law"]
        1.5
        """
        found = {}
        for (name, (low, high)), share in zip(self.ranges().items(), np.asarray(shares, float).T, strict=True):
            is_log = name in _LOGARITHMIC and low > 0.0
            found[name] = low * (high / low) ** share if is_log else low + (high - low) * share
        return found

    def spread(self, number: int) -> dict[str, Floats]:
        """Responses that cover the ranges evenly; the first is the middle of all."""
        return self.at(np.stack([kronecker(step, number) for step in roberts_steps(len(_LIMITS))], axis=1))

    def drawn(self, number: int, rng: np.random.Generator) -> dict[str, Floats]:
        """Random responses, as :meth:`at` gives them."""
        return self.at(rng.uniform(size=(number, len(_LIMITS))))


@dataclass(frozen=True)
class TaxelRenderer(Checked):
    """The mean pressure on each taxel of a described pad, along its normal, on a raster in millimetres.

    Attributes:
        full_scale: pressure that is 1 in the image [Pa].
    """

    isotropic: ClassVar[bool] = False

    full_scale: Positive = 1e5

    def __call__(self, contact: Contact) -> Floats:
        """The image ``(m, m)``, 0 beside the taxels; m is ``pad.layout.raster``."""
        taxels = contact.pad.layout
        if taxels is None:
            raise InvalidArgument("TaxelRenderer shows the taxels of a pad with a layout, such as Pad.described(…)")
        felt = taxels.mean(contact.pressure) * taxels.normals[:, 0] / self.full_scale
        return np.asarray(taxels.shown(np.minimum(felt, _SATURATED)))


@dataclass(frozen=True)
class TaxelResponse(Checked):
    """One response of a pad's taxels, as a fault of a scene (:class:`activetouch.rendering.Fault`).

    Attributes:
        taxels: that the image shows.
        law, threshold, blur, crosstalk, gain, noise: see :class:`Response`.
        is_relative: whether readings are parts of the largest one of the touch, as of a sensor in unknown units.
        dead: numbers of taxels that read nothing.
    """

    isotropic: ClassVar[bool] = False

    taxels: Taxels
    law: Annotated[float, Within(*_LIMITS["law"])] = 1.0
    threshold: Annotated[float, Within(*_LIMITS["threshold"])] = 0.0
    blur: Annotated[float, Within(*_LIMITS["blur"])] = 0.0
    crosstalk: Probability = 0.0
    gain: Positive = 1.0
    noise: NotNegative = 0.0
    is_relative: bool = False
    dead: tuple[int, ...] = ()

    def __call__(self, image: NDArray[np.floating], rng: np.random.Generator) -> NDArray[np.floating]:
        """See :class:`activetouch.rendering.Fault`."""
        return self.taxels.shown(self.readings(self.taxels.mean(image), rng), image.shape[0]).astype(image.dtype)

    def readings(self, pressures: NDArray[np.floating], rng: np.random.Generator) -> NDArray[np.floating]:
        """Readings of the N taxels for their pressures ``(N,)``, relative to full scale."""
        numbers = {name: np.array([getattr(self, name)]) for name in _LIMITS if name != "stiffness"}
        return respond(self.taxels, pressures[None], numbers, rng, self.is_relative, self.dead)[0]


def respond(
    taxels: Taxels,
    pressures: NDArray[np.floating],
    numbers: Mapping[str, NDArray[np.floating]],
    rng: np.random.Generator,
    is_relative: bool,
    dead: tuple[int, ...] = (),
) -> NDArray[np.floating]:
    """Readings ``(n, N)`` of pressures ``(n, N)``, relative to full scale; each number of the response is ``(n,)``."""
    felt = pressures
    law, threshold, blur, crosstalk, gain, noise = (
        numbers[name][:, None].astype(felt.dtype) for name in _LIMITS if name != "stiffness"
    )
    felt = felt.copy()
    for std in np.unique(blur[blur > 0.0]).tolist():
        rows = np.flatnonzero(blur == std)
        felt[rows] = (_mixing(taxels, std) @ felt[rows].T).T
    felt += crosstalk * felt.mean(axis=1, keepdims=True)
    is_hit = felt.max(axis=1, keepdims=True) > 0.0
    if is_relative:
        felt /= np.where(is_hit, felt.max(axis=1, keepdims=True), 1.0)
    else:
        felt = np.minimum(gain * felt, 1.0)
    felt = felt**law + noise * rng.standard_normal(felt.shape, dtype=np.float32)
    felt = np.where(felt > threshold, np.clip(felt, 0.0, 1.0), 0.0).astype(felt.dtype)
    felt[:, list(dead)] = 0.0
    if is_relative:
        felt *= is_hit
        felt /= np.where((largest := felt.max(axis=1, keepdims=True)) > 0.0, largest, 1.0)
    return felt


@lru_cache(maxsize=256)
def _mixing(taxels: Taxels, std: float) -> Any:
    """The matrix that gives each taxel the mean of its neighbours, weighted by a Gaussian, sparse ``(N, N)``."""
    from scipy.sparse import csr_array
    from scipy.spatial import cKDTree

    tree = cKDTree(taxels.centres / (std * taxels.pitch))
    near = tree.sparse_distance_matrix(tree, _REACH, output_type="coo_matrix")
    weights = csr_array((np.exp(-0.5 * near.data**2), (near.row, near.col)), shape=near.shape)
    return csr_array(weights.multiply(1.0 / weights.sum(axis=1)[:, None]))
