"""The least level that a scene needs, and what of it would be lost on a lower one."""

from __future__ import annotations

import math

from cgfibre.plan.model import Choice, ErrorPart
from cgfibre.plan.outline import Outline
from cgfibre.scene import Scene

#: part of D by which filaments may want to straighten without it being worth a rod's curved rest shape
STRAIGHTENING = 0.01
#: mean error of a section under an anvil with edges, between which filaments sag (carbon-37, against chain)
SECTION_ERROR = 0.3
#: force error of suppressed rolling where filaments would roll freely (lammps-findings: 35 to 130 %)
ROLLING_ERROR = 0.35
#: turn (rad) by friction below which rolling is not worth a rod: chain and rod agree within 1 % there (carbon-37)
ROLLING_TURN = 0.5


def natural_curvature(scene: Scene, out: Outline) -> float:
    """Largest curvature of the centre lines as built, 1/um: r (2 pi tau)^2 of twist, a (2 pi/p)^2 of migration."""
    a = scene.bundle
    curvature = out.radius() * (2 * math.pi * a.twist) ** 2
    if a.migration is not None:
        curvature += out.radius() / 2 * (2 * math.pi / a.migration.period) ** 2
    return curvature


def straightening(scene: Scene, out: Outline) -> float:
    """How far a straight rest shape would move a filament built curved, um: kappa min(L^2/8, EI/P)."""
    length, tension = scene.bundle.length, scene.ends.tension
    arm = length**2 / 8
    if tension > 0:
        arm = min(arm, out.filament.EI / tension)
    return natural_curvature(scene, out) * arm


def rolling_turn(scene: Scene, out: Outline) -> float:
    """Turn of a filament by friction at half the planned displacement, rad: (mu N D/2) L/(4 GJ).

    N is the bending force over the filaments of the top layer, about sqrt(n); the ends are held, 4 GJ/L each half in
    parallel. Small: friction cannot roll a filament; of order one and more: it rolls before it slides.
    """
    layer = max(1.0, math.sqrt(len(out.centres)))
    normal = out.bending_force(scene, out.displacement / 2) / layer
    torque = scene.contact.friction * normal * scene.filament.diameter / 2
    return torque * scene.bundle.length / (4 * out.filament.GJ)


def rolling_error(turn: float) -> float:
    """Error of forces without rolling, ROLLING_ERROR turn^2/(1 + turn^2): 1 % at 0.2 rad, all of it beyond 2 rad."""
    return ROLLING_ERROR * turn**2 / (1 + turn**2)


def nothing_varies(scene: Scene) -> bool:
    """Whether every cross-section sees the same: straight filaments in a periodic cell, a platen over all of it."""
    return scene.bundle.straight and scene.ends.support == "symmetry" and scene.platens.width == "full"


def choose_level(scene: Scene, out: Outline) -> Choice:
    """The level, and why: as asked, or section where nothing varies along x, rod where twist or rolling matters, else
    chain."""
    asked = scene.model.level
    if asked != "auto":
        return Choice("level", asked, "as asked in the scene")
    d = scene.filament.diameter
    chain_alone = scene.model.far_field == "condensed" or scene.model.torsion == "dihedral"
    bend = straightening(scene, out)
    if bend > STRAIGHTENING * d and not chain_alone:
        return Choice(
            "level",
            "rod",
            f"twist or migration: a chain, straight at rest, would move filaments by {bend:.2g} um "
            f"({bend / d:.0%} D) on its own; a rod keeps its curved rest shape and carries torsion",
        )
    if nothing_varies(scene) and scene.contact.law != "hertz":
        return Choice("level", "section", "nothing varies along the filaments: one cross-section is all of them")
    sections = (
        scene.bundle.straight
        and scene.platens.shape == "flat"
        and scene.ends.support == "simply-supported"
        and scene.contact.law != "hertz"
        and not chain_alone
    )
    if sections and scene.model.accuracy > SECTION_ERROR:
        return Choice(
            "level",
            "section",
            f"accuracy {scene.model.accuracy:g} is met by discs on springs ({SECTION_ERROR:.0%} from the sag between "
            "the anvil's edges)",
        )
    turn = rolling_turn(scene, out)
    if turn > ROLLING_TURN and scene.bundle.straight:
        return Choice(
            "level",
            "chain",
            f"straight parallel filaments; friction would roll them by {turn:.2g} rad before it slides, which a chain "
            "suppresses: level = 'rod' rolls, at some eight times the cost",
        )
    return Choice(
        "level",
        "chain",
        "nearly straight parallel filaments: stretch and bending; "
        f"friction turns a filament by {turn:.2g} rad at most (mu N D/2 against 4 GJ/L), too little to roll it",
    )


def level_errors(scene: Scene, out: Outline, level: str) -> list[ErrorPart]:
    """What the level itself gets wrong, as parts of the promised error."""
    parts = []
    if level == "section" and not nothing_varies(scene):
        parts.append(
            ErrorPart(
                "section",
                SECTION_ERROR if scene.platens.width != "full" else 0.1,
                "filaments sag between the anvil's edges and meet their neighbours earlier (measured on carbon-37)",
            )
        )
    if level == "chain":
        turn = rolling_turn(scene, out)
        parts.append(ErrorPart("no rolling", rolling_error(turn), f"friction would turn filaments by {turn:.2g} rad"))
        bend = straightening(scene, out) / scene.filament.diameter
        if bend > 0:
            parts.append(ErrorPart("straight rest shape", bend, f"filaments move by {bend:.2g} D on their own"))
    return parts
