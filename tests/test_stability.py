"""Maps of limits: measured limits lie at their closed forms; the verb writes tables and pictures and goes on."""

import csv
import math
from dataclasses import replace

import numpy as np
import pytest

from cgfibre import stability, store
from cgfibre.cases import limits, pitfalls, touching
from cgfibre.cases.limits import Bench
from cgfibre.engine.assemble import assemble
from cgfibre.errors import EngineError, InputError
from cgfibre.mechanics import rod


@pytest.fixture
def bench(tmp_path):
    return Bench(tmp_path)


def near(points, rel):
    """All points lie within ``rel`` of their prediction."""
    points = list(points)
    assert points
    for p in points:
        assert p.measured == pytest.approx(p.predicted, rel=rel), p
    return points


# --- bisection and closed forms --------------------------------------------------------------------------------------


@pytest.mark.parametrize("limit", [0.3, 1.0, 17.0])
def test_bisection_finds_a_limit_wherever_its_guess_was(limit):
    assert limits.bisect(lambda x: x < limit, 1.0, within=1e-3) == pytest.approx(limit, rel=1e-3)


def test_bisection_without_a_limit_says_so():
    assert math.isnan(limits.bisect(lambda x: True, 1.0))
    assert math.isnan(limits.bisect(lambda x: False, 1.0))


@pytest.mark.parametrize("zeta", [0.0, 0.3, 1.0, 4.0])
def test_the_damped_limit_is_where_the_scheme_of_the_engine_starts_to_grow(zeta):
    """Roots of velocity-Verlet with the force at the half step's velocity, just below and just above the limit."""
    omega = 3.0
    h = float(rod.damped_time_step(omega**2, 2 * zeta * omega))
    assert h == pytest.approx(2 / omega * (math.sqrt(1 + zeta**2) - zeta))

    def growth(step):
        c = 2 * zeta * omega
        return max(abs(np.roots([1, -(2 - c * step - (omega * step) ** 2), 1 - c * step])))

    assert growth(0.999 * h) <= 1 + 1e-12
    assert growth(1.001 * h) > 1


def test_the_barrier_of_crossing_chains_is_that_of_four_beads():
    """Closed form against the sum over all pairs; none from s = sqrt(2) D on."""
    z = np.linspace(1e-3, 7.0, 20000)
    for ratio in (0.65, 1.0, 1.3):
        found = np.max(touching.crossing_force(z, ratio * 7.0, 7.0))
        assert found == pytest.approx(touching.crossing_barrier(ratio * 7.0, 7.0), rel=1e-6)
    assert touching.crossing_barrier(math.sqrt(2) * 7.0, 7.0) == pytest.approx(0, abs=1e-12)
    assert touching.crossing_barrier(3.5, 7.0) > touching.crossing_barrier(7.0, 7.0)


# --- limits of the time step -----------------------------------------------------------------------------------------


def test_the_time_step_limit_of_a_filament_is_two_over_omega(bench):
    """Within the bisection's 0.4 % and the 0.3 % that twenty segments lack; the plan's own step, with contacts, is
    below it."""
    for p in near(limits.step_against_spacing(bench, (1.0,)), 0.007):
        assert 0.4 * p.predicted < p.used < 0.9 * p.predicted


def test_softening_beyond_the_balance_with_bending_gains_nothing(bench):
    """s = D: EA s^2/(4 EI) = 4."""
    points = near(limits.step_against_softening(bench, (4.0, 30.0), [("chain", 1.0)]), 0.007)
    assert points[0].predicted == pytest.approx(points[1].predicted, rel=1e-6)


def test_damping_of_contacts_shortens_the_step_as_predicted(bench):
    """Discs in a cage, sticking: 1 % for the bisection and the cage's finite size, 2 % where modes are overdamped."""
    trials = [limits.caged("section", 10, 10.0, ratio) for ratio in (1e-6, 0.3)]
    found = [t.limit(bench, limits.caged_step(t)) for t in trials]
    for trial, limit in zip(trials, found, strict=True):
        assert limit == pytest.approx(limits.caged_step(trial), rel=0.02)
    assert found[1] < 0.8 * found[0]


def test_thick_rods_are_damped_as_thin_ones(bench):
    """The deck divides rolling damping by the bond's length: in units of D nothing depends on D."""
    thin, thick = near(pitfalls.step_against_rod_damping(bench, (0.2,)), 0.012)
    assert thick.measured / thin.measured == pytest.approx(300 / 7, rel=0.006)


def test_dihedrals_on_straighter_chains_want_shorter_steps(bench):
    """64 GJ/(s^3 theta^2 m), within 6 % (ends); the plan's own step is far above, and the assembler refuses it."""
    (p,) = near(pitfalls.dihedral_against_bend(bench, (0.55,)), 0.06)
    assert p.used > 5 * p.measured


# --- others ----------------------------------------------------------------------------------------------------------


def test_crossing_filaments_pass_at_the_force_of_the_closed_form(bench):
    """1e-4: steps of the push and damping; proportional to the stiffness; nothing resists at s = 1.5 D."""
    near(touching.passing_against_spacing(bench, (0.5, 1.0)), 1e-4)
    soft = touching.passing_force(bench, 7.0, 10.0)
    assert soft[0] == pytest.approx(touching.passing_force(bench, 7.0, 1.0)[0] / 10, rel=1e-4)
    (free,) = touching.passing_against_spacing(bench, (1.5,))
    assert free.measured == 0


def test_overlap_and_what_it_takes_from_the_thickness(bench):
    near(touching.overlap_against_softening(bench, (10.0,), (1e5,)), 1e-4)
    soft, hard = touching.thickness_error_against_load(bench, (10.0, 1.0), (1e5,))
    near([soft, hard], 1e-3)
    assert soft.measured > 0.02 > hard.measured


def test_friction_along_beads_peaks_as_their_slope_says(bench):
    """2 %: the load's own dent and its damping."""
    near(touching.ripple_against_spacing(bench, (1.0,)), 0.02)


def test_angle_harmonic_has_no_stiffness_on_a_straight_chain(bench):
    """Cosine and harmonic by their closed forms; harmonic at 1e-5 rad is a hundred times too soft."""
    points = near(pitfalls.hinge_against_bend(bench, (1e-5, 0.1)), 1e-4)
    assert [p.measured for p in points if p.parameter < 1e-4] == pytest.approx([1.0, 0.01], rel=1e-3)


def test_a_rod_along_z_loses_its_torsion_and_is_refused(bench):
    points = {(p.series, p.parameter): p.measured for p in pitfalls.torsion_against_tilt(bench, (1e-16, 1e-9))}
    assert points.pop(("tags rising along +z", 1e-16)) == 0
    assert list(points.values()) == pytest.approx([1.0] * 3, rel=1e-9)
    plan, system = pitfalls.straight("rod", 8)
    along = system.positions[:, 0]
    upright = np.column_stack([0 * along, 0 * along, along])
    box = np.array([[-90.0, 90.0]] * 3)
    with pytest.raises(InputError, match=r"along \+z"):
        assemble(replace(system, positions=upright, box=box), plan)
    assemble(replace(system, positions=-upright, box=box), plan)


def test_bending_is_right_to_pi_and_twist_to_two_pi(bench):
    found = {(p.series, p.parameter): p.measured for p in pitfalls.torsion_against_turn(bench, (3.1, 3.2, 6.4))}
    assert found["twist", 3.2] == pytest.approx(3.2, rel=1e-9)
    assert found["twist", 6.4] == pytest.approx(6.4 - 4 * math.pi, rel=1e-9)
    assert found["bending", 3.1] == pytest.approx(3.1, rel=1e-9)
    assert found["bending", 3.2] == pytest.approx(3.2 - 2 * math.pi, rel=1e-9)


def test_only_exclusion_keeps_a_filament_from_touching_itself(bench):
    wrong, right = near(pitfalls.axial_against_contact(bench, (55.0,)), 1e-3)
    assert wrong.measured > 2 and right.measured == pytest.approx(1, rel=1e-3)


def test_tension_built_in_sets_nothing_in_motion(bench):
    """Sudden: half of the load's work (2 %: forty beads); built in: nothing but rounding."""
    sudden, built = pitfalls.kinetic_against_tension(bench, (4e5,))
    assert sudden.measured == pytest.approx(0.5, rel=0.02)
    assert built.measured < 1e-12


def test_ghosts_must_reach_as_far_as_bonds_and_the_deck_lets_them(bench):
    """On two ranks; within the bisection's 2 %."""
    for level, at_bead in (("chain", True), ("rod", True)):
        exact = 28.0 * (2 if level == "rod" else 1)
        found, silent = pitfalls.Shared(level, 28.0, at_bead).least_cutoff(bench, exact)
        assert found == pytest.approx(exact, rel=0.02)
        assert silent == 0
        plan, system = pitfalls.straight(level, 20, 28.0)
        assert assemble(system, plan).parameters["ghost_cutoff_um"] > 1.2 * found


# --- the verb --------------------------------------------------------------------------------------------------------

QUICK = ("hinge-bend", "start-tension")


def few(monkeypatch):
    """The quick maps with few points, and a list of the maps that were measured."""
    measured = []

    def wrapped(chart, points):
        def run(bench):
            measured.append(chart.name)
            return points(bench)

        return replace(chart, points=run)

    maps = {m.name: m for m in stability.MAPS}
    shorter = (
        wrapped(maps["hinge-bend"], lambda bench: pitfalls.hinge_against_bend(bench, (1e-4, 0.1))),
        wrapped(maps["start-tension"], lambda bench: pitfalls.kinetic_against_tension(bench, (4e5,))),
    )
    monkeypatch.setattr(stability, "MAPS", shorter)
    return measured


def test_maps_are_kept_and_a_later_call_goes_on(tmp_path, monkeypatch):
    measured = few(monkeypatch)
    out = tmp_path / "maps"
    whole = stability.MAPS

    def broken(bench):
        raise EngineError("killed", "again")

    monkeypatch.setattr(stability, "MAPS", (whole[0], replace(whole[1], points=broken)))
    with pytest.raises(EngineError):
        stability.find_limits(out)
    assert measured == ["hinge-bend"]
    monkeypatch.setattr(stability, "MAPS", whole)
    found = stability.find_limits(out)
    assert measured == ["hinge-bend", "start-tension"]
    assert [f.map.name for f in found] == list(QUICK)
    # in the tables as found, and once more by the file alone
    again = stability.find_limits(out)
    assert measured == ["hinge-bend", "start-tension"]
    for f, g in zip(found, again, strict=True):
        np.testing.assert_array_equal([p.measured for p in f.points], [p.measured for p in g.points])
        assert [p.series for p in f.points] == [p.series for p in g.points]
    with (out / "stability.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [r["map"] for r in rows] == ["hinge-bend"] * 4 + ["start-tension"] * 2
    assert float(rows[0]["measured"]) == pytest.approx(found[0].points[0].measured, rel=1e-9)
    tables = {t.name: t for t in store.read_tables(out / "stability.h5")}
    assert tables["start-tension"].columns["parameter"][1] == "cN"
    assert (out / "stability-hinge-bend.png").stat().st_size > 10000
    stability.find_limits(out, ["hinge-bend"], force=True)
    assert measured[2:] == ["hinge-bend"]


def test_an_unknown_map_is_one_line(cgfibre, tmp_path):
    done = cgfibre("stability", "--out", tmp_path / "maps", "--map", "nothing")
    assert done.returncode == 2
    assert "--map" in done.stderr and "step-spacing" in done.stderr and done.stderr.count("\n") == 1
    assert not (tmp_path / "maps").exists()


def test_the_verb_measures_a_map_and_says_where_it_lies(cgfibre, tmp_path):
    done = cgfibre("stability", "--out", tmp_path / "maps", "--map", "start-tension")
    assert done.returncode == 0, done.stderr
    assert "start-tension" in done.stdout and "stability.csv" in done.stdout
    assert {p.name for p in (tmp_path / "maps").iterdir()} == {
        "stability.csv",
        "stability.h5",
        "stability-start-tension.png",
    }


# --- long ------------------------------------------------------------------------------------------------------------


@pytest.mark.validate
@pytest.mark.parametrize(
    ("name", "rel"),
    [
        ("step-spacing", 0.008),
        ("step-softening", 0.008),
        ("step-contact", 0.05),
        ("step-damping", 0.21),
        ("step-rod-damping", 0.012),
        ("step-dihedral", 0.06),
        ("step-materials", 0.008),
        ("deflection-materials", 2e-4),
        ("passing-softening", 1e-3),
        ("overlap-softening", 1e-3),
        ("friction-spacing", 0.03),
        ("ghosts-spacing", 0.02),
    ],
)
def test_whole_maps_lie_at_their_closed_forms(bench, name, rel):
    """step-damping: the cage's own filaments do not spin, so the spinning mode of the 19 inside it has 0.906 of an
    endless packing's damping ((6 + highest eigenvalue of who touches whom)/12): the limit is up to 10.4 % longer.
    Chains whose bending and contacts count alike damp their stiffest mode less than that of contacts alone: up to 20 %
    longer, on the safe side.
    """
    (chart,) = stability.find_maps([name])
    points = [p for p in chart.points(bench) if p.predicted > 1e-12]
    near(points, rel)
    if name == "step-damping":
        assert min(p.measured / p.predicted for p in points) > 0.95


@pytest.mark.validate
def test_the_error_of_speed_falls_with_the_speed(bench):
    """Faster than the plan's bound, which is linear: at 0.5 m/s it says what is measured to a factor of 1.5."""
    points = list(pitfalls.force_against_speed(bench, (4.0, 2.0, 1.0, 0.5)))
    errors = [p.measured for p in points]
    assert errors == sorted(errors, reverse=True)
    assert points[-1].measured < 1.5 * points[-1].predicted
