"""Single elements that follow a tabulated law (thesis E.5): uniaxial and shear, driven by displacement and by force.

One disc, or one stretch of a smooth filament, on a platen. What the engine answers is compared with the table itself
(:func:`uniaxial_error`) and with Coulomb's limit on the full normal force (:func:`shear_error`).
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from scipy.interpolate import PchipInterpolator

from cgfibre.build.system import FloatArray
from cgfibre.engine.deck import template_folder
from cgfibre.engine.lammps import find_engine, run_deck
from cgfibre.engine.plugin import copy_plugin, plugin_variables
from cgfibre.engine.subbundle import table_text
from cgfibre.plan.contact import TANGENTIAL_RATIO
from cgfibre.subbundle_law import Table

#: um, um of depth, and kPa of k': of the elements' laws; the answers do not depend on them
SIZE, DEPTH, STIFFNESS = 79.0, 500.0, 3.3e5
ROWS = 200

DECK = """\
variable plugin index ./cgfibre_plugin.so
units micro
dimension {dimension}
boundary f f {boundary}
atom_style hybrid sphere bond
newton on
comm_modify vel yes cutoff 600
atom_modify map array sort 0 0
bond_style zero nocoeff
special_bonds lj 0 0 0
include plugin.inc
pair_style {pair}
read_data system.data
{bond}
pair_coeff * * none
neighbor 1 bin
neigh_modify exclude molecule/intra all
timestep {step:.17g}
variable time equal {step:.17g}*step
variable half equal 0.5*{time:.17g}
{drive}
fix wall all {wall} plane {up} {floor:.17g} above {law} friction {friction:.17g}
variable push equal {sign}f_wall[{up_index}]
variable drag_force equal {sign}f_wall[{across_index}]
variable overlap equal {radius:.17g}-(c_middle[{up_index}]-({floor:.17g}))
variable slid equal c_middle[{across_index}]
compute middle all com
fix out all ave/time 1 1 {every} v_overlap v_slid v_push v_drag_force file out.txt format " %.15g"
thermo {every}
run {steps}
print "cgfibre: done"
"""


@dataclass(frozen=True)
class Answer:
    """(n,) overlap um, slide um, normal and tangential force nN of an element on its platen."""

    overlap: FloatArray
    slide: FloatArray
    normal: FloatArray
    tangential: FloatArray


def _data(capsule: bool, height: float, mass: float) -> str:
    """Data file of a disc at the origin of a section, or of a filament of two beads along x, ``height`` um up."""
    radius = SIZE / 2
    if not capsule:
        density = mass / (np.pi / 6 * SIZE**3)
        body = f"1 1 0 {height:.17g} 0 {SIZE:.17g} {density:.17g} 1\n"
        return (
            "element\n\n1 atoms\n1 atom types\n0 bonds\n1 bond types\n2 extra bond per atom\n\n"
            f"-500 500 xlo xhi\n-500 500 ylo yhi\n{-radius} {radius} zlo zhi\n\nMasses\n\n1 1\n\n"
            f"Atoms # hybrid\n\n{body}"
        )
    density = mass / 2 / (np.pi / 6 * SIZE**3)
    rows = [
        f"{k + 1} 1 {x} 0 {height:.17g} {SIZE:.17g} {density:.17g} 1" for k, x in enumerate((-DEPTH / 2, DEPTH / 2))
    ]
    return (
        "element\n\n2 atoms\n1 atom types\n1 bonds\n1 bond types\n2 extra bond per atom\n\n"
        "-500 500 xlo xhi\n-500 500 ylo yhi\n-500 500 zlo zhi\n\nMasses\n\n1 1\n\nAtoms # hybrid\n\n"
        + "\n".join(rows)
        + "\n\nBonds\n\n1 1 1 2\n"
    )


def _drives(capsule: bool, kind: str, by: str, deepest: float, press: float, friction: float, mass: float) -> str:
    """Commands that move or push the element over the time of the run: there in the first half, back in the second."""
    across, up = ("y", "z") if capsule else ("x", "y")
    place = {"x": "NULL", "y": "NULL", "z": "NULL"}
    way = "(1-abs(v_time/v_half-1))"
    if by == "displacement":
        if kind == "uniaxial":
            path, axis, speed = f"-{deepest:.17g}*{way}", up, f"-{deepest:.17g}/v_half*(1-2*(v_time>v_half))"
        else:  # sideways under the overlap it starts with
            far = 0.4 * deepest
            path, axis, speed = f"{far:.17g}*{way}", across, f"{far:.17g}/v_half*(1-2*(v_time>v_half))"
        moved = {**place, axis: "v_path"}
        speeds = {**place, axis: "v_speed"}
        none = ("x", "y", "z") if capsule else ("x", "y")  # in two dimensions z is not to be named
        still = {a: ("v_none" if v == "NULL" and a in none else v) for a, v in moved.items()}
        stilled = {a: ("v_none" if v == "NULL" and a in none else v) for a, v in speeds.items()}
        return (
            f"variable path equal {path}\nvariable speed equal {speed}\nvariable none equal 0\n"
            f"fix lead all move variable {' '.join(still.values())} {' '.join(stilled.values())}"
        )
    # by force: pushed down by `press`, or by that at once and sideways up to 1.2 times Coulomb's limit
    share = 1.0 / (2 if capsule else 1)
    force = dict.fromkeys("xyz", "0.0")
    if kind == "uniaxial":
        force[up] = "v_down_force"
        lines = [f"variable down_force equal -{share * press:.17g}*{way}"]
    else:
        force[up] = f"{-share * press:.17g}"
        force[across] = "v_side_force"
        lines = [f"variable side_force equal {share * 0.98 * friction * press:.17g}*{way}"]
    fix = "fix lead all nve"  # without turning: a disc that turns rolls
    damp = 2 * np.sqrt(STIFFNESS * DEPTH * mass) * 0.3 * share
    return "\n".join(
        [
            *lines,
            fix,
            f"fix load all addforce {force['x']} {force['y']} {force['z']}",
            f"fix damp all viscous {damp:.17g}",
        ]
    )


def run_element(
    folder: Path, table: Table, kind: str, by: str, friction: float = 0.2, capsule: bool = False, deepest: float = 0.06
) -> Answer:
    """One element on a platen by a law: ``kind`` "uniaxial" or "shear", ``by`` "displacement" or "force".

    Uniaxial: to the overlap ``deepest`` (over the size) and back, or to its force and back. Shear: at that overlap to
    and fro sideways, or with that force down and 0.98 of Coulomb's limit sideways, there and back.
    """
    folder.mkdir(parents=True, exist_ok=True)
    radius = SIZE / 2
    x, load = table.overlap * SIZE, table.load * STIFFNESS * SIZE
    sections = {"LOAD": (x, load)}
    words = "table law.txt LOAD"
    if table.unload is not None:
        sections["UNLOAD"] = (x, table.unload * STIFFNESS * SIZE)
        words += " unload UNLOAD"
    (folder / "law.txt").write_text(table_text(sections, "overlap um, force nN/um"))
    press = float(PchipInterpolator(x, load)(deepest * SIZE)) * DEPTH
    mass = 4.4e6
    limit = np.sqrt(mass / (STIFFNESS * DEPTH * table.steepest * 2))
    step = 0.1 * limit
    steps = ROWS * (20 if by == "displacement" else 150)
    sinks = kind == "shear"
    start = radius - (deepest * SIZE if sinks else 0.0)
    up, up_index, across_index = ("z", 3, 2) if capsule else ("y", 2, 1)
    law = words if capsule else f"{words} length {DEPTH:.17g}"
    deck = DECK.format(
        dimension=3 if capsule else 2,
        boundary="f" if capsule else "p",
        pair="capsule 525" if capsule else "granular/table",
        bond="bond_coeff *",
        step=step,
        time=step * steps,
        drive=_drives(capsule, kind, by, deepest * SIZE, press, friction, mass),
        wall="wall/capsule" if capsule else "wall/granular/table",
        sign="" if capsule else "-",  # fix wall/capsule gives what acts on the filament, the other what acts on it
        up=up,
        up_index=up_index,
        across_index=across_index,
        floor=0.0,
        law=law,
        friction=friction,
        radius=radius,
        every=steps // ROWS,
        steps=steps,
    )
    (folder / "in.element").write_text(deck)
    (folder / "system.data").write_text(_data(capsule, start, mass))
    (folder / "plugin.inc").write_text((template_folder() / "plugin.inc").read_text())
    engine = find_engine()
    copy_plugin(folder, engine)
    run_deck(engine, folder, "in.element", 1, plugin_variables(folder, engine))
    return Answer(*np.loadtxt(folder / "out.txt").T[1:])


def expected_normal(table: Table, overlap: FloatArray) -> FloatArray:
    """Normal force nN of the table along a history of overlaps um (there and back once): the plugin's rule for a
    branch from the deepest overlap m, min(L(d), L(m) U(d r/m)/U(r))."""
    x = table.overlap * SIZE
    load = PchipInterpolator(x, table.load * STIFFNESS * SIZE * DEPTH)
    if table.unload is None:
        return np.asarray(load(overlap))
    unload = PchipInterpolator(x, table.unload * STIFFNESS * SIZE * DEPTH)
    deepest = np.maximum.accumulate(np.maximum(overlap, 1e-12))
    on_branch = np.minimum(load(overlap), load(deepest) * unload(overlap * x[-1] / deepest) / unload(x[-1]))
    return np.where(overlap < deepest, on_branch, load(overlap))


def uniaxial_error(table: Table, answer: Answer) -> float:
    """Largest difference of the normal force from the table, over the largest force."""
    inside = answer.overlap > 0
    wanted = expected_normal(table, answer.overlap)
    return float(np.max(np.abs(answer.normal - wanted)[inside]) / np.max(wanted))


def shear_error(table: Table, answer: Answer, by: str, friction: float) -> float:
    """Driven by displacement: the largest tangential force over mu N at its place, less 1. By force below that limit:
    the largest slide over T/kt, kt = 0.8 times the secant of the law, less 1."""
    if by == "displacement":
        at = int(np.argmax(np.abs(answer.tangential)))
        return float(np.abs(answer.tangential[at]) / (friction * answer.normal[at]) - 1)
    at = int(np.argmax(np.abs(answer.slide)))
    secant = float(PchipInterpolator(table.overlap, table.load)(answer.overlap[at] / SIZE)) * STIFFNESS * DEPTH * SIZE
    stiffness = TANGENTIAL_RATIO * secant / answer.overlap[at]
    held = 0.98 * friction * answer.normal[at]
    return float(np.abs(answer.slide[at]) * stiffness / held - 1)
