"""The FilamentSystem that a plan calls for: the scene's bundle with its beads where the plan puts them."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from cgfibre.build.bundle import BundleSpec, build_bundle, build_section
from cgfibre.build.curves import MigrationSpec
from cgfibre.build.system import FilamentSystem
from cgfibre.plan.model import Discs, Plan
from cgfibre.plan.outline import arrangement_spec, scene_filament
from cgfibre.plan.subbundle import with_groups
from cgfibre.plan.tows import woven_system
from cgfibre.scene import Scene


def build_system(scene: Scene, plan: Plan) -> FilamentSystem:
    """Filaments of the scene at the plan's stations; the same scene gives the same system.

    A periodic cell (symmetry ends) closes every filament on itself, with the box one cell long.
    """
    if plan.woven is not None:
        return woven_system(scene, plan.woven.resolve, plan.woven.asked_spacing)
    a = scene.bundle
    rng = np.random.default_rng(a.seed)
    if plan.discs is not None:
        return _subbundles(scene, plan.discs, rng)
    spec = BundleSpec(
        filament=scene_filament(scene),
        section=arrangement_spec(scene),
        stations=plan.beads.stations - plan.beads.stations[0] if not plan.flat else None,
        twist=a.twist if a.twist_direction == "Z" else -a.twist,
        twist_state=a.twist_state,
        migration=None
        if a.migration is None
        else MigrationSpec(period=a.migration.period, inner=a.migration.minimum_radius),
        jitter=a.jitter,
    )
    if plan.level == "section":
        return build_section(spec, rng)
    system = build_bundle(spec, rng)
    positions = system.positions + np.array([plan.beads.stations[0], 0.0, 0.0])
    box = system.box.copy()
    box[0] += plan.beads.stations[0]
    if not plan.beads.closed:
        return replace(system, positions=positions, box=box)
    box[0] = plan.beads.stations[0], plan.beads.stations[0] + a.length
    return replace(
        system,
        positions=positions,
        box=box,
        closed=np.ones(system.n_filaments, dtype=bool),
        periodic=np.array([True, False, False]),
    )


def _subbundles(scene: Scene, discs: Discs, rng: np.random.Generator) -> FilamentSystem:
    """Discs in the place of many filaments each: as stiff and heavy as these, shaken as much for their size."""
    one, n = scene_filament(scene), discs.filaments
    together = replace(
        one,
        diameter=discs.diameter,
        EA=n * one.EA,
        EI=n * one.EI,
        GJ=n * one.GJ,
        kGA=n * one.kGA,
        mass_per_length=n * one.mass_per_length,
    )
    spec = BundleSpec(
        filament=together, section=np.array(discs.centres), stations=None, jitter=scene.bundle.jitter * math.sqrt(n)
    )
    return with_groups(build_section(spec, rng), scene)
