"""Contact and platen constants of a plan: the real stiffness, softened as far as the overlap allows."""

from __future__ import annotations

import math
from dataclasses import dataclass

from cgfibre.errors import InputError
from cgfibre.mechanics.contact import (
    LineContact,
    contact_modulus,
    crossing_prefactor,
    damping_coefficient,
    hertz_coefficient,
    mindlin_coefficient,
)
from cgfibre.mechanics.rod import contact_stiffness_bound
from cgfibre.plan.model import Contact
from cgfibre.scene import Scene

#: kt/kn of every contact (lammps-findings; Mindlin gives 0.82 for nu = 0.3)
TANGENTIAL_RATIO = 0.8
#: tangential over normal damping of every contact: more of it shortens the step of beads that may spin
TANGENTIAL_DAMPING = 0.3
#: damping ratio of a contact. Capsules: 0.1 gives the forces of 0.3 (carbon-37 to 12 um, both 2.0 % from a far slower
#: platen, on average) at a step 1.35 times as long
BEAD_DAMPING, CAPSULE_DAMPING = 0.3, 0.1
#: overlap over diameter beyond which a softened contact is not to be trusted
OVERLAP_LIMIT = 0.02
#: deepest overlap over diameter at which the softened contacts of a section begin to become real, and are
STIFFEN_FROM, STIFFEN_TO = 0.007, 0.015


@dataclass(frozen=True)
class ContactPlan:
    """Contact between filaments, and the stiffness and damping of a bead on a platen (kn, kt, gamma); ``tangent_kn``
    nN/um is the normal stiffness of a pair, for the law hertz that at the overlap limit, for the law line that at the
    design load. Of capsules all of them are per length; a bead's share of the length is ``length`` um. ``lever`` is the
    radius over the segment: friction on the side of a chain's segment also turns it. ``wall_modulus`` kPa: see Platens.
    """

    pair: Contact
    wall_kn: float
    wall_gamma: float
    tangent_kn: float
    wall_tangent: float
    length: float = 1.0
    lever: float = 0.0
    wall_modulus: float = 0.0

    def bounds(self, inertia: float = math.inf) -> tuple[float, float]:
        """(stiffness nN/um, damping nN us/um) that six contacts, one of them with a platen, add to a bead's bounds.

        Friction on a segment's side moves its ends by 1 +- 2 R/s: (1 + 4 (R/s)^2) times the stiffness along it.
        """
        along = 1 + 4 * self.lever**2
        return (
            self.length * _bound(self.tangent_kn, self.wall_tangent, along * TANGENTIAL_RATIO, inertia),
            self.length * _bound(self.pair.gamma, self.wall_gamma, along * TANGENTIAL_DAMPING, inertia),
        )

    @property
    def wall_kt(self) -> float:
        """Tangential stiffness on the platen, nN/um."""
        return TANGENTIAL_RATIO * self.wall_kn


def _bound(pair: float, wall: float, ratio: float, inertia: float) -> float:
    """Six contacts as in contact_stiffness_bound, one of them a platen's where that is the stiffer; it does not move,
    so w^2 <= wall max(1, ratio (1 + 1/(4 inertia))) (u^2 + rho^2 theta^2)."""
    six = float(contact_stiffness_bound(pair, kt_ratio=ratio, inertia=inertia))
    return six + max(0.0, wall * max(1.0, ratio * (1 + 0.25 / inertia)) - six / 6)


def _check_line_load(scene: Scene, *contacts: LineContact) -> None:
    """Refuse a load at which a contact would be as wide as the filament (half width b above R): no line contact."""
    load, radius = scene.contact.line_load, scene.filament.diameter / 2
    wide = max(float(c.half_width(load)) for c in contacts)
    if wide > radius:
        raise InputError(
            "contact.line_load",
            f"{load * 1e-6:.4g} N/mm",
            f"at most {load * 1e-6 * (radius / wide) ** 2:.3g} N/mm: a softer or thinner filament is squeezed flat, "
            "no line contact any more",
        )


def line_contacts(scene: Scene) -> tuple[LineContact, LineContact]:
    """Line contact of two filaments of the scene, and of one on a rigid platen; InputError for a load beyond them."""
    f = scene.filament
    r = f.diameter / 2
    pair = LineContact.between(r, r, f.E2, f.nu23, f.E2, f.nu23)
    platen = LineContact.on_rigid_plane(r, f.E2, f.nu23)
    _check_line_load(scene, pair, platen)
    return pair, platen


def damping_ratio(scene: Scene, usual: float) -> float:
    """Damping ratio of a contact: as asked, else the usual one of its shape."""
    asked = scene.contact.damping_ratio
    return usual if asked == "auto" else float(asked)


def plan_contact(scene: Scene, law: str, length: float, mass: float, softening: float) -> ContactPlan:
    """Constants of a bead of ``mass`` pg that stands for ``length`` um of contact line.

    hooke: kn = k' length / softening, k' the secant of the line contact at ``contact.line_load``. hertz: crossing
    cylinders, kn in the engine's own form; its tangent at the overlap limit bounds the time step.
    """
    between, on_platen = line_contacts(scene)
    load, zeta = scene.contact.line_load, damping_ratio(scene, BEAD_DAMPING)
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
    return ContactPlan(pair, wall, float(damping_coefficient(zeta, wall, mass)), tangent, wall)


def plan_capsule(
    scene: Scene, law: str, spacing: float, mass_per_length: float, softening: float, squeeze: float = 0.0
) -> ContactPlan:
    """Constants of contact along segments ``spacing`` um long of filaments that weigh ``mass_per_length`` pg/um.

    line: the line contact itself, E* / softening; its tangent at ``contact.line_load``, or at the line load of a
    ``squeeze`` nN/um if that is more, bounds the time step. hooke: the secant k'/softening.
    """
    between, on_platen = line_contacts(scene)
    load, zeta = scene.contact.line_load, damping_ratio(scene, CAPSULE_DAMPING)
    real, wall = (float(c.secant_stiffness(load)) for c in (between, on_platen))
    tangent, wall_tangent = (
        float(c.tangent_stiffness(max(load, squeeze)) if law == "line" else c.secant_stiffness(load)) / softening
        for c in (between, on_platen)
    )
    pair = Contact(
        law=law,
        kn=real / softening,
        kt=TANGENTIAL_RATIO * real / softening,
        gamma=float(damping_coefficient(zeta, real / softening, mass_per_length, mass_per_length)),
        friction=scene.contact.friction,
        softening=softening,
        line_stiffness=real,
        shape="capsule",
        modulus=between.modulus / softening,
        kinetic=scene.contact.kinetic_friction,
        by_angle=scene.contact.friction_by_angle,
    )
    wall_gamma = float(damping_coefficient(zeta, wall / softening, mass_per_length))
    lever = scene.filament.diameter / (2 * spacing)
    return ContactPlan(
        pair, wall / softening, wall_gamma, tangent, wall_tangent, spacing, lever, on_platen.modulus / softening
    )
