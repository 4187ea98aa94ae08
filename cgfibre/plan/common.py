"""Choices and omissions that the planners of all levels share."""

from __future__ import annotations

import math

from cgfibre.errors import InputError
from cgfibre.plan.beads import SAFETY, bottom_span, platen_span
from cgfibre.plan.contact import ContactPlan
from cgfibre.plan.model import Choice, Omission, Platens
from cgfibre.scene import Scene


def common_omissions(scene: Scene, level: str, shape: str = "beads") -> list[Omission]:
    """What no level, or this one, models."""
    left = [
        Omission(
            "filament flattening",
            "a bead's section stays round; contacts take the compliance of the line contact, "
            f"its secant at {scene.contact.line_load * 1e-6:g} N/mm",
            "the approach of two filaments errs by up to half of itself a decade of load away (4 % D at 1 N/mm)",
        ),
        Omission(
            "gravity, adhesion, moisture", "small beside contact forces of micronewtons", "below 1e-3 of the force"
        ),
    ]
    if level == "chain":
        left.append(
            Omission(
                "torsion and rolling of filaments",
                "beads of a chain do not spin",
                "friction cannot roll a filament: right while mu N D/2 < GJ/L, else forces are too high",
            )
        )
    if level in ("chain", "rod") and shape == "beads":
        left.append(
            Omission(
                "smoothness of the filament's surface",
                "beads are spheres a diameter apart",
                "friction along a filament ripples; the bundle nests by up to 13 % D where filaments cross columns",
            )
        )
    if not scene.platens.unload:
        left.append(Omission("unloading", "the scene does not ask for it", "none on the loading curve"))
    return left


def platens(
    scene: Scene, contact: ContactPlan, contact_length: float, edges: bool, across: tuple[float, float] | None = None
) -> Platens:
    """Platens of the scene with the contact's stiffness; ``edges``: they end along x; ``across``: crimped ones are
    curved between these y (um), not along x."""
    p, length = scene.platens, scene.bundle.length
    lo, hi = platen_span(scene) if across is None else across
    radius = 0.0
    if p.shape == "crimped" and p.crimp_angle is not None:
        radius = (hi - lo) / 2 / math.sin(p.crimp_angle)
    return Platens(
        shape=p.shape,
        kn=contact.wall_kn,
        kt=contact.wall_kt,
        gamma=contact.wall_gamma,
        friction=p.friction,
        top_span=platen_span(scene) if edges and p.width != "full" else None,
        bottom_span=bottom_span(scene) if edges and bottom_span(scene) != (0.0, length) else None,
        contact_length=contact_length,
        crimp_radius=radius,
        crimp_centre=(lo + hi) / 2,
        convex=p.curvature == "convex",
        bottom_crimped=p.crimp_side == "both",
        modulus=contact.wall_modulus,
    )


def friction(scene: Scene) -> Choice:
    """The coefficients of friction."""
    c = scene.contact
    between = f"{c.friction:g}"
    if c.friction_by_angle is not None:
        between = ", ".join(f"{mu:g} at {math.degrees(angle):.3g} deg" for angle, mu in c.friction_by_angle)
    if c.kinetic_friction is not None:
        between += f" (slipping {c.kinetic_friction / c.friction if c.friction else 1:.3g} times that)"
    return Choice(
        "friction",
        f"{between} between filaments, {scene.platens.friction:g} on platens",
        "Coulomb, stated separately in the scene; a filament never touches itself",
    )


def checked_step(scene: Scene, limit: float) -> tuple[float, Choice]:
    """(time step us, choice): part of the limit, or as asked if below it."""
    asked = scene.model.timestep
    if asked == "auto":
        return SAFETY * limit, Choice(
            "time step",
            f"{SAFETY * limit:.4g} us",
            f"{SAFETY} of the proven limit {limit:.4g} us: stretching, bending and six damped contacts",
        )
    if asked >= limit:
        raise InputError("model.timestep", f"{asked:g} us", f"less than the stability limit {limit:.4g} us")
    return float(asked), Choice("time step", f"{asked:.4g} us", f"as asked in the scene; the limit is {limit:.4g} us")
