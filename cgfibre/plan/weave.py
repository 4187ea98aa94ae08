"""Planner of weaves: which of them need their filaments, and which only their tows."""

from __future__ import annotations

from cgfibre.errors import InputError
from cgfibre.plan.model import Choice, Plan
from cgfibre.plan.weave_filaments import plan_woven_filaments
from cgfibre.plan.weave_tows import plan_tows
from cgfibre.scene import Scene


def plan_weave(scene: Scene) -> Plan:
    """Plan of a weave; InputError names what in the scene cannot be modelled."""
    resolve = choose_resolution(scene)
    if scene.contact.shape == "beads" and (resolve.value == "tow" or scene.model.level == "rod"):
        why = "tows: soft laws need" if resolve.value == "tow" else "rods of a weave: what they store is told by"
        expected = f"'auto' or 'capsule' for {why} the plugin (cgfibre plugin status)"
        raise InputError("contact.shape", "beads", expected)
    return (plan_tows if resolve.value == "tow" else plan_woven_filaments)(scene, [resolve])


def choose_resolution(scene: Scene) -> Choice:
    """Tows or their filaments, and why: tows unless the scene asks for filaments or for a law that is theirs."""
    asked = scene.model.resolve
    if asked != "auto":
        return Choice("resolved", asked, "as asked in the scene")
    if scene.contact.law in ("line", "hooke"):
        return Choice("resolved", "filament", f"contact.law = {scene.contact.law!r} is one of filaments, not of tows")
    return Choice(
        "resolved",
        "tow",
        "each tow a chain or rod with its rigidities and a soft law across; what it does inside is not asked for "
        "(model.resolve = 'filament' has all filaments)",
    )
