"""The verification suite: every case, its grid, and how far from theory each may be, with the reason."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from cgfibre.cases import (
    capsule,
    capsule_friction,
    capsule_motion,
    capsule_platens,
    contact,
    friction,
    invariants,
    ribbon,
    rods,
    woven,
)
from cgfibre.cases.experiment import Measured

SPACINGS = (0.5, 1.0, 2.0, 4.0)
CAPSULE_SPACINGS = (1.0, 2.0, 4.0, 8.0)
CAPSTAN_NODES = (60, 30, 15, 8, 4)


@dataclass(frozen=True)
class Limit:
    """How far a measured error may be from the stated one: ``flat`` + ``square`` (s/D)^2, and why.

    ``order``: with which power of s/D the error shall fall. None: the order of the stated errors over the same
    spacings, where they are noticeable (asymptotic orders are only met by fine beads); nan: not tested.
    """

    flat: float
    reason: str
    square: float = 0.0
    order: float | None = None

    def at(self, spacing: float) -> float:
        """Allowed difference of error and stated error at s/D."""
        return self.flat + self.square * spacing**2


@dataclass(frozen=True)
class Case:
    """An experiment over a grid of levels and spacings.

    ``measure`` (folder, level, s/D) gives its numbers; ``limits`` by (quantity, level) or by quantity; ``quick``
    spacings are those of the short form.
    """

    name: str
    measure: Callable[[Path, str, float], list[Measured]]
    limits: Mapping[Any, Limit]
    levels: tuple[str, ...] = ("chain", "rod")
    spacings: tuple[float, ...] = SPACINGS
    quick: tuple[float, ...] = (2.0, 4.0)

    def limit(self, one: Measured) -> Limit:
        """The limit that a measured number has to keep."""
        of_level = self.limits.get((one.quantity, one.level))
        return of_level if of_level is not None else self.limits[one.quantity]


EXACT = Limit(1e-9, "exact: rounding and what is left of the settling")
SETTLED = Limit(1e-5, "theory's own error is stated; settling to 1e-6, large deflection (L/1000 to L/300)")
HOOKE = Limit(1e-9, "linear law: the ratio of secants is stated, of no order in s", order=float("nan"))
COULOMB = Limit(1e-5, "Coulomb's law; damping of the push, 1e-6")
DISC = Limit(1e-6, "a spring in series with the contact; rest to 1e-6")
BUMPS = {
    "mean F/N": Limit(1e-3, "quasi-static: the bead's bounce in the nest at this speed"),
    "peak F/N": Limit(
        5e-3, "rounding by the overlap is stated to first order; one of 2000 rows a period", order=float("nan")
    ),
    "nested distance": Limit(1e-3, "overlap of 5e-4 D, and the bounce"),
}
FRAME = {
    ("tip off", "chain"): Limit(1e-10, "the same sums in another order"),
    ("tip off", "rod"): Limit(1e-7, "bpm bonds lose half their digits in an arc cosine"),
    ("bending energy", "chain"): Limit(1e-10, "the same sums in another order"),
    ("bending energy", "rod"): Limit(1e-6, "bpm bonds lose half their digits in an arc cosine"),
}
CROSSING = Limit(1e-9, "the decks take the law of 90 degrees; other angles by the stated ratio of prefactors")


def _square(coefficient: float, reason: str) -> Limit:
    return Limit(1e-5, reason, coefficient, 2.0)


def _part(function: Callable[..., list[Measured]], **settings: object) -> Callable[[Path, str, float], list[Measured]]:
    return partial(function, **settings)


SMOOTH = {
    "mean F/N": Limit(1e-8, "Coulomb's law"),
    "rise and fall over D": Limit(1e-7, "smooth: nothing to climb; bpm bonds' noise of 0.3 nN"),
}
CAPSULES: Any = {"levels": ("chain, capsules", "rod, capsules"), "spacings": CAPSULE_SPACINGS, "quick": (4.0,)}


SMOOTH_RIPPLE = SMOOTH | {"ripple of F/N": Limit(1e-6, "smooth; bpm bonds' noise of 0.3 nN")}
#: the parts of a lens over a joint push in directions of their own
LENS_RIPPLE = {
    "mean F/N": Limit(1e-3, "lens over a joint: its parts push in directions of their own"),
    "ripple of F/N": Limit(3e-3, "lens over a joint: its parts push in directions of their own"),
}


#: filaments that touch along their segments
CAPSULE_CASES: tuple[Case, ...] = (
    *(
        Case(
            f"line contact of capsules, {load:g} N/mm",
            _part(capsule.line_contact, load=load),
            {"line load": Limit(1e-9, "the law itself, tabulated to 1e-10")},
            **CAPSULES,
        )
        for load in contact.LINE_LOADS
    ),
    *(
        Case(
            f"crossing of capsules at {angle:g} degrees, lens {width:g} R",
            _part(capsule.crossing, angle=angle, width=width),
            {"force": Limit(1e-9, "two points of every stretch are stated", order=float("nan"))},
            CAPSULES["levels"] if width == 0.5 else ("chain, capsules",),  # the same code
            CAPSULE_SPACINGS,
            (4.0,),
        )
        for angle in (90.0, 45.0, 10.0)
        for width in (0.2, 0.5, 1.5)
    ),
    Case("end overlap", capsule.end_overlap, {"force": EXACT}, **CAPSULES),
    Case("off the end", capsule.off_the_end, {"force off": EXACT}, **CAPSULES),
    Case("capsules sliding along", capsule_friction.sliding_along, SMOOTH_RIPPLE, **CAPSULES),
    Case("capsules sliding in a groove", capsule_friction.sliding_in_groove, SMOOTH_RIPPLE, **CAPSULES),
    Case(
        "capsules sliding across",
        capsule_friction.sliding_across,
        {"F_t/F_n": Limit(1e-8, "Coulomb's law")},
        **CAPSULES,
    ),
    *(
        Case(
            f"capsules crossing, sliding at {angle:g} degrees",
            _part(capsule_friction.crossing_sliding, angle=angle),
            LENS_RIPPLE,
            **CAPSULES,
        )
        for angle in (90.0, 45.0, 10.0)
    ),
    *(
        Case(
            f"friction by angle, {angle:g} degrees",
            _part(capsule_friction.friction_by_angle, angle=angle),
            LENS_RIPPLE,
            **CAPSULES,
        )
        for angle in (90.0, 45.0, 10.0)
    ),
    Case(
        "static and kinetic friction",
        capsule_friction.static_and_kinetic,
        {
            "largest F/N": Limit(6e-3, "one of 400 rows over the way to slip"),
            "sliding F/N": Limit(1e-8, "Coulomb's law"),
        },
        **CAPSULES,
    ),
    Case("anvil with sharp edges", capsule_platens.sharp_edge, {"force": EXACT}, **CAPSULES),
    *(
        Case(
            f"cylinder that presses capsules, {side}",
            _part(capsule_platens.cylinder, side=side),
            {"force": Limit(3e-3, "two points of a segment on which the overlap varies", 1e-3, order=float("nan"))},
            **CAPSULES,
        )
        for side in ("outside", "inside")
    ),
    Case(
        "capsules dragged between platens",
        capsule_platens.between_platens,
        {"F_t/F_n": Limit(1e-8, "Coulomb's law"), "normal force": EXACT},
        **CAPSULES,
    ),
    Case(
        "capsules rolling between platens",
        capsule_platens.rolling,
        {name: Limit(1e-5, "it is set rolling with a jerk") for name in ("speed", "turn")},
        ("rod, capsules",),
        CAPSULE_SPACINGS,
        (4.0,),
    ),
    Case(
        "torque of friction",
        capsule_friction.torque_of_friction,
        {"F_t/F_n": Limit(1e-8, "Coulomb's law"), "torque": Limit(1e-8, "at the surface")},
        ("rod, capsules",),
        CAPSULE_SPACINGS,
        (4.0,),
    ),
    Case(
        "rolled by friction",
        capsule_friction.rolled,
        {
            "F_t/F_n": Limit(5e-5, "Coulomb's law; the place of half a lens to six digits"),
            "turn": Limit(3e-5, "settling; the place of half a lens to six digits"),
        },
        ("rod, capsules",),
        CAPSULE_SPACINGS,
        (4.0,),
    ),
    Case(
        "capsules pushed across",
        capsule_motion.pushed_across,
        {
            "distance of axes": Limit(
                2e-2, "the push bends the segments next to it; two points of the lens are stated"
            ),
            "passed": EXACT,
        },
        **CAPSULES,
    ),
    *(
        Case(
            f"capsules over a bend, crossing at {crossing:g} degrees",
            _part(capsule_motion.over_a_bend, crossing=crossing),
            {
                "off an eighth": Limit(4e-2, "two points of a lens that a joint cuts, or not"),
                "largest step": Limit(1.2e-2, "of 2000 over 0.6 s: 0.3 s/lens", order=float("nan")),
                "sum of forces": Limit(
                    1e-10, "pair forces: rounding of bending forces, which are a thousand times larger"
                ),
            },
            **CAPSULES,
        )
        for crossing in (90.0, 20.0)
    ),
    *(
        Case(
            f"bouncing capsules, {angle:g} degrees" + (f", step over {refine}" if refine > 1 else ""),
            _part(capsule_motion.energy_drift, angle=angle, refine=refine),
            {
                "drift": Limit(5e-3, "of the fall, in 1e5 steps: force by two points is no exact gradient"),
                "scatter of energy": Limit(
                    1e-2, "leapfrog's own energy differs by (omega dt)^2/8 of its fastest modes'"
                ),
            },
            ("chain, capsules",),
            CAPSULE_SPACINGS,
            (4.0,),
        )
        for angle, refine in ((0.0, 1), (10.0, 1), (60.0, 1), (90.0, 1), (0.0, 2), (60.0, 2))
    ),
    Case(
        "platen force balance of capsules",
        contact.platen_balance,
        {"taken below": Limit(1e-6, "balance at rest")},
        CAPSULES["levels"],
        (1.0, 2.0, 4.0),
        (4.0,),
    ),
    Case(
        "momentum of capsules",
        invariants.momentum,
        {
            "linear, change": Limit(1e-12, "pair forces: rounding"),
            "angular, change": Limit(1e-11, "pair forces and torques: rounding"),
        },
        CAPSULES["levels"],
        (1.0, 2.0, 4.0),  # filaments of 16 D
        (4.0,),
    ),
)

RIBBONS: Any = {"levels": ("chain, capsules",), "spacings": (1.0, 2.0, 4.0), "quick": (4.0,)}
#: flat tows as ribbons of joined chains
RIBBON_CASES: tuple[Case, ...] = (
    Case("ribbon bent out of its plane", ribbon.cantilevers, {"deflection": SETTLED}, **RIBBONS),
    *(
        Case(
            f"ribbon bent in its plane, chords of {reach}",
            _part(ribbon.cantilevers, way="y", reach=reach),
            {"deflection": SETTLED},
            **RIBBONS,
        )
        for reach in (1, 3)
    ),
    Case("ribbon twisted", ribbon.twisted, {"turn": Limit(1e-5, "exact; settling")}, **RIBBONS),
    Case(
        "ribbon twisted, ends held",
        ribbon.held_and_twisted,
        {"energy": Limit(2e-3, "helices of (y tau)^2 = 3e-3; their chords", order=float("nan"))},
        **RIBBONS,
    ),
    Case(
        "ribbon let go",
        ribbon.let_go,
        {
            "drift": Limit(
                1e-5, "leapfrog's own energy differs by (omega dt)^2/8 of its fastest modes'", order=float("nan")
            ),
            "scatter of energy": Limit(
                2e-5, "leapfrog's own energy differs by (omega dt)^2/8 of its fastest modes'", order=float("nan")
            ),
        },
        **RIBBONS,
    ),
)

CASES: tuple[Case, ...] = (
    Case("axial", rods.axial, {"elongation": EXACT}, quick=(1.0,)),
    Case(
        "end load doubled",
        rods.end_load_doubled,
        {"elongation": Limit(1e-6, "settling of the loaded end")},
        quick=(1.0,),
    ),
    Case(
        "cantilever",
        rods.cantilever,
        {"deflection": SETTLED},
    ),
    Case(
        "simply supported",
        rods.three_point,
        {"deflection": SETTLED},
    ),
    Case(
        "pre-tensioned beam",
        rods.pre_tensioned,
        {"deflection": SETTLED},
    ),
    Case("flat platen", rods.flat_platen, {"deflection": SETTLED, "taken by supports": Limit(1e-6, "balance at rest")}),
    Case(
        "elastica",
        rods.elastica,
        {
            ("deflection", "chain"): _square(6e-4, "second order: (s/L)^2 of trapezium rule and chords"),
            ("shortening", "chain"): _square(7e-4, "second order: (s/L)^2 of trapezium rule and chords"),
            ("deflection", "rod"): _square(1.1e-4, "second order: chords cut the corners"),
            ("shortening", "rod"): Limit(1e-5, "chords cut the corners, nearly made up for", 4e-6),
        },
        quick=(1.0, 2.0),
    ),
    Case(
        "buckling",
        rods.buckling,
        {"load": Limit(1e-5, "stated to second order of s/L; parabola through three loads", 3e-6)},
    ),
    Case(
        "bending frequency",
        rods.frequency,
        {
            "frequency": Limit(
                1e-5, "amplitude L/1000; the time step's (omega dt)^2/24; a rod's inertia is stated", 1e-6
            )
        },
    ),
    Case(
        "torsion",
        rods.torsion,
        {"torque": Limit(1e-7, "exact; settling")},
        levels=("rod",),
    ),
    Case(
        "torsion, 3 rad a bond",
        rods.torsion_of_three_radians,
        {"torque": EXACT},
        levels=("rod",),
    ),
    Case(
        "helix",
        rods.helix_compliance,
        {
            "compliance": _square(2.4e-3, "second order in the turn of a bond, 0.11 s/D: chords cut the corners"),
            "drift unloaded": Limit(1e-4, "bpm bonds' noise of 0.3 nN (arc cosine) on a soft spring"),
        },
        levels=("rod",),
    ),
    Case(
        "curved rest shape",
        rods.curved_rest_shape,
        {
            "compliance": _square(7e-4, "second order in the turn of a bond, 0.039 s/D: chords cut the corners"),
            "drift unloaded": Limit(1e-4, "bpm bonds' noise of 0.3 nN (arc cosine)"),
            "bending energy": Limit(1e-6, "1 - cos, stated to second order", 1e-6),
        },
    ),
    *(
        Case(
            f"345 mm, far field {form}",
            _part(rods.far_field, form=form),
            {"force": Limit(1e-3, "the beam's own; graded beads")},
            ("chain",),
            (1.0,),
            (1.0,),
        )
        for form in ("condensed", "graded")
    ),
    *(
        Case(
            f"disc on the spring of {length / 1000:g} mm ({spring})",
            _part(rods.disc, length=length, spring=spring),
            {"force": DISC},
            ("section",),
            (0.0,),
            (0.0,),
        )
        for length in (700.0, 345000.0)
        for spring in ("exact", "thesis")
    ),
    Case(
        "capstan",
        friction.capstan,
        {"T2/T1": Limit(2e-6, "the polygon's own ratio is stated; the chain stretches by 1e-6, sinks in by 1e-5 of s")},
        ("chain",),
        tuple(friction.Pulley().spacing(nodes) for nodes in CAPSTAN_NODES),
        tuple(friction.Pulley().spacing(nodes) for nodes in (15, 8)),
    ),
    Case(
        "sliding along",
        friction.sliding_along,
        BUMPS,
        ("chain", "rod"),
        (0.125, 0.25, 0.5, 1.0),
        (0.5,),
    ),
    Case("sliding in a groove", friction.sliding_in_groove, BUMPS, ("chain", "rod"), (0.25, 0.5, 1.0), (0.5,)),
    Case(
        "sliding across",
        friction.sliding_across,
        {"F_t/F_n": COULOMB, "F along/F_n": Limit(1e-6, "beads in register: no bump along")},
        quick=(1.0,),
    ),
    Case(
        "dragged between platens",
        friction.between_platens,
        {
            name: Limit(1e-6, "Coulomb's law, hooke; the platen moves on by 1e-9 of its speed")
            for name in ("F_t/F_n", "normal force")
        },
        quick=(1.0,),
    ),
    *(
        Case(f"line contact, {load:g} N/mm", _part(contact.line_contact, load=load), {"line load": HOOKE}, quick=(1.0,))
        for load in contact.LINE_LOADS
    ),
    *(
        Case(
            f"line contact, {load:g} N/mm (section)",
            _part(contact.line_contact, load=load),
            {"line load": HOOKE},
            ("section",),
            (0.0,),
            (0.0,),
        )
        for load in contact.LINE_LOADS
    ),
    *(
        Case(f"crossing at {angle:g} degrees", _part(contact.crossing, angle=angle), {"force": CROSSING}, quick=(1.0,))
        for angle in (90.0, 45.0, 20.0)
    ),
    Case(
        "stack between platens",
        contact.stack,
        {"top force": Limit(1e-7, "springs in series at rest"), "bottom force": Limit(1e-9, "balance at rest")},
        ("section",),
        (0.0,),
        (0.0,),
    ),
    Case(
        "platen force balance",
        contact.platen_balance,
        {"taken below": Limit(1e-6, "balance at rest")},
        spacings=(0.5, 1.0),
        quick=(1.0,),
    ),
    Case(
        "energy over a cycle",
        invariants.energy_cycle,
        {
            "energy at the stop": Limit(1e-3, "leapfrog's own energy differs by (omega dt)^2/8 of its fastest modes'"),
            "unbalanced": Limit(1e-3, "leapfrog's own energy differs by (omega dt)^2/8 of its fastest modes'"),
            "left over": Limit(
                1e-2, "a swing of v/(omega d) about the pressed shape, both ways: 4 (1/(12 pi))^2 = 3e-3"
            ),
        },
        quick=(4.0,),
    ),
    Case(
        "momentum",
        invariants.momentum,
        {
            "linear, change": Limit(1e-12, "pair forces: rounding"),
            "angular, change": Limit(1e-11, "pair forces and torques: rounding"),
        },
        quick=(1.0,),
    ),
    Case("frame", invariants.frame, FRAME, quick=(2.0,)),
    Case(
        "woven arch",
        woven.woven_arch,
        {
            ("deflection", "chain"): Limit(
                1e-5, "second order in the spacing over 20 D from crossing to crossing", 0.012, 1.9
            ),
            ("deflection", "rod"): Limit(
                1e-4, "second order in the spacing over 20 D from crossing to crossing", 0.0035, 1.9
            ),
        },
        spacings=(0.5, 1.0, 2.0),
        quick=(0.5, 1.0),
    ),
    *CAPSULE_CASES,
    *RIBBON_CASES,
)


def order_of(spacings: Sequence[float], errors: Sequence[float]) -> float:
    """Slope of log |error| against log spacing by least squares; nan for fewer than two points or an error of 0."""
    size = np.abs(np.asarray(errors, dtype=float))
    if len(size) < 2 or np.any(size == 0):
        return float("nan")
    return float(np.polyfit(np.log(np.asarray(spacings)), np.log(size), 1)[0])


def grouped(found: Sequence[Measured]) -> dict[tuple[str, str, str], list[Measured]]:
    """Measured numbers by (case, quantity, level), in the order of spacing."""
    groups: dict[tuple[str, str, str], list[Measured]] = {}
    for one in sorted(found, key=lambda m: m.spacing):
        groups.setdefault((one.case, one.quantity, one.level), []).append(one)
    return groups


#: a stated error counts as the method's own, with an order, from this size on
NOTICEABLE = 1e-5


def expected_order(case: Case, group: Sequence[Measured]) -> float | None:
    """Order that theory gives for a group over its own spacings; None where the method is exact."""
    if len(group) < 2:
        return None
    asked = case.limit(group[0]).order
    if asked is not None:
        return None if np.isnan(asked) else asked
    stated = [m.stated for m in group]
    if min(abs(x) for x in stated) < NOTICEABLE or len(set(np.round(stated, 12))) == 1:
        return None
    return order_of([m.spacing for m in group], stated)


def measure(case: Case, folder: Path, spacings: Sequence[float] | None = None) -> list[Measured]:
    """All levels of a case at these spacings (None: its grid)."""
    return [
        one
        for level in case.levels
        for spacing in (case.spacings if spacings is None else spacings)
        for one in case.measure(folder / level / f"{spacing:g}", level, spacing)
    ]


def complaints(case: Case, found: Sequence[Measured]) -> list[str]:
    """What in the numbers of a case is further from theory than its limits say; empty when all is well."""
    bad = []
    for one in found:
        off, allowed = abs(one.error - one.stated), case.limit(one).at(one.spacing)
        if not off <= allowed:
            bad.append(
                f"{one.case}, {one.quantity}, {one.level}, s = {one.spacing:g} D: error {one.error:.3e}, theory "
                f"{one.stated:.3e}, allowed {allowed:.1e}"
            )
    for (name, quantity, level), group in grouped(found).items():
        order = expected_order(case, group)
        measured = order_of([m.spacing for m in group], [m.error for m in group])
        if order is not None and not abs(measured - order) <= ORDER_MARGIN:
            bad.append(f"{name}, {quantity}, {level}: order {measured:.3f}, theory {order:.3f}")
    return bad


#: of a measured order: next terms of the error, and settling in the smallest errors
ORDER_MARGIN = 0.12
