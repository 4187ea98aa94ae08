"""What a deck of smooth filaments says of their contact: the words of the plugin's styles."""

from __future__ import annotations

import math

import numpy as np

from cgfibre.plan.model import CONTACT, LEFT, RIGHT, Contact, Plan

FRICTION_TABLE = "friction.txt"


def friction_words(contact: Contact) -> str:
    """Words of the plugin's friction law."""
    ratio = contact.kinetic / contact.friction if contact.kinetic is not None and contact.friction > 0 else 1.0
    if contact.by_angle is not None:
        return f"angle {FRICTION_TABLE} FRICTION ratio {ratio:.17g}"
    return f"{contact.friction:.17g}" + (f" kinetic {contact.kinetic:.17g}" if contact.kinetic is not None else "")


def friction_table(contact: Contact) -> dict[str, str]:
    """Text of the file that holds friction against the crossing angle, by its name; nothing without such friction."""
    if contact.by_angle is None:
        return {}
    rows = (f"{k + 1} {math.degrees(a):.17g} {mu:.17g}\n" for k, (a, mu) in enumerate(contact.by_angle))
    head = f"# crossing angle (degrees), static coefficient of friction\nFRICTION\nN {len(contact.by_angle)}\n"
    return {FRICTION_TABLE: head + "".join(rows)}


def capsule_parameters(plan: Plan) -> dict[str, float | int | str]:
    """Parameters of a deck whose filaments touch along their segments."""
    c, p, gaps = plan.contact, plan.platens, np.diff(plan.beads.stations)
    touch = np.isin(plan.beads.role, (CONTACT, LEFT, RIGHT) if plan.beads.support == "simple" else (CONTACT, RIGHT))
    longest = max(plan.spacing, float(np.max(gaps[touch[:-1] & touch[1:]], initial=0.0)))
    line = c.law == "line"
    return {
        "contact_shape": "capsule",
        # filaments stretch a little; the style refuses half as much again
        "segment_um": 1.05 * longest,
        "capsule_spin": "yes" if plan.level == "rod" else "no",
        "ends_touch": {"simple": "both", "symmetric": "right"}.get(plan.beads.support, "none"),
        "contact_law": c.law,
        "contact_stiffness_kPa": c.modulus if line else c.kn,
        "contact_damping": c.gamma,
        "contact_kt_ratio": c.kt / c.kn,
        "contact_friction": friction_words(c),
        "platen_stiffness_kPa": p.modulus if line else p.kn,
        "platen_damping": p.gamma,
    }
