"""Contact and platen constants of a plan: the real stiffness, softened as far as the overlap allows."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cgfibre.mechanics.contact import (
    LineContact,
    contact_modulus,
    crossing_prefactor,
    damping_coefficient,
    hertz_coefficient,
    mindlin_coefficient,
)
from cgfibre.plan.model import Contact
from cgfibre.scene import Scene

#: kt/kn of every contact (lammps-findings; Mindlin gives 0.82 for nu = 0.3)
TANGENTIAL_RATIO = 0.8
#: overlap over diameter beyond which a softened contact is not to be trusted
OVERLAP_LIMIT = 0.02


@dataclass(frozen=True)
class ContactPlan:
    """Contact between filaments, and the stiffness and damping of a bead on a platen (kn, kt, gamma)."""

    pair: Contact
    wall_kn: float
    wall_gamma: float
    tangent_kn: float

    @property
    def wall_kt(self) -> float:
        """Tangential stiffness on the platen, nN/um."""
        return TANGENTIAL_RATIO * self.wall_kn


def line_contacts(scene: Scene) -> tuple[LineContact, LineContact]:
    """Line contact of two filaments of the scene, and of one on a rigid platen."""
    f = scene.filament
    r = f.diameter / 2
    return LineContact.between(r, r, f.E2, f.nu23, f.E2, f.nu23), LineContact.on_rigid_plane(r, f.E2, f.nu23)


def plan_contact(scene: Scene, law: str, length: float, mass: float, softening: float) -> ContactPlan:
    """Constants of a bead of ``mass`` pg that stands for ``length`` um of contact line.

    hooke: kn = k' length / softening, k' the secant of the line contact at ``contact.line_load``. hertz: crossing
    cylinders, kn in the engine's own form; its tangent at the overlap limit bounds the time step.
    """
    between, on_platen = line_contacts(scene)
    load, zeta = scene.contact.line_load, scene.contact.damping_ratio
    line = float(between.secant_stiffness(load))
    wall = float(on_platen.secant_stiffness(load)) * length / softening
    r = scene.filament.diameter / 2
    if law == "hertz":
        modulus = contact_modulus(scene.filament.E2, scene.filament.nu23, scene.filament.E2, scene.filament.nu23)
        kn = float(hertz_coefficient(crossing_prefactor(modulus, r, r), r, r)) / softening
        tangent = 1.5 * kn * math.sqrt(r / 2 * OVERLAP_LIMIT * 2 * r)
        kt = float(mindlin_coefficient(kn, TANGENTIAL_RATIO))
    else:
        kn = line * length / softening
        tangent, kt = kn, TANGENTIAL_RATIO * kn
    pair = Contact(
        law=law,
        kn=kn,
        kt=kt,
        gamma=float(damping_coefficient(zeta, tangent, mass, mass)),
        friction=scene.contact.friction,
        softening=softening,
        line_stiffness=line,
    )
    return ContactPlan(pair, wall, float(damping_coefficient(zeta, wall, mass)), max(tangent, wall))
