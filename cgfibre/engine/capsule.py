"""What a deck of smooth filaments says of their contact: the words of the plugin's styles."""

from __future__ import annotations

import math

import numpy as np

from cgfibre.plan.model import CONTACT, LEFT, RIGHT, Contact, Plan

FRICTION_TABLE, LAW_TABLE = "friction.txt", "contact.txt"
#: keywords of the law's tables
PAIR, PLATEN = "PAIR", "PLATEN"


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


def _table_words(contact: Contact, key: str) -> str:
    """Words of the plugin's law table behind its name."""
    back = contact.pair[0][2] is not None
    return f"{LAW_TABLE} {key}" + (f" unload {key}_BACK" if back else "")


def law_table(contact: Contact) -> dict[str, str]:
    """Text of the file that holds a tabulated law of pairs and of platens, by its name; nothing for other laws."""
    if contact.law != "table":
        return {}
    parts = ["# overlap (um), force per length (nN/um)\n"]
    for key, rows in ((PAIR, contact.pair), (PLATEN, contact.platen)):
        for name, column in ((key, 1), (f"{key}_BACK", 2)):
            if rows[0][column] is not None:
                parts.append(f"\n{name}\nN {len(rows)}\n")
                parts += [f"{k + 1} {row[0]:.17g} {row[column]:.17g}\n" for k, row in enumerate(rows)]
    return {LAW_TABLE: "".join(parts)}


def tables(contact: Contact) -> dict[str, str]:
    """Every file that a deck of smooth filaments reads beside its data file."""
    return friction_table(contact) | law_table(contact)


def capsule_parameters(plan: Plan) -> dict[str, float | int | str]:
    """Parameters of a deck whose filaments touch along their segments."""
    c, p = plan.contact, plan.platens
    gaps = np.zeros(0) if plan.woven else np.diff(plan.beads.stations)
    touch = np.isin(plan.beads.role, (CONTACT, LEFT, RIGHT) if plan.beads.support == "simple" else (CONTACT, RIGHT))
    longest = plan.spacing
    if plan.woven is None:
        longest = max(longest, float(np.max(gaps[touch[:-1] & touch[1:]], initial=0.0)))
    stiffness: tuple[float | str, float | str] = (c.modulus, p.modulus) if c.law == "line" else (c.kn, p.kn)
    if c.law == "table":
        stiffness = (_table_words(c, PAIR), _table_words(c, PLATEN))
    return {
        "contact_shape": "capsule",
        # filaments stretch a little; the style refuses half as much again
        "segment_um": 1.05 * longest,
        "capsule_spin": "yes" if plan.level == "rod" else "no",
        "capsule_sides": "both" if c.both_sides else "one",
        "ends_touch": {"simple": "both", "patch": "both", "symmetric": "right"}.get(plan.beads.support, "none"),
        "contact_law": c.law,
        "contact_stiffness_kPa": stiffness[0],
        "contact_damping": c.gamma,
        "contact_kt_ratio": c.kt / c.kn,
        "contact_friction": friction_words(c),
        "platen_stiffness_kPa": stiffness[1],
        "platen_damping": p.gamma,
    }
