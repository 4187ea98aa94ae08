"""What a deck says of tows that are ribbons of joined chains: rungs as bonds, turns in the plane, twist."""

from __future__ import annotations

import numpy as np

from cgfibre.build.ribbon import between
from cgfibre.build.system import FilamentSystem, FloatArray, IntArray
from cgfibre.engine.datafile import Topology, group_types
from cgfibre.plan.model import Plan
from cgfibre.plan.ribbons import Elements, ribbon_elements


def with_rungs(bonds: IntArray, half: FloatArray, rest: FloatArray, rungs: Elements | None) -> Topology:
    """Bonds ``half`` (r - ``rest``)^2 of the filaments, and of the rungs behind them.

    Rungs bond beads that neither follow each other nor end one filament, by which the plugin tells them from segments.
    """
    if rungs is not None:
        bonds = np.concatenate([bonds, rungs.beads])
        half, rest = np.concatenate([half, rungs.stiffness / 2]), np.concatenate([rest, rungs.rest])
    kind, first = group_types(half, rest)
    return Topology("Bond", bonds, kind, [(float(half[i]), float(rest[i])) for i in first], "harmonic")


def joined(system: FilamentSystem, plan: Plan) -> tuple[Elements | None, list[Topology], dict[str, str]]:
    """(rungs, other topologies, parameters) of a plan's ribbons; nothing where no chains are joined."""
    if plan.ribbon is None:
        return None, [], {}
    rungs, turns, twists = ribbon_elements(system, plan.ribbon)
    topologies: list[Topology] = []
    parameters: dict[str, str] = {}
    if len(twists.beads):
        degrees = np.degrees(twists.rest) + 180.0  # K (1 + cos(phi - d)) is least at phi = d - 180
        kind, first = group_types(twists.stiffness, degrees)
        rows: list[tuple[float, ...]] = [(1, float(twists.stiffness[i]), 1, float(degrees[i])) for i in first]
        topologies.append(Topology("Dihedral", twists.beads, kind, rows, "fourier"))
        parameters["torsion"] = "ribbon"
    if len(turns.beads):
        kind, first = group_types(turns.stiffness, turns.rest)
        rows = [(float(turns.stiffness[i]), float(turns.rest[i])) for i in first]
        topologies.append(Topology("Improper", turns.beads, kind, rows, "ribbon"))
        parameters["in_plane"] = "ribbon"
    return rungs, topologies, parameters


def longest_joint(system: FilamentSystem, plan: Plan) -> float:
    """Largest distance of a joint's second bead, whose rank computes it, from another of its beads, um."""
    if plan.ribbon is None:
        return 0.0
    found = 0.0
    for element in ribbon_elements(system, plan.ribbon):
        for column in element.beads.T:
            ways = np.linalg.norm(between(system, element.beads[:, 1], column), axis=1)
            found = max(found, float(np.max(ways, initial=0.0)))
    return found
