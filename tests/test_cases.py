"""Every case of the verification suite against its closed form: short form here, the full grid by `make validate`."""

from dataclasses import replace

import numpy as np
import pytest

from cgfibre.cases import friction, invariants, rods, suite
from cgfibre.cases.experiment import Measured
from cgfibre.mechanics import rod

by_name = pytest.mark.parametrize("case", suite.CASES, ids=lambda case: case.name)


@by_name
def test_short_form(tmp_path, case):
    assert not suite.complaints(case, suite.measure(case, tmp_path, case.quick))


@pytest.mark.validate
@by_name
def test_full_grid(tmp_path, case):
    assert not suite.complaints(case, suite.measure(case, tmp_path))


def test_orders_and_limits_complain():
    """A wrong value, a wrong order and a nan are found."""
    case = next(c for c in suite.CASES if c.name == "elastica")
    good = [Measured("elastica", "chain", s, "deflection", "um", 1 + 5e-4 * s**2, 1.0, 0.0) for s in suite.SPACINGS]
    assert suite.complaints(case, good) == []
    assert suite.order_of(suite.SPACINGS, [m.error for m in good]) == pytest.approx(2)
    first_order = [replace(m, value=1 + 5e-4 * m.spacing) for m in good]
    assert ["order 1.000" in c for c in suite.complaints(case, first_order)].count(True) == 1
    assert len(suite.complaints(case, [replace(good[0], value=1.1)])) == 1
    assert len(suite.complaints(case, [replace(good[0], value=np.nan)])) == 1


def test_every_level_and_every_case_of_the_issue_is_there():
    names = " ".join(case.name for case in suite.CASES)
    for word in ("axial", "cantilever", "simply supported", "pre-tensioned", "elastica", "buckling", "frequency"):
        assert word in names
    for word in ("torsion", "helix", "curved rest", "capstan", "along", "across", "groove", "line contact", "crossing"):
        assert word in names
    assert {level for case in suite.CASES for level in case.levels} == {
        "chain",
        "rod",
        "section",
        "chain, capsules",
        "rod, capsules",
    }


# --- the closed forms of the cases themselves ------------------------------------------------------------------------


def test_elastica_meets_linear_theory_and_the_known_large_deflection():
    """Small loads: F L^3/(3 EI) and F L/kGA; F L^2/EI = 10: w/L = 0.81061, u/L = 0.55500 (Bisshopp, Drucker)."""
    assert rods.elastica_tip(1e-3, 1.0, 1.0)[1] == pytest.approx(1e-3 / 3, rel=1e-5)
    assert rods.elastica_tip(1e-3, 1.0, 1.0, kGA=10.0)[1] == pytest.approx(1e-3 / 3 + 1e-4, rel=1e-5)
    x, z = rods.elastica_tip(10.0, 1.0, 1.0)
    assert z == pytest.approx(0.81061, abs=1e-5) and 1 - x == pytest.approx(0.55500, abs=1e-5)


def test_discrete_beams_tend_to_the_beam():
    """Chain and rod matrices against platen_compliance, second order; without tension a rod is exact at any spacing."""
    f = rods.planned({})[1].types[0]
    for tension, at in ((0.0, 4), (4e6, 4), (4e6, 2)):
        width = 280.0 * (1 - 2 * at / 8)
        exact = {
            "chain": float(rod.platen_compliance(280.0, f.EI, width=width, tension=tension)),
            "rod": float(
                rod.platen_compliance(280.0, f.EI * (1 + tension / f.EA), width=width, tension=tension, kGA=f.kGA)
            ),
        }
        for fine in (1, 4):
            n, k, s = 8 * fine, at * fine, 280.0 / 8 / fine
            assert rods.chain_compliance(n, k, s, f.EI, tension) == pytest.approx(exact["chain"], rel=4e-2 / fine**2)
            error = rods.rod_compliance(n, k, s, f, tension) / exact["rod"] - 1
            assert abs(error) < (1e-9 if tension == 0 else 2e-2 / fine**2)


def test_curved_cantilever_of_a_quarter_circle():
    """Starts along x, ends along y: out of its plane (arms 1 - sin a of twist, cos a of bending), and along y."""
    f = replace(rods.planned({})[1].types[0], EA=1e30, kGA=1e30)
    R = 100.0
    out_of_plane = rods.curved_cantilever(rods.arc(R), np.pi / 2 * R, np.array([0.0, 0.0, 1.0]), f)
    bending, twist = np.pi / 4, 3 * np.pi / 4 - 2
    assert out_of_plane[2] == pytest.approx(R**3 * (bending / f.EI + twist / f.GJ), rel=1e-6)
    in_plane = rods.curved_cantilever(rods.arc(R), np.pi / 2 * R, np.array([0.0, 1.0, 0.0]), f)
    assert in_plane[1] == pytest.approx((3 * np.pi / 4 - 2) * R**3 / f.EI, rel=1e-6)


def test_bumps_and_pulleys_tend_to_smooth_ones():
    """Smooth filaments slide at mu; without friction a bead gives back downhill what it took uphill."""
    assert friction.mean_bump_friction(0.2, 1e-3, 7.0) == pytest.approx(0.2, rel=1e-6)
    assert friction.mean_bump_friction(0.0, 7.0, 7.0) == pytest.approx(0.0, abs=1e-12)
    pulley = friction.Pulley()
    assert pulley.ratio_of(10**4) == pytest.approx(pulley.ratio, rel=1e-8)
    assert [pulley.nodes(pulley.spacing(n)) for n in suite.CAPSTAN_NODES] == list(suite.CAPSTAN_NODES)


def test_energy_of_a_bent_rod():
    """Even curvature: EI kappa^2/2 a length, no shear; a stretch of e: EA e^2/2 a length."""
    f = rods.planned({})[1].types[0]
    a = np.linspace(0, 1e-3, 11)
    x, z, turn = 70e3 * np.sin(a), 70e3 * (1 - np.cos(a)), -a
    state = np.column_stack([x, z, np.cos(turn / 2), np.sin(turn / 2)])
    assert invariants.rod_energy(state, 7.0, f) == pytest.approx(f.EI / 70e3**2 / 2 * 70.0, rel=1e-4)
    straight = np.column_stack([7.007 * np.arange(11), np.zeros(11), np.ones(11), np.zeros(11)])
    assert invariants.rod_energy(straight, 7.0, f) == pytest.approx(f.EA * 1e-6 / 2 * 70.0, rel=1e-9)


def test_buckling_and_frequency_limits():
    """Stiff in shear and stretch: Euler and Euler-Bernoulli; shear alone: Engesser."""
    f = rods.planned({})[1].types[0]
    stiff = replace(f, EA=1e30, kGA=1e30)
    euler = float(rod.euler_buckling_load(280.0, f.EI))
    assert rods.buckling_load(280.0, stiff, 1e30) == pytest.approx(euler, rel=1e-9)
    assert rods.buckling_load(280.0, stiff, f.kGA) == pytest.approx(
        float(rod.timoshenko_buckling_load(280.0, f.EI, f.kGA)), rel=1e-9
    )
    slender = rods.timoshenko_frequency(28000.0, f)
    assert slender == pytest.approx(float(rod.bending_frequency(28000.0, f.EI, f.mass_per_length)), rel=1e-5)
