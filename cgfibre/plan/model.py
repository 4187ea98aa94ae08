"""What a plan says: every number the deck needs, every choice with its reason, everything left out with its error."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray, IntArray
from cgfibre.mechanics.elastica import SpringLaw
from cgfibre.scene import FLAT
from cgfibre.scene_values import LawRow

#: roles of a station's beads; bead type in the engine = role * filament kinds + kind + 1
CONTACT, FREE, LEFT, RIGHT, GRIP = range(5)
#: twist stiffness of a pinned rod's grip over that of a segment, GJ/s: the rod is held a tenth of a segment beyond each
#: end, so its twist errs by 0.2 s/L; below E1 = 7.5 G12 the end beads weigh more for it, the step stays
GRIP_STIFFENING = 10.0
ROD_DAMPING = 0.05  # of critical in every mode of a bpm bond: without it torsion feeds bending until the rod bursts


@dataclass(frozen=True)
class Choice:
    """A decision: what was chosen, its value, and why."""

    what: str
    value: str
    reason: str


@dataclass(frozen=True)
class Omission:
    """Something that is left out of the model, why, and the error to expect from it."""

    what: str
    reason: str
    error: str


@dataclass(frozen=True)
class ErrorPart:
    """A part of the promised error: what causes it, its share of the force (mean over the quasi-static part of
    loading), and what that is based on."""

    what: str
    value: float
    reason: str


@dataclass(frozen=True)
class Beads:
    """Where the beads of every filament stand along x and what they are; of a weave, whose tows share no stations,
    ``role``, ``mass`` and ``hinge`` are those of all beads, and ``stations`` their places along their own tow.

    ``stations`` (n,) um; ``role`` (n,) int; ``mass`` (n,) pg; ``hinge`` (n,) nN um, the angle stiffness K of angle
    cosine at each station (0 where there is no angle); ``far_spring`` (transverse, axial) nN/um of a condensed far
    field's end beads; ``support`` names the deck's include; ``end_load`` nN on each bead of the right support;
    ``tension`` nN in every filament as built (closed ones carry it without an end).
    """

    stations: FloatArray
    role: IntArray
    mass: FloatArray
    hinge: FloatArray
    support: str
    end_load: float
    tension: float = 0.0
    far_spring: tuple[float, float] = (0.0, 0.0)
    closed: bool = False
    far_field: str = "none"
    zone: tuple[float, float] = (0.0, 0.0)


def every_bead(system: FilamentSystem, values: np.ndarray) -> np.ndarray:
    """(n_beads,) from values of the stations that all filaments share, or of all beads (a weave)."""
    return values if len(values) == system.n_beads else np.tile(values, system.n_filaments)


@dataclass(frozen=True)
class Woven:
    """A weave: what is ``resolve``d (tow or filament), the ``size`` (x, y) um of the cell or patch, the ``volume`` of
    fibres um3, whether it is ``periodic``, whether its tows are free of stress as built (``at_rest``).

    In the plane: ``strain`` (x, y), ``tension`` (x, y) nN on the whole cell (None: held there), ``shear`` rad;
    ``when``: "before" the platens move or "after" they have, over ``preparation`` steps, or "during" the first loading,
    in proportion to its first ``over`` um. A free edge meets a drag of ``edge_drag`` (x, y) nN us a strain.
    ``tows`` (warp, weft) of the cell. ``skin`` um: how far beads go before neighbours are found anew;
    ``end_stiffness`` nN/um of a patch's ends; ``asked_spacing`` um that the builder was given.
    """

    resolve: str
    size: tuple[float, float]
    volume: float
    periodic: bool
    at_rest: bool
    strain: tuple[float, float] = (0.0, 0.0)
    tension: tuple[float | None, float | None] = (None, None)
    shear: float = 0.0
    when: str = "before"
    over: float = 0.0
    preparation: int = 0
    edge_drag: tuple[float, float] = (0.0, 0.0)
    tows: tuple[int, int] = (1, 1)
    skin: float = 1.0
    end_stiffness: float = 0.0
    asked_spacing: float = 0.0

    @property
    def moved(self) -> bool:
        """Whether anything happens in the plane."""
        return self.strain != (0.0, 0.0) or self.tension != (None, None) or self.shear != 0.0

    @property
    def steps_before(self) -> int:
        """Steps that the platens wait for what happens in the plane, a quarter of them for it to come to rest."""
        return math.ceil(1.25 * self.preparation) if self.when == "before" else 0


@dataclass(frozen=True)
class Ribbon:
    """What joins the chains of flat tows, a value each kind of filament (warp, weft): ``across`` nN/um, their modulus
    across times their thickness; ``bending`` nN um2, EI in the ribbon's plane above that out of it, of the whole tow;
    ``twist`` nN um2, its GJ; ``reach``, segments in each chord over which turns in the plane are taken (0: none)."""

    across: tuple[float, ...]
    bending: tuple[float, ...]
    twist: tuple[float, ...]
    reach: tuple[int, ...]


@dataclass(frozen=True)
class Contact:
    """Contact between filaments.

    ``shape`` beads: ``law`` hooke (kn nN/um) or hertz (kn kPa), with ``kt``, ``gamma`` (nN us/um), friction. ``shape``
    capsule: the same per length of contact, kn, kt in kPa, gamma in nN us/um^2, ``law`` hooke or line: then kn is the
    secant at the design load and ``modulus`` kPa the E* of the line contact, softened. ``line_stiffness`` kPa is the
    real secant stiffness per length that ``softening`` divides. ``kinetic`` friction of what slips (None: as
    ``friction``); ``by_angle`` ((angle rad, mu), ...) in the place of ``friction``. Law table: ``pair`` and ``platen``
    are its rows (overlap um, force per length nN/um, the same on the way back or None). ``both_sides``: the force is
    the mean of what either segment of a pair sees, so that neither of two tows is the one pressed at a point.
    """

    law: str
    kn: float
    kt: float
    gamma: float
    friction: float
    softening: float
    line_stiffness: float
    shape: str = "beads"
    modulus: float = 0.0
    kinetic: float | None = None
    by_angle: tuple[tuple[float, float], ...] | None = None
    pair: tuple[LawRow, ...] = ()
    platen: tuple[LawRow, ...] = ()
    both_sides: bool = False

    @property
    def per_length(self) -> bool:
        """Whether filaments touch along their segments: stiffness and damping are per length."""
        return self.shape == "capsule"

    def sliding_friction(self, angle: FloatArray) -> FloatArray:
        """Coefficient of what slips where axes cross at acute ``angle`` (n,) rad."""
        share = 1.0 if self.kinetic is None or self.friction == 0 else self.kinetic / self.friction
        if self.by_angle is None:
            return np.full(np.shape(angle), share * self.friction)
        return np.asarray(share * np.interp(angle, *np.array(self.by_angle).T))


@dataclass(frozen=True)
class Platens:
    """Platens: stiffness and damping a bead (capsules: per length of contact, with the softened E* of the line contact
    as ``modulus``), friction, and the spans along x of the top and the bottom one, um (None: no edge).

    Crimped ones are cylinders: the axis lies across the filaments at x = ``crimp_centre``, of a section along them at
    y = ``crimp_centre`` (um).
    """

    shape: str
    kn: float
    kt: float
    gamma: float
    friction: float
    top_span: tuple[float, float] | None
    bottom_span: tuple[float, float] | None
    contact_length: float
    crimp_radius: float = 0.0
    crimp_centre: float = 0.0
    convex: bool = True
    bottom_crimped: bool = True
    modulus: float = 0.0


@dataclass(frozen=True)
class Discs:
    """Discs of a level subbundle: ``filaments`` that each stands for, ``diameter`` um, stiffness ``factors`` of their
    kinds; the law of two: ``overlap`` um, ``load`` and ``unload`` nN/um of depth; ``heights``: top and bottom platen um
    where they touch the outline of the filaments as arranged; ``centres`` (y, z) um as arranged."""

    filaments: float
    diameter: float
    factors: tuple[float, ...]
    overlap: tuple[float, ...]
    load: tuple[float, ...]
    unload: tuple[float, ...] | None
    heights: tuple[float, float]
    centres: tuple[tuple[float, float], ...]


@dataclass(frozen=True)
class Target:
    """Where a loading ends: the displacement planned, um, or earlier at a force (nN) or pressure (kPa; inf: none)."""

    displacement: float
    force: float = math.inf
    pressure: float = math.inf


def film_time(first: float, last: float, growth: float, displacement: float) -> float:
    """Time to a displacement, us: v = first (1 + d/growth) up to ``last``; the inverse of the deck's motion.inc."""
    end = growth * (last / first - 1)
    if displacement <= end:
        return growth / first * math.log1p(displacement / growth)
    return growth / first * math.log(last / first) + (displacement - end) / last


@dataclass(frozen=True)
class Motion:
    """Platen motion: speeds in um/us, growth length um, phases in steps, earlier stops (inf: none).

    v(d) = first (1 + d/growth) until ``last``; unloading runs the same film backwards. ``cycles`` are the targets of
    loadings before the last one; each is followed by unloading, till the platen feels nothing, and by the next loading
    from there, with d counted from there. ``load_steps`` are those of the first loading. At speed v forces above
    ``quasi_static_impedance`` (nN us/um) times v are within the accuracy asked for. ``eps`` is the accuracy that the
    bound of the speed was taken for. ``fastest`` is the highest speed, at the stop, that a bundle bending between its
    supports allows (inf where other forces count). ``pace`` is the mean over displacements of the speed over what the
    accuracy allows, nan where no bound is known.
    """

    first: float
    last: float
    growth: float
    load_steps: int
    hold_steps: int
    unload: bool
    stop_force: float
    stop_pressure: float
    planned_displacement: float
    quasi_static_impedance: float
    eps: float
    fastest: float
    pace: float = math.nan
    cycles: tuple[Target, ...] = ()

    @property
    def targets(self) -> tuple[Target, ...]:
        """Where each loading ends, the last one at the scene's stop."""
        return (*self.cycles, Target(self.planned_displacement, self.stop_force, self.stop_pressure))

    @property
    def planned_steps(self) -> int:
        """Steps of all phases if no stop comes earlier and the assembly springs back whole."""
        per_time = self.load_steps / self._time(self.targets[0].displacement)
        loads = [self.load_steps, *(math.ceil(per_time * self._time(t.displacement)) for t in self.targets[1:])]
        return sum(loads) + sum(loads[:-1]) + (loads[-1] if self.unload else 0) + self.hold_steps

    def _time(self, displacement: float) -> float:
        return film_time(self.first, self.last, self.growth, displacement)

    def first_loading(self) -> Motion:
        """The first loading alone: no cycle, hold or unloading."""
        first = self.targets[0]
        return replace(
            self,
            cycles=(),
            hold_steps=0,
            unload=False,
            planned_displacement=first.displacement,
            stop_force=first.force,
            stop_pressure=first.pressure,
        )

    def quasi_static_force(self, displacement: FloatArray) -> FloatArray:
        """Force at each displacement from which on the motion is quasi-static, nN."""
        return self.quasi_static_impedance * np.minimum(self.first * (1 + displacement / self.growth), self.last)


@dataclass(frozen=True)
class Sampling:
    """Steps in a record row, between readings, between frames, between checkpoints, and in a block.

    A block is the stretch in which the platens' walls look at the beads that were near them at its start.
    """

    sample: int
    every: int
    frame: int
    checkpoint: int
    block: int


@dataclass(frozen=True)
class Plan:
    """The least model that the scene asks for, in engine units.

    ``depth`` um is the length a section stands for (0 for the other levels); ``springs`` (nN/um, nN um/rad) its
    springs, for small deflections and turns; ``spring_law`` their law for large ones, where it is wanted;
    ``disc_fixes``: "plugin" or "engine", whose fixes hold them; ``stiffen``: their contacts may become so many times
    stiffer; ``discs`` what discs that stand for many filaments are (None: each is a filament); ``ribbon`` what joins
    the chains of flat tows (None: nothing); ``free_span`` um the length that bends beside a finite platen; ``timestep``
    us; ``drag`` nN us/um and ``turning_drag`` nN um us of the background on a contact bead.
    """

    level: str
    spacing: float
    pitch: float
    width: float
    height: float
    n_filaments: int
    n_beads: int
    beads: Beads
    axial_softening: float
    timestep: float
    timestep_limit: float
    drag: float
    turning_drag: float
    torsion: str
    contact: Contact
    platens: Platens
    motion: Motion
    sampling: Sampling
    predicted_seconds: float
    choices: tuple[Choice, ...]
    omissions: tuple[Omission, ...]
    promise: tuple[ErrorPart, ...] = ()
    free_span: float = math.inf
    depth: float = 0.0
    springs: tuple[float, float] = (0.0, 0.0)
    woven: Woven | None = None
    spring_law: SpringLaw | None = None
    disc_fixes: str = "engine"
    stiffen: float = 1.0
    discs: Discs | None = None
    ribbon: Ribbon | None = None

    @property
    def flat(self) -> bool:
        """Whether the model is a cross-section: discs, nothing along the filaments."""
        return self.level in FLAT

    @property
    def promised_error(self) -> float:
        """Sum of the parts of the error: mean relative error of the loading force."""
        return sum(part.value for part in self.promise)

    @property
    def planned_steps(self) -> int:
        """Steps of all phases if no stop comes earlier."""
        return self.motion.planned_steps
