"""The pad, its contact with a body, and the simplest press.

The elastic layer of the pad is a Winkler foundation of independent springs: a taxel indented by δ [m] carries the
pressure k·δ [Pa] (Johnson, *Contact Mechanics*, §4.3). In a press the pressures add up to the normal force. Decision
0003 compares this with MuJoCo's soft contact.

``Quasistatic`` does not simulate time. ``Dynamic`` and ``GuardedMove`` (:mod:`activetouch.pressing.dynamic`), the
paper's cycle, simulate the motion in MuJoCo. All compute the imprint by one force law (:func:`elastic_contact`).
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, field
from enum import StrEnum
from functools import cached_property
from typing import TYPE_CHECKING, Annotated, ClassVar, NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray

from activetouch.poses import Placement, to_matrix
from activetouch.solids.raster import foremost
from activetouch.solids.solid import Floats, Shape
from activetouch.solids.triangles import grid_centres
from belief.constraints import NOT_NEGATIVE, Checked, NotNegative, Within, require_rule
from belief.errors import InvalidArgument

if TYPE_CHECKING:
    import mujoco

_FEWEST_POINTS = 32  # along the edge of the square of a layout


class Layout(Protocol):
    """Where the taxels of a pad are (:class:`activetouch.Taxels`)."""

    @property
    def normals(self) -> Floats:
        """Unit vectors in which the N taxels feel, ``(N, 3)``."""

    @property
    def half_width(self) -> float:
        """Half the edge of the square about the approach axis that has the pad inside [m]."""

    @property
    def raster(self) -> int:
        """Pixels along the edge of that square in an image."""

    def face(self, pixels: int) -> Floats:
        """How far the layer reaches along x over the pixels of the square [m]; ``-inf`` beside the pad."""

    def mean(self, maps: NDArray[np.floating]) -> NDArray[np.floating]:
        """Means of maps over the square ``(..., m, m)`` over the part of each of the N taxels, ``(..., N)``."""

    def shown(self, values: NDArray[np.floating], pixels: int | None = None) -> NDArray[np.floating]:
        """Values of the taxels ``(..., N)`` as images ``(..., m, m)`` of the square."""


@dataclass(frozen=True)
class Pad(Checked):
    """A pad that faces +x, centred on the approach axis: a flat square in the plane x = 0, unless a layout says else.

    Attributes:
        half_width: half the edge of the sensing face, or of the square about a layout [m]; the paper's pad is 30 × 30
            mm.
        half_thickness: half the thickness of the pad body [m].
        num_taxels: number of points along an edge; each is a taxel of the image unless the renderer bins them.
        stiffness: k of the elastic foundation [N/m³]; the default gives 1.5 mm under a 20 mm sphere at 2 N.
        max_depth: indentation at which the layer bottoms out, also the full scale of the image [m].
        contact_time: time constant of MuJoCo's soft contact [s]. It affects the motion, not the imprint.
        damping_ratio: of that contact; below 1 the object bounces.
        layout: where the taxels of a described pad are (:meth:`described`); the layer ends with them. None for the
            square, whose points are its taxels.
    """

    half_width: Annotated[float, Within(1e-5, 1.0, unit=" m")] = 0.015
    half_thickness: Annotated[float, Within(1e-5, 1.0, unit=" m")] = 0.007
    num_taxels: Annotated[int, Within(1, 10_000)] = 128
    stiffness: Annotated[float, Within(1e5, 1e12, unit=" N/m³")] = 1.45e7
    max_depth: Annotated[float, Within(1e-6, 0.1, unit=" m")] = 0.003
    contact_time: Annotated[float, Within(1e-5, 10.0, unit=" s")] = 0.04
    damping_ratio: NotNegative = 1.0
    layout: Layout | None = field(default=None, metadata={"is_optional": True})

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.layout is not None and not hasattr(self.layout, "half_width"):
            raise InvalidArgument(f"the layout of a pad must be Taxels, got {self.layout!r:.80}")

    @classmethod
    def described(cls, layout: Layout, stiffness: float = 1.45e7, max_depth: float = 0.003) -> Pad:
        """The pad of a layout, on a square of at least 32 × 32 points, of which each taxel has some.

        >>> from activetouch import Taxels
        >>> Pad.described(Taxels.grid(14, 6, 0.0034)).num_taxels
        42
        """
        points = -(-_FEWEST_POINTS // layout.raster) * layout.raster
        return cls(layout.half_width, num_taxels=points, stiffness=stiffness, max_depth=max_depth, layout=layout)

    @cached_property
    def face(self) -> Floats | None:
        """How far a layout reaches along x over each point, ``(num_taxels, num_taxels)`` [m]; None for the square.

        It is ``-inf`` beside the layout.
        """
        return None if self.layout is None else self.layout.face(self.num_taxels)

    @property
    def taxel_area(self) -> float:
        """Area of one point [m²]."""
        return (2 * self.half_width / self.num_taxels) ** 2

    @cached_property
    def taxel_centres(self) -> Floats:
        """Centres of the points in the pad frame, ``(3, num_taxels²)`` [m]; rows run along z, columns along y."""
        return grid_centres(self.num_taxels, self.num_taxels, 2 * self.half_width / self.num_taxels)

    def indentation(self, gap: Floats, force: float) -> float:
        """Depth δ of the deepest taxel under a normal force [N], ≥ 0, in ``[0, max_depth]`` [m].

        Solves F = k·A·∑ max(0, δ − gap) for gaps [m] of any shape, ``inf`` beside the object. The sum is convex and
        piecewise linear in δ, so Newton's method from the right ends exactly at the root.
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


class Phase(StrEnum):
    """Phases of a press (paper §5.3); the paper's forward phase is split at first contact."""

    APPROACH = "approach"
    CONTACT = "contact"
    PAUSE = "pause"
    WITHDRAW = "withdraw"


@dataclass(frozen=True, eq=False)
class Trace:
    """Time series of a press with T steps.

    Attributes:
        time: since the start [s], ``(T,)``.
        position: of the object's centre [m], ``(T, 3)``, world frame.
        force: of the pad on the object [N], ``(T, 3)``, world frame; +x points away from the pad.
        point: where the force acts, along y and z from the pad's centre [m], ``(T, 2)``; 0 without contact.
        phase: of the motion, ``(T,)``.
    """

    time: Floats
    position: Floats
    force: Floats
    point: Floats
    phase: Sequence[Phase]

    def __len__(self) -> int:
        return len(self.time)

    def select(self, rows: slice) -> Trace:
        """The steps in a slice."""
        return Trace(self.time[rows], self.position[rows], self.force[rows], self.point[rows], self.phase[rows])

    @property
    def end_of_pause(self) -> int:
        """Index of the step after the pause; 0 without a pause, as in a miss."""
        return next((row for row in range(len(self), 0, -1) if self.phase[row - 1] is Phase.PAUSE), 0)


@dataclass(frozen=True, eq=False)
class Contact:
    """The contact of one press; arrays are ``(num_taxels, num_taxels)``, rows along z, columns along y.

    Attributes:
        pad: the pressed pad.
        gap: distance of the object's surface behind its first point of contact [m], ≥ 0; ``inf`` beside the object. It
            may be too large where it is larger than the pad's maximal depth, which no press closes.
        force: normal force in the pause [N]; 0 for a miss.
        indentation: of the pad's surface [m], ≥ 0.
        pressure: on every taxel [Pa]; its integral is ``force`` unless the layer bottomed out.
        trace: time series of the press, if recorded.
    """

    pad: Pad
    gap: Floats
    force: float
    indentation: Floats
    pressure: Floats
    trace: Trace | None = None

    @property
    def depth(self) -> float:
        """Indentation of the deepest taxel [m]."""
        return float(self.indentation.max())

    @property
    def is_bottomed_out(self) -> bool:
        """Whether the layer reached its maximal depth before it carried the force, as under a sharp tip."""
        return self.depth >= self.pad.max_depth

    @property
    def centre_of_pressure(self) -> Floats:
        """Point where the force acts, along y and z from the pad's centre [m], ``(2,)``; 0 without pressure."""
        total = self.pressure.sum()
        if total == 0.0:
            return np.zeros(2)
        return (self.pad.taxel_centres[1:] @ self.pressure.ravel()) / total


class PressedObject(NamedTuple):
    """Result of one press, or of one grasp of a hand with m fingers.

    Attributes:
        contact: the physics; of a grasp, that of its first finger.
        image: the sensor's image, ``(n, n)`` or ``(n, n, 3)`` uint8; of a grasp ``(n, m · n)``, fingers side by side.
        num_unsettled: presses before it that did not settle.
        placement: where the object was; of a grasp, in front of a finger that is not turned.
        ideal: the image before the sensor's faults, in [0, 1].
        contacts: of all fingers; the force of one that misses is 0.
        left: orientation at rest in which a grasp left the object, unit quaternion ``wxyz``; None where none is made.
    """

    contact: Contact
    image: NDArray[np.uint8]
    num_unsettled: int
    placement: Placement
    ideal: NDArray[np.floating]
    contacts: tuple[Contact, ...]
    left: NDArray[np.float64] | None = None


def elastic_contact(pad: Pad, gap: Floats, force: float, stiffness: float = 1.0, trace: Trace | None = None) -> Contact:
    """The contact of a rigid surface with the pad's elastic foundation under a given force [N] (decision 0003).

    The gap is of :func:`surface_gap`; the force is ignored if the object misses the pad. ``stiffness`` is of the layer
    and the object's skin together, relative to the pad's.
    """
    force = force if np.isfinite(gap.min()) else 0.0
    indentation = pad.indentation(gap, force / stiffness) - gap
    np.maximum(indentation, 0.0, out=indentation)
    return Contact(pad, gap, force, indentation, (stiffness * pad.stiffness) * indentation, trace)


def missed(pad: Pad) -> Contact:
    """The contact of a pad that meets nothing."""
    zeros = np.zeros((pad.num_taxels, pad.num_taxels))
    return Contact(pad, np.full_like(zeros, np.inf), 0.0, zeros, zeros)


def surface_gap(pad: Pad, placement: Placement) -> Floats:
    """Gap between the pad and an object that just touches it, ``(num_taxels, num_taxels)`` [m].

    The smallest value is 0. It is ``inf`` beside the object, and everywhere for a miss. Gaps that are larger than the
    pad's maximal depth, which no press closes, may be too large.
    """
    return first_touch(pad, placement)[0]


def first_touch(pad: Pad, placement: Placement) -> tuple[Floats, float]:
    """:func:`surface_gap`, and the distance of the object's centre from the pad [m], ``nan`` for a miss."""
    shape, turn = placement.shape, to_matrix(placement.orientation) * placement.scale
    is_whole = shape.geom.presses == "surface" or pad.face is not None  # of which a simulation takes a hull
    within = np.inf if is_whole else pad.max_depth
    pixel = 2 * pad.half_width / pad.num_taxels
    reached = foremost(shape.surface, turn, np.asarray(placement.offset), pixel, pad.num_taxels, within)
    if pad.face is not None:
        reached += pad.face
    touching = float(reached.max())
    return (touching - reached, touching) if np.isfinite(touching) else (-reached, np.nan)


@dataclass(frozen=True, eq=False)
class Grasp:
    """The grasp of m fingers that closed on a body: contacts, and what each finger has in front of it in the end.

    The force of a finger that misses is 0. ``centre (m,)`` is that of the body, from the middle of the palm along each
    finger's axis [m]; ``net_force (3,)``, which the palm holds, has friction where it is simulated [N].
    """

    contacts: tuple[Contact, ...]
    met: tuple[Placement, ...]
    centre: NDArray[np.float64]
    net_force: NDArray[np.float64]

    @property
    def stops(self) -> NDArray[np.float64]:
        """Where the pads' faces stop, from the middle of the palm, ``(m,)`` [m]; ``nan`` for a finger that misses."""
        each = zip(self.contacts, self.met, strict=True)
        return np.array([first_touch(one.pad, seen)[1] - one.depth for one, seen in each]) - self.centre


class Press(Protocol):
    """A way to press an object against the pad; a subclass needs only ``press``.

    ``moves`` says whether the object's motion is simulated, so that it can slide or bounce.
    """

    moves: ClassVar[bool] = False

    @property
    def traced(self) -> bool:
        """Whether contacts carry a time series of force and contact point (``Contact.trace``)."""
        return False

    @property
    def closes(self) -> bool:
        """Whether it can close the fingers of a hand; where nothing moves, each presses by itself."""
        return not self.moves

    def lets_turn(self, num_fingers: int) -> bool:
        """Whether a body may turn where so many fingers close on it."""
        return False

    @abstractmethod
    def press(self, pad: Pad, placement: Placement, target_force: float) -> Contact:
        """The contact in the pause, where the motion stops at ``target_force`` [N]; its force is 0 for a miss."""

    def compiled(self, pad: Pad, shape: Shape) -> mujoco.MjModel | None:
        """The MuJoCo model of a press of this shape; None if the press does not use MuJoCo."""
        return None

    def with_trace(self) -> Press:
        """This press with a trace of its motion, if it can record one."""
        return self

    def close(
        self,
        pad: Pad,
        met: Sequence[Placement],
        fingers: NDArray[np.float64],
        centre: NDArray[np.float64],
        forces: Sequence[float],
    ) -> Grasp:
        """The grasp of m fingers that close on a body with ``forces`` [N]; by default, each presses by itself.

        ``met`` is what each has in front of it, ``fingers (m, 3, 3)`` the rotations of the pads about the middle of the
        palm, which press along the first columns, and ``centre (3,)`` that of the body in the palm [m].
        """
        contacts = tuple(self.press(pad, seen, float(force)) for seen, force in zip(met, forces, strict=True))
        axes = fingers[:, :, 0]
        return Grasp(contacts, tuple(met), axes @ centre, np.array([one.force for one in contacts]) @ axes)


@dataclass(frozen=True)
class Quasistatic(Press):
    """A press without simulated time: the object rests on the pad with exactly the target force."""

    def press(self, pad: Pad, placement: Placement, target_force: float) -> Contact:
        """See :class:`Press`."""
        return elastic_contact(pad, surface_gap(pad, placement), target_force, placement.stiffness)
