"""The empirical law of tow compaction and the laws of fibre beds: printed numbers, trends, inverses, limits."""

import numpy as np
import pytest

from cgfibre.errors import InputError
from cgfibre.measure.compaction import LABORATORIES, PowerLaw, compare_thickness
from cgfibre.mechanics.compaction_laws import (
    DEVIATION,
    THESIS_LAW,
    AlignedBed,
    Conditions,
    EmpiricalLaw,
    FibreBed,
    beyond_tests,
    most_anvil_pressure,
)

SOFT = Conditions(1.5, 0.26, 10)


def test_the_printed_constants():
    assert (THESIS_LAW.a0, THESIS_LAW.a1, THESIS_LAW.a2, THESIS_LAW.a3, THESIS_LAW.b) == (0.8, 0.7, 0.4, 0.04, 0.23)
    # Eq 5-4 by hand for 12k, 0.55 turns/cm, 50 cN at 10 MPa
    want = 0.8 * 0.45**0.7 * 12**-0.4 * 51**-0.04 * 10**0.23
    assert THESIS_LAW.strain(10.0, Conditions(12, 0.55, 50)) == pytest.approx(want)
    assert THESIS_LAW.strain(1.0, Conditions(1, 0, 0)) == pytest.approx(0.8)  # untwisted, without pre-load


@pytest.mark.parametrize("change", [{"twist": 0.55}, {"tow": 12}, {"preload": 50}])
def test_trends_of_chapter_5(change):
    """More twist, more filaments and more pre-load all give less strain, more pressure and a higher modulus."""
    other = Conditions(**{"tow": 1.5, "twist": 0.26, "preload": 10, **change})
    p = np.geomspace(0.01, 15, 9)
    assert np.all(THESIS_LAW.strain(p, other) < THESIS_LAW.strain(p, SOFT))
    eps = np.linspace(0.1, 0.8, 8)
    assert np.all(THESIS_LAW.pressure(eps, other) > THESIS_LAW.pressure(eps, SOFT))
    assert np.all(THESIS_LAW.modulus(eps, other) > THESIS_LAW.modulus(eps, SOFT))


def test_size_of_the_trends_beside_those_quoted():
    """The constants give the quoted trends in sign; in size they do not (see the errata in the docstring)."""
    law = THESIS_LAW
    assert law.pressure(0.8, Conditions(1.5, 0.55, 10)) / law.pressure(0.8, SOFT) == pytest.approx(4.54, abs=0.01)  # 3
    assert 1 - law.strain(50, Conditions(12, 0.26, 10)) / law.strain(50, SOFT) == pytest.approx(0.565, abs=1e-3)  # 0.4
    assert 1 - law.strain(20, Conditions(1.5, 0.26, 50)) / law.strain(20, SOFT) == pytest.approx(0.06, abs=1e-3)  # 0.12
    assert law.modulus(0.6, Conditions(12, 0.55, 50)) == pytest.approx(3517, rel=1e-3)  # 8 GPa
    assert law.pressure(1.0, SOFT) == pytest.approx(20.3, abs=0.05)  # quoted: tests to 50 MPa


def test_strain_pressure_modulus_thickness_agree():
    law, at = EmpiricalLaw(0.4, 0.6, 0.1, 0.02, 0.2), Conditions(6, 0.4, 30)
    p = np.geomspace(0.01, 20, 12)
    assert law.pressure(law.strain(p, at), at) == pytest.approx(p)
    same = PowerLaw(law.coefficient(at), law.b, 0, 0, (0, 1), 3, 1)
    assert law.modulus(0.3, at) == pytest.approx(same.modulus(0.3))
    h = 1e-6
    slope = (law.pressure(0.3 + h, at) - law.pressure(0.3 - h, at)) / (2 * h)
    assert law.modulus(0.3, at) == pytest.approx(slope, rel=1e-6)
    assert law.thickness(200.0, 3.0, at) == pytest.approx(200 * (1 - law.strain(3.0, at)))
    with pytest.raises(InputError) as caught:
        THESIS_LAW.thickness(180.0, 30.0, SOFT)
    assert caught.value.key == "pressure" and "20.26 MPa" in caught.value.expected


def test_van_wyk_and_toll():
    bed = FibreBed(k=50.0, n=3.0, V0=0.2)
    assert bed.pressure(0.5) == pytest.approx(50 * (0.125 - 0.008))  # van Wyk: K E (Vf^3 - V0^3)
    assert bed.pressure(0.1) == 0
    for n in (3.0, 5.0, 11.3):
        bed = FibreBed(50.0, n, 0.3)
        p = np.geomspace(1e-4, 30, 9)
        assert bed.pressure(bed.volume_fraction(p)) == pytest.approx(p, rel=1e-9)
        assert bed.volume_fraction(0.0) == pytest.approx(0.3)


def test_gutowski():
    bed = AlignedBed(A=0.02, V0=0.5, Va=0.8)
    v = 0.72
    want = 0.02 * (np.sqrt(v / 0.5) - 1) / (np.sqrt(0.8 / v) - 1) ** 4
    assert bed.pressure(v) == pytest.approx(want)
    p = np.concatenate([[0.0], np.geomspace(1e-6, 1e6, 20)])
    found = bed.volume_fraction(p)
    assert np.all(np.diff(found) > 0) and found[0] == pytest.approx(0.5) and found[-1] < 0.8
    assert bed.pressure(found[:-3]) == pytest.approx(p[:-3], rel=1e-6, abs=1e-12)
    assert bed.pressure(0.4) == 0


@pytest.mark.parametrize(
    ("call", "key"),
    [
        (lambda: Conditions(0, 0.2, 10), "tow"),
        (lambda: Conditions(12, 1.0, 10), "twist"),
        (lambda: Conditions(12, -0.1, 10), "twist"),
        (lambda: Conditions(12, 0.2, -1), "preload"),
        (lambda: EmpiricalLaw(a0=-1), "a0"),
        (lambda: EmpiricalLaw(b=0), "b"),
        (lambda: THESIS_LAW.strain(-1.0, SOFT), "pressure"),
        (lambda: FibreBed(0, 3, 0.2), "k"),
        (lambda: AlignedBed(1, 0.8, 0.7), "Va"),
        (lambda: AlignedBed(1, 0.5, 0.8).pressure(0.8), "volume_fraction"),
    ],
)
def test_bad_input_names_the_key(call, key):
    with pytest.raises(InputError) as caught:
        call()
    assert caught.value.key == key


def test_range_of_the_tests():
    assert beyond_tests(Conditions(12, 0.55, 50)) == () == beyond_tests(SOFT)
    (tow,) = beyond_tests(Conditions(0.127, 0.3, 20))
    assert tow == "tow 0.127 thousand filaments (tested 1.5 to 12)"
    assert len(beyond_tests(Conditions(24, 0.0, 60))) == 3
    # 12 N on 0.5 mm of a tow 6.5 mm wide, and of one that is round and solid
    assert most_anvil_pressure(6.5) == pytest.approx(3.69, abs=0.01)
    assert most_anvil_pressure(np.sqrt(12000) * 7e-3) == pytest.approx(31.3, abs=0.1)


def test_thickness_at_fixed_pressure_beside_the_law():
    at, p = Conditions(12, 0.26, 50), np.geomspace(1e-3, 50, 400)
    law = THESIS_LAW.thickness(70.0, p, at)
    grid = np.array([0.1, 1.0, 10.0, 100.0])
    # a tow that follows the law: the curve starts at a strain that is not zero, so its own start counts
    start = THESIS_LAW.thickness(1.0, p[0], at)
    same = compare_thickness(np.r_[70.0, law], np.r_[0.0, p], THESIS_LAW, at, grid)
    assert same.deviation[:3] == pytest.approx(0, abs=1e-4) and np.isnan(same.measured[3])
    assert same.within.tolist() == [True, True, True, False]
    late = compare_thickness(law, p, THESIS_LAW, at, grid[:3])
    assert late.deviation == pytest.approx(1 / start - 1, rel=1e-3)
    # the band: 8 % of the strain and 4 % of the thickness
    eps = THESIS_LAW.strain(1.0, at)
    assert same.low[1] == pytest.approx((1 - eps * (1 + DEVIATION)) * (1 - LABORATORIES))
    assert same.high[1] == pytest.approx((1 - eps * (1 - DEVIATION)) * (1 + LABORATORIES))
    assert not compare_thickness([1.0, 0.99], [0.0, 20.0], THESIS_LAW, at, [10.0]).within[0]
