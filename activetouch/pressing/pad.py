"""The tactile pad: the positions of its taxels and the force law of its elastic layer.

The layer is a Winkler foundation of independent springs: a taxel indented by δ [m] carries the pressure k·δ [Pa]
(Johnson, *Contact Mechanics*, §4.3). In a press the pressures add up to the normal force. Decision 0003 compares this
with MuJoCo's soft contact.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Annotated

import numpy as np

from activetouch.solids.solid import Floats
from belief.constraints import NOT_NEGATIVE, Checked, NotNegative, Positive, Within, require_rule


@dataclass(frozen=True)
class Pad(Checked):
    """A flat square pad in the plane x = 0, facing +x, centred on the approach axis.

    Attributes:
        half_width: half the edge of the sensing face [m]; the paper's pad is 30 × 30 mm.
        half_thickness: half the thickness of the pad body [m].
        num_taxels: number of points along an edge; each is a taxel of the image unless the renderer bins them.
        stiffness: k of the elastic foundation [N/m³]; the default gives 1.5 mm under a 20 mm sphere at 2 N.
        max_depth: indentation at which the layer bottoms out, also the full scale of the image [m].
        contact_time: time constant of MuJoCo's soft contact [s]. It affects the motion, not the imprint.
        damping_ratio: of that contact; below 1 the object bounces.
    """

    half_width: Positive = 0.015
    half_thickness: Positive = 0.007
    num_taxels: Annotated[int, Within(1, 10_000)] = 128
    stiffness: Positive = 1.45e7
    max_depth: Positive = 0.003
    contact_time: Positive = 0.04
    damping_ratio: NotNegative = 1.0

    @property
    def taxel_area(self) -> float:
        """Area of one taxel [m²]."""
        return (2 * self.half_width / self.num_taxels) ** 2

    @cached_property
    def taxel_centres(self) -> Floats:
        """Centres in the pad frame, ``(3, num_taxels²)`` [m]; rows of the image run along z, columns along y."""
        edge = (np.arange(self.num_taxels) + 0.5) / self.num_taxels * 2 - 1
        z, y = np.meshgrid(edge * self.half_width, edge * self.half_width, indexing="ij")
        return np.stack([np.zeros(z.size), y.ravel(), z.ravel()])

    def indentation(self, gap: Floats, force: float) -> float:
        """Depth δ of the deepest taxel under a normal force, in ``[0, max_depth]`` [m].

        Solves F = k·A·∑ max(0, δ − gap). The sum is convex and piecewise linear in δ, so Newton's method from the right
        ends exactly at the root.

        Args:
            gap: distance of the surface behind the first point of contact, any array shape, ≥ 0, ``inf`` for taxels
                beside the object [m].
            force: normal force [N], ≥ 0.
        """
        require_rule("force", force, NOT_NEGATIVE)
        reached = gap.compress((gap < self.max_depth).ravel())  # in two thirds of the time of a mask
        if force == 0.0 or reached.size == 0:
            return 0.0
        load = force / (self.stiffness * self.taxel_area)  # ∑ max(0, δ − gap) that carries the force [m]
        if (self.max_depth - reached).sum() <= load:
            return self.max_depth
        depth = self.max_depth
        while True:
            loaded = reached[reached < depth]
            lower = (load + loaded.sum()) / loaded.size
            if lower >= depth:  # converged up to rounding
                return depth
            depth, reached = lower, loaded
