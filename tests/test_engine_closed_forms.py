"""The engine's own decks against closed forms, where that takes more than the cases of the verification suite say."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cgfibre.build.bundle import BundleSpec, build_bundle
from cgfibre.cases import rods
from cgfibre.cases.experiment import Outcome, moved, planned, pressed_at, run
from cgfibre.cases.rods import AWAY, D, critical_drag
from cgfibre.engine.assemble import assemble, rest_bends
from cgfibre.errors import EngineError, InputError
from cgfibre.mechanics import rod, support
from cgfibre.plan.model import RIGHT

L = 280.0  # 40 diameters
FILAMENT = planned({})[1].types[0]
LEVELS = ("chain", "rod")

# --- bending ---------------------------------------------------------------------------------------------------------


def press(folder, level, *, tension, width=0.0, length=L, spacing=D, ends="simply-supported") -> rods.Press:
    """A filament at rest under an edge or a flat platen; the last rows agree to 1e-5."""
    changes = {"ends.tension": f"{tension} nN", "assembly.length": f"{length} um", "ends.support": ends}
    if width:
        changes["platens.width"] = f"{width} um"
    pressed = rods.press(folder, level, spacing / D, changes)
    assert abs(pressed.change) < 1e-5
    return pressed


@pytest.mark.parametrize("length", [20 * D, 40 * D])
def test_a_chain_bends_as_the_sum_over_its_hinges_says(tmp_path, length):
    """Simply supported, mid-span force: F L^3/(48 EI) (1 + 2 (s/L)^2), the trapezoidal rule of the chain's hinges.

    Tolerance: large deflection and the sagging of bonds, (0.1/L)^2 and less.
    """
    compliance = press(tmp_path, "chain", tension=0.0, length=length).compliance
    EI = FILAMENT.EI
    assert compliance == pytest.approx(length**3 / (48 * EI) * (1 + 2 * (D / length) ** 2), rel=5e-5)


@pytest.mark.parametrize("length", [20 * D, 40 * D])
def test_a_clamped_chain_converges_with_the_square_of_the_spacing(tmp_path, length):
    """Clamped at both ends: L^3/(192 EI) (1 + 8 (s/L)^2); the clamp hinges carry 2 EI/s."""
    compliance = press(tmp_path, "chain", tension=0.0, length=length, ends="clamped").compliance
    EI = FILAMENT.EI
    assert compliance == pytest.approx(length**3 / (192 * EI) * (1 + 8 * (D / length) ** 2), rel=5e-5)


@pytest.mark.parametrize(
    ("level", "tension", "width", "spacing", "error"),
    [
        ("chain", 4e5, 0.0, D, 1.5e-3),
        ("chain", 4e6, 0.0, D, 1.5e-3),
        ("chain", 4e5, 196.0, D, 2e-3),
        ("chain", 4e5, 0.0, D / 2, 1.5e-3),
        ("rod", 0.0, 0.0, D, 1e-4),
        ("rod", 4e5, 196.0, D, 1e-4),
        ("rod", 4e6, 0.0, D, 1e-4),
        ("rod", 4e5, 0.0, D / 2, 1e-4),
    ],
)
def test_a_platen_bends_a_filament_as_a_tensioned_beam(tmp_path, level, tension, width, spacing, error):
    """Against platen_force (rods: with shear). Chains err by about 2 (s/L)^2 = 1.25e-3; rods by 7e-5 under high tension
    and less else. Half the spacing on half the length keeps s/L."""
    length = 40 * spacing
    pressed = press(tmp_path, level, tension=tension, width=width, spacing=spacing, length=length)
    f = FILAMENT
    exact = 1 / rod.platen_force(
        1.0, length, f.EI, width=width, tension=tension, kGA=f.kGA if level == "rod" else math.inf
    )
    assert pressed.compliance == pytest.approx(float(exact), rel=error)
    # what the platen gives the supports take, half each, but for that noise
    assert pressed.left + pressed.right == pytest.approx(pressed.wall, rel=3e-6)
    assert pressed.left == pytest.approx(pressed.right, rel=3e-6)


@pytest.mark.parametrize("tension", [0.0, 4e5])
def test_a_clamped_rod_is_exact(tmp_path, tension):
    """Clamped at both ends = two simply supported beams of half the span, one upside down at the other's end."""
    compliance = press(tmp_path, "rod", tension=tension, ends="clamped").compliance
    f = FILAMENT
    exact = 2 * rod.platen_compliance(L / 2, f.EI, tension=tension, kGA=f.kGA)
    assert compliance == pytest.approx(float(exact), rel=1e-4)


# --- stretching ------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("ends", ["simply-supported", "clamped"])
@pytest.mark.parametrize("level", LEVELS)
def test_the_end_load_is_in_equilibrium_as_built_and_stretches_by_EA(tmp_path, level, ends):
    """At the planned end load nothing moves; twice of it moves the loaded end by P/EA of the natural length.

    EA is the softened one of the plan; the natural length is L/(1 + P/EA).
    """
    P = 4e5
    plan, system = planned(
        {"model.level": level, "ends.tension": f"{P} nN", "assembly.length": f"{L} um", "ends.support": ends}
    )
    f = system.types[0]
    EA = f.EA / plan.axial_softening
    assert (plan.axial_softening > 1) == (level == "chain")
    frequency = math.pi / 2 / L * math.sqrt(EA / f.mass_per_length)
    held = int(np.sum(plan.beads.role == RIGHT))

    def path(name, load):
        out = run(
            tmp_path / name,
            system,
            moved(plan, 1e-3, 12000, sample=500),
            drag=critical_drag(plan, frequency),
            end_load_nN=load / held,
            **AWAY,
        )
        return out.record.state["end_path"] - out.record.start["end_path"]

    assert np.max(np.abs(path("as built", P))) < 1e-9 * P * L / EA
    pulled = path("twice", 2 * P)[-1]
    span = system.positions[-1, 0] - system.positions[0, 0]
    inner = span if held == 1 else span - 2 * D  # the held bonds at the left carry nothing
    if held == 1:
        assert pulled == pytest.approx(P / EA * inner / (1 + P / EA), rel=1e-8)
    else:  # the inner loaded bead moves with the span, the outer one by half a load on its own bond more
        outer = D / (1 + P / 2 / EA) / 2
        assert pulled == pytest.approx(P / EA * (2 * inner / (1 + P / EA) + outer), rel=1e-8)


def test_a_periodic_cell_carries_the_tension_without_ends(tmp_path):
    """Symmetry ends: every bond is stretched by P/EA' from the start, nothing moves; rods refuse what they cannot lay
    out."""
    P = 4e5
    changes = {"ends.support": "symmetry", "ends.tension": f"{P} nN", "assembly.length": f"{L} um"}
    plan, system = planned(changes | {"model.level": "chain"})
    deck = assemble(system, plan)
    bond = next(t for t in deck.data.topologies if t.name == "Bond")
    rest = np.array(bond.coefficients)[bond.kind, 1]
    EA = system.types[0].EA / plan.axial_softening
    np.testing.assert_allclose(EA * (system.bond_lengths() / rest - 1), P, rtol=1e-6)
    out = run(tmp_path, system, moved(plan, 1e-3, 4000), **AWAY)
    assert np.max(out.record.mean["kinetic"]) < 1e-9 * P * L * P / EA
    with pytest.raises(InputError, match="periodic rod"):
        assemble(*reversed(planned(changes | {"model.level": "rod"})))


# --- twist -----------------------------------------------------------------------------------------------------------


def test_a_twisted_rod_is_linear_and_its_grips_hold_it_a_tenth_of_a_bond_beyond_its_ends(tmp_path):
    """Middle bead turned after the reference run and held: torque 4 GJ theta/(L + 0.2 s), linear to the grips."""
    length, theta = 20 * D, 0.2
    plan, system = planned({"model.level": "rod", "assembly.length": f"{length} um"})
    plan = moved(plan, 1e-3, 6000)
    f = system.types[0]
    inertia = rod.SPHERE_INERTIA * D * f.mass_per_length * D**2
    frequency = math.pi / length * math.sqrt(f.GJ * D / inertia)
    n = system.n_beads
    middle = n // 2
    run(
        tmp_path,
        system,
        plan,
        [
            f"group held id {middle + 1}",
            "group spinning subtract turning held",
            "unfix integrate",
            "fix integrate spinning nve/bpm/sphere",
            f"set group held quat 1 0 0 {math.degrees(theta):.17g}",
            "compute turns all property/atom quatw quati tqx",
            "dump turns all custom 6000 turns.txt id c_turns[*]",
            "dump_modify turns sort id format float %.15g",
        ],
        turning_drag=2 * frequency * inertia,
        **AWAY,
    )
    rows = (tmp_path / "turns.txt").read_text().split("ITEM: TIMESTEP\n")[-1].splitlines()[8:]
    _, w, i, torque = np.array([line.split() for line in rows], dtype=float).T
    turn = 2 * np.arctan2(i, w)
    half = length / 2
    linear = theta * (half + 0.1 * D - np.abs(system.positions[:, 0] - half)) / (half + 0.1 * D)
    np.testing.assert_allclose(turn[:n], linear, rtol=1e-8)
    assert np.all(turn[n:] == 0)  # the grips
    natural = (length + 0.2 * D) / (1 + 4e5 / f.EA)
    assert -torque[middle] == pytest.approx(4 * f.GJ * theta / natural, rel=1e-7)
    exact = support.mid_span_torsional_stiffness(length, f.GJ) * theta
    assert -torque[middle] == pytest.approx(float(exact), rel=0.2 * D / length)


def twisted_and_bent(folder, damping: float) -> Outcome:
    """A rod turned by 0.25 rad a bond towards its middle, let go, and pressed by 2 um there."""
    length = 20 * D
    plan, system = planned({"model.level": "rod", "assembly.length": f"{length} um"})
    load = 4000
    plan = pressed_at(plan, length / 2 - 0.1, length / 2 + 0.1)
    plan = moved(plan, 2.0 / load / plan.timestep, load, 16000, sample=500)
    middle = system.n_beads // 2 + 1
    turn = f"{math.degrees(0.25)}*({middle - 1}-abs(id-{middle}))*(id<={system.n_beads})"
    return run(
        folder,
        system,
        plan,
        [f"variable turned atom {turn}", "set group turning quat 1 0 0 v_turned"],
        platen_bottom_um=-1000.0,
        turning_drag=0.0,
        drag=0.0,
        rod_damping=damping,
    )


def test_an_undamped_rod_with_twist_and_bending_bursts_and_rod_damping_cures_it(tmp_path):
    """Bond damping alone (no drag): without it the torsional waves feed bending until bonds are lost; with the deck's
    5 % of critical the kinetic energy only falls once the platen rests."""
    with pytest.raises(EngineError, match="became unstable"):
        twisted_and_bent(tmp_path / "undamped", 0.0)
    out = twisted_and_bent(tmp_path / "damped", 0.05)
    kinetic = out.record.mean["kinetic"]
    held = kinetic[8:]  # from the end of loading on
    assert np.all(np.diff(held) < 0.02 * held[:-1])
    assert held[-1] < 0.1 * held[0]


# --- section ---------------------------------------------------------------------------------------------------------


def test_the_thesis_spring_of_a_long_filament_is_a_fifth_too_stiff():
    thesis = float(support.thesis_mid_span_stiffness(345000.0, FILAMENT.EI, 4e5))
    exact = float(rod.platen_force(1.0, 345000.0, FILAMENT.EI, width=500.0, tension=4e5))
    assert thesis / exact == pytest.approx(1.21, abs=0.01)


def test_a_disc_turns_back_by_its_torsional_spring(tmp_path):
    """Torque -k sin(turn) as set, and free swings of small turns at sqrt(k/I), I = m D^2/8.

    The integrator's phase runs ahead by (omega dt)^2/24.
    """
    plan, system = planned(rods.SECTION)
    f = system.types[0]
    k = float(support.mid_span_torsional_stiffness(700.0, f.GJ))
    inertia = plan.beads.mass[0] * D**2 / 8
    omega = math.sqrt(k / inertia)
    step = 0.02 / omega
    steps = round(3 * 2 * math.pi / 0.02)
    plan = moved(replace(plan, timestep=step), 1e-9, steps // 20 * 20, sample=20)

    def swing(name, turn):
        out = run(
            tmp_path / name,
            system,
            plan,
            [
                f"set group all dipole {math.cos(turn):.17g} {math.sin(turn):.17g} 0",
                "compute moment all property/atom muy tqz",
                "compute sine_torque all reduce sum c_moment[1] c_moment[2]",
                'fix swing all ave/time 20 1 20 c_sine_torque[*] file swing.txt format " %.15g"',
            ],
            turning_drag=0.0,
            **AWAY,
        )
        return out.rows("swing.txt").T

    _, sine, torque = swing("far", 1.2)
    np.testing.assert_allclose(torque, -k * sine, rtol=1e-9, atol=1e-9 * k)
    step_number, sine, _ = swing("near", 1e-3)
    phase = 0.02 * step_number
    np.testing.assert_allclose(sine, 1e-3 * np.cos(phase), atol=1e-3 * (1e-6 + phase[-1] * 0.02**2 / 24))


# --- dihedrals -------------------------------------------------------------------------------------------------------


def test_dihedrals_are_refused_on_straight_chains():
    with pytest.raises(InputError, match="straight") as refusal:
        planned({"model.level": "chain", "model.torsion": "dihedral"})
    assert refusal.value.key == "model.torsion"
    # and by the assembler for a bundle whose middle filament is straight, whatever asks for it
    plan, system = planned({"model.level": "chain"})
    with pytest.raises(InputError, match="straight chain"):
        assemble(system, replace(plan, torsion="dihedral"))


@pytest.mark.parametrize("hand", [1.0, -1.0])
def test_dihedrals_on_a_helix_keep_its_shape_and_the_energy(tmp_path, hand):
    """A helix bent by 83 mrad a bead is at rest as built; set swinging, it keeps its energy to 1 % over 20000 steps.

    Dihedrals need a step 11 times shorter than bending here; the plan's own is refused.
    """
    plan, one = planned(
        {"model.level": "chain", "assembly.length": f"{L} um", "ends.tension": "0 nN", "model.axial_softening": 1.0}
    )
    plan = moved(replace(plan, torsion="dihedral"), 1e-9, 20000)
    spec = BundleSpec(one.types[0], np.array([[28.0, 0.0]]), plan.beads.stations, twist=hand / L)
    system = build_bundle(spec, np.random.default_rng(0))
    assert np.min(rest_bends(system)) > 0.08
    with pytest.raises(InputError, match="dihedrals on filaments bent by"):
        assemble(system, plan)
    plan = replace(plan, timestep=2e-5)
    energy = [
        "variable energy equal c_kinetic+c_stored",
        'fix energy all ave/time 100 1 100 v_energy file energy.txt format " %.15g"',
    ]
    still = run(tmp_path / "still", system, plan, energy, drag=0.0, **AWAY)
    kick = ["group middle id 20", "velocity middle set 0 0.5 0.5", *energy]
    swung = run(tmp_path / "swung", system, plan, kick, drag=0.0, **AWAY)
    start, *later = swung.rows("energy.txt")[:, 1]
    assert np.all(np.abs(np.array(later) / start - 1) < 0.01)
    assert np.max(still.rows("energy.txt")[:, 1]) < 1e-9 * start
