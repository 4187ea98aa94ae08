"""The verb homogenise: a sub-bundle's law from cells of filaments, and what pressed sections say as a material."""

from __future__ import annotations

import json
import tempfile
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from cgfibre import store
from cgfibre.build.system import FloatArray
from cgfibre.engine.cell import CellDisc, CellPath, CellRecord, run_cell
from cgfibre.engine.lammps import Engine, engine_version, find_engine
from cgfibre.errors import InputError
from cgfibre.measure import compaction, distribution, homogenise
from cgfibre.measure.homogenise import MultiLinear, SectionResponse
from cgfibre.mechanics import rod
from cgfibre.mechanics.contact import damping_coefficient
from cgfibre.plan.beads import SAFETY
from cgfibre.plan.contact import BEAD_DAMPING, ContactPlan, plan_contact
from cgfibre.plan.section import DISC_INERTIA
from cgfibre.scene import Scene
from cgfibre.scene_reading import load_scene, scene_from_dict
from cgfibre.subbundle_law import State, SubbundleLaw, Table

Note = Callable[[str], None]
#: cells of filaments are softened this much: P = p/k' does not know, the step is longer
SOFTENING = 10.0
#: overlaps that a law of contact knows, without dimension
LAW_OVERLAPS = np.linspace(0.0, 0.12, 25)


@dataclass(frozen=True)
class LawOptions:
    """How to derive a law: ``cells`` random starts (a third as many again squeezed from above alone), the first
    ``seed``, ``rounds`` of calibration, ``filaments`` a cell (None: the scene's count), the cells' path, k' over
    ``softening``."""

    cells: int = 6
    seed: int = 1
    rounds: int = 3
    filaments: int | None = None
    path: CellPath = field(default_factory=CellPath)
    softening: float = SOFTENING


@dataclass(frozen=True)
class Derivation:
    """A law and how it came about: state curves of discs in every round of calibration, and the rms difference of each
    from the filaments' over its largest pressure; the law is that of the round which differs least."""

    law: SubbundleLaw
    answers: tuple[State, ...]
    misfits: tuple[float, ...]


def derive_law(scene: Scene, options: LawOptions, note: Note | None = None, engine: Engine | None = None) -> Derivation:
    """The law of sub-bundles of the scene's filaments and friction, from cells of them and of discs in their place.

    Cells have the scene's filament, friction and contact as level section has them. Raises EngineError when a cell's
    run stops, InputError for options that jam no cell.
    """
    engine = engine or find_engine()
    say = note or (lambda _: None)
    count = options.filaments or scene.bundle.count
    d, depth = scene.filament.diameter, 1.0
    mass = scene.filament.density * np.pi / 4 * d**2 * depth
    contact = plan_contact(scene, "hooke", depth, mass, options.softening)
    stiffness = contact.pair.line_stiffness / contact.pair.softening
    filament = CellDisc(d, mass, np.pi / 4 * d**2, _step(contact, mass), depth, contact.pair)
    seeds = [options.seed + k for k in range(options.cells)]
    evenly = _cells(
        filament, options.path, count, seeds, engine, lambda s: say(f"cell of {count} filaments, start {s}")
    )
    alone = max(1, options.cells // 3)
    above = _cells(
        filament,
        replace(options.path, uniaxial=True),
        count,
        seeds[:alone],
        engine,
        lambda s: say(f"cell squeezed from above alone, start {s}"),
    )
    state = _state(evenly, stiffness, options.path.deepest)
    lateral = homogenise.lateral_ratio([r.across[~r.unloading] for r in above], [r.down[~r.unloading] for r in above])
    lattice = homogenise.lattice_table(state)
    known = LAW_OVERLAPS[lattice.overlap[-1] >= LAW_OVERLAPS]
    table = Table(known, np.interp(known, lattice.overlap, lattice.load), None, 1.0)
    tables, answers, misfits = [table], [], []
    size = d * np.sqrt(count)
    for k in range(options.rounds + 1):
        disc = _disc(table, size, contact, mass * count, depth, stiffness, count * np.pi / 4 * d**2)
        say(f"round {k}: cells of discs")
        records = _cells(disc, options.path, count, seeds, engine, lambda s: say(f"cell of discs, start {s}"))
        answers.append(_state(records, stiffness, options.path.deepest))
        misfits.append(_misfit(state, answers[-1]))
        say(f"round {k}: discs answer within {misfits[-1]:.1%} of the largest pressure (rms)")
        if k < options.rounds:
            table = homogenise.recalibrated(table, state, answers[-1])
            tables.append(table)
    table = tables[int(np.argmin(misfits))]
    law = SubbundleLaw(
        name=scene.name or "law",
        filaments=count,
        friction=scene.contact.friction,
        state=state,
        contact=table,
        lattice=lattice,
        lateral=lateral,
        provenance={
            "scene": scene.name,
            "cells": options.cells,
            "seeds": seeds,
            "cells_from_above": alone,
            "rounds": options.rounds,
            "rms_misfit_of_rounds": [float(f"{m:.3g}") for m in misfits],
            "path": {k: v for k, v in vars(options.path).items() if k != "uniaxial"},
            "stiffness_kPa": float(f"{stiffness:.6g}"),
            "softening": options.softening,
            "tangential_ratio": contact.pair.kt / contact.pair.kn,
            "engine": engine_version(engine),
            "by": "cgfibre homogenise",
        },
    )
    return Derivation(law, tuple(answers), tuple(misfits))


def _step(contact: ContactPlan, mass: float) -> float:
    touching, damping = contact.bounds(DISC_INERTIA)
    return SAFETY * float(rod.limiting_time_step(touching, mass, damping))


def _disc(
    table: Table, size: float, contact: ContactPlan, mass: float, depth: float, stiffness: float, solid: float
) -> CellDisc:
    kn = stiffness * depth * table.steepest
    gamma = float(damping_coefficient(BEAD_DAMPING, kn, mass, mass))
    pair = replace(contact.pair, law="table", kn=kn, gamma=gamma)
    mine = ContactPlan(pair, kn, gamma, kn, kn)
    law = (table.overlap * size, table.load * stiffness * size)
    return CellDisc(size, mass, solid, _step(mine, mass), depth, pair, law)


def _cells(
    disc: CellDisc, path: CellPath, count: int, seeds: Sequence[int], engine: Engine, say: Callable[[int], None]
) -> list[CellRecord]:
    found = []
    for seed in seeds:
        say(seed)
        with tempfile.TemporaryDirectory(prefix="cgfibre-cell-") as folder:
            found.append(run_cell(Path(folder), disc, path, count, seed, engine))
    return found


def _state(records: Sequence[CellRecord], stiffness: float, deepest: float) -> State:
    return homogenise.state_curve(
        [r.fraction for r in records],
        [r.pressure / stiffness for r in records],
        [r.unloading for r in records],
        deepest,
    )


def _misfit(wanted: State, answered: State) -> float:
    """Root mean square difference of two state curves at the first's fractions, over its largest pressure."""
    got = np.interp(wanted.fraction, answered.fraction, answered.load)
    return float(np.sqrt(np.mean((got - wanted.load) ** 2)) / wanted.load[-1])


# --- pressed sections ------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Material:
    """What runs of pressed sections say as a material, means over the runs on a common strain (n,): ``stress`` of the
    top platen with its standard deviation ``spread``, ``carried`` that of the bottom one (kPa), ``area_strain`` of the
    outline, ``poisson`` widening over thinning, and the straight ``pieces`` that fit stress against strain."""

    strain: FloatArray
    stress: FloatArray
    spread: FloatArray
    carried: FloatArray
    area_strain: FloatArray
    poisson: FloatArray
    pieces: MultiLinear
    runs: int


def section_material(folders: Sequence[Path], knees: int = 2, rows: int = 200) -> Material:
    """Mean response of the section runs in ``folders``: the starts of one scene. Raises InputError for other runs."""
    if not folders:
        raise InputError("DIR", "none", "one or more folders of runs")
    responses: list[SectionResponse] = []
    areas, widths = [], []
    for folder in folders:
        results = store.read_results(Path(folder) / "results.h5")
        if not results.system.is_section:
            raise InputError("DIR", str(folder), "a run of a section (model.level = 'section')")
        curve, frames, d = results.curve, results.frames, results.system.diameter
        load = curve.loading
        height, width = float(curve["thickness_um"][0]), float(curve.width_um[0])
        depth = _depth(results.plan)
        responses.append(
            homogenise.section_response(
                curve["displacement_um"][load],
                curve["force_top_N"][load] * 1e9,
                curve["force_bottom_N"][load] * 1e9,
                height,
                width,
                depth,
            )
        )
        peak = int(np.argmax(frames.displacement_um)) + 1
        outline = [distribution.polygon_area(distribution.outline(p[:, 1:], d)) for p in frames.positions[:peak]]
        areas.append((frames.displacement_um[:peak] / height, distribution.area_strain(outline, outline[0])))
        widths.append(compaction.poisson_ratio(curve.width_um[load], curve["thickness_um"][load]))
    strain = np.linspace(0.0, min(float(r.strain[-1]) for r in responses), rows)
    x = [r.strain for r in responses]
    stress, spread = homogenise.mean_of_runs(x, [r.stress for r in responses], strain)
    carried, _ = homogenise.mean_of_runs(x, [r.carried for r in responses], strain)
    area, _ = homogenise.mean_of_runs([a[0] for a in areas], [a[1] for a in areas], strain)
    ratio, _ = homogenise.mean_of_runs(x, widths, strain)
    pieces = homogenise.multi_linear(strain, stress, knees)
    return Material(strain, stress, spread, carried, area, ratio, pieces, len(responses))


def _depth(plan: str) -> float:
    return float(json.loads(plan)["depth"])


def material_lines(m: Material) -> list[str]:
    """What the verb prints of pressed sections."""
    knees = ", ".join(f"{k:.3f}" for k in m.pieces.knees) or "none"
    moduli = ", ".join(f"{e * 1e-3:.4g}" for e in m.pieces.moduli)
    thesis = ", ".join(f"{e:g}" for e in homogenise.THESIS_MODULI)
    at = ", ".join(f"{k:g}" for k in homogenise.THESIS_KNEES)
    last = len(m.strain) - 1
    return [
        f"{m.runs} runs, strain to {m.strain[last]:.3f}, stress to {m.stress[last] * 1e-3:.4g} MPa, of which the "
        f"bottom platen carries {m.carried[last] / m.stress[last]:.0%}: the rest goes into the springs",
        f"moduli {moduli} MPa, knees at strains {knees}, rms {m.pieces.rms:.1%} of the largest stress (thesis: "
        f"{thesis} MPa, {at})",
        f"area strain {m.area_strain[last]:.3f}, widening over thinning {m.poisson[last]:.2f} at the last strain "
        "(thesis' equivalent Poisson's ratio 0.4)",
    ]


def write_material(path: Path, m: Material) -> None:
    """Write a material as CSV: strain, stresses in MPa, area strain, widening over thinning."""
    rows = np.column_stack([m.strain, m.stress * 1e-3, m.spread * 1e-3, m.carried * 1e-3, m.area_strain, m.poisson])
    head = "strain,stress_MPa,stress_sd_MPa,carried_MPa,area_strain,widening_over_thinning"
    np.savetxt(path, rows, fmt="%.8g", delimiter=",", header=head, comments="")


def law_lines(found: Derivation) -> list[str]:
    """What the verb prints of a law."""
    law = found.law
    rounds = ", ".join(f"{m:.1%}" for m in found.misfits)
    return [
        f"{law.name}: jams at a volume fraction of {law.jam:.3f}; at {law.state.fraction[-1]:.2f} p/k' = "
        f"{law.state.load[-1]:.3g} +- {law.state.spread[-1]:.2g}",
        f"lateral stress ratio {law.lateral:.2f}, equivalent Poisson's ratio {law.poisson_ratio:.2f} (thesis 0.4)",
        f"discs against filaments, rms over the largest pressure, round by round: {rounds}",
    ]


def homogenise_sources(
    sources: Sequence[str], out: Path, overrides: Sequence[str], options: LawOptions, knees: int, note: Note | None
) -> list[str]:
    """The verb: of folders of runs their response as a material (CSV), of a scene its law (TOML); lines to print."""
    if out.exists():
        raise InputError("--out", str(out), "a file that does not exist yet")
    if all((Path(s) / "results.h5").exists() for s in sources):
        found = section_material([Path(s) for s in sources], knees)
        write_material(out, found)
        return [*material_lines(found), f"response {out}"]
    if len(sources) > 1:
        raise InputError("SOURCE", sources[0], "one scene, or folders of runs with a results.h5 each")
    scene = load_scene(sources[0], overrides)
    derived = derive_law(section_scene(scene), options, note)
    out.write_text(derived.law.to_toml())
    return [*law_lines(derived), f"law {out}"]


def section_scene(scene: Scene) -> Scene:
    """The scene at level section, whose discs the cells are made of."""
    data: dict[str, Any] = scene.model_dump(exclude_none=True)
    data["model"] = {"level": "section"}
    data["assembly"].pop("subbundle", None)
    return scene_from_dict(data)


__all__ = [
    "Derivation",
    "LawOptions",
    "Material",
    "derive_law",
    "homogenise_sources",
    "law_lines",
    "material_lines",
    "section_material",
    "write_material",
]
