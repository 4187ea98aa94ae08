"""Tow compaction tests, synthetic: pressure, strain, laws, zones, bands, and files as instruments write them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from towtest_records import LAW, Bench, record, sized, write_set, written

from cgfibre import towtest
from cgfibre.errors import InputError
from cgfibre.measure import towtest as measure
from cgfibre.measure.towtest import Geometry, find_zones, first_touch, fit_empirical_law, fit_fibre_beds, mean_curve
from cgfibre.mechanics.compaction_laws import AlignedBed, Conditions, FibreBed

AT = Conditions(1.5, 0.26, 10)
QUIET = Bench(noise=0.0, specimen=0.0, offset=0.0)
DESIGN = [
    Conditions(n, t, f) for n, t, f in [(1.5, 0.26, 10), (1.5, 0.55, 10), (3, 0.38, 50), (6, 0.43, 30), (12, 0.26, 10),
                                        (12, 0.55, 50), (12, 0.32, 20), (3, 0.49, 10)]
]  # fmt: skip


def rng(seed=0):
    return np.random.default_rng(seed)


def reduced(at=AT, bench=QUIET, touch="fit", seed=0, law=LAW):
    u, f, w = record(at, bench, rng(seed), law)
    return measure.reduce_test(1e3 * u, 1e9 * f, 1e3 * w, Geometry(1e3 * bench.anvil, 1e3 * bench.thickness, touch))


# --- one test ----------------------------------------------------------------------------------------------------


def test_pressure_is_that_on_the_measured_width():
    """12 N on 0.5 mm times the width at that sample, which has grown by Poisson's ratio (thesis 5.2)."""
    u, f = np.linspace(0, 100, 20), 1e9 * np.linspace(0, 12, 20)
    w = 900 * (1 + 0.2 * u / 200)
    t = measure.reduce_test(u, f, w, Geometry(500.0, 200.0))
    assert t.pressure[-1] == pytest.approx(12 / (0.5 * 0.9 * 1.1))
    assert t.strain[-1] == pytest.approx(0.5) and t.thickness[-1] == pytest.approx(100)
    assert t.poisson_ratio()[1:] == pytest.approx(np.full(19, 0.2)) and np.isnan(t.poisson_ratio()[0])


def test_the_law_comes_back_exactly_without_noise():
    t = reduced(bench=replace(QUIET, approach=0), touch="record")
    law = t.power_law()
    assert law.a == pytest.approx(LAW.coefficient(AT), rel=2e-3) and law.b == pytest.approx(LAW.b, rel=2e-3)
    # Eq 5-2 against the slopes of the record
    inside = slice(60, t.turn - 5)
    assert t.modulus()[inside] == pytest.approx(law.modulus(t.strain[inside]), rel=0.02)


def test_hysteresis_is_the_area_of_the_loop():
    t = reduced(touch="record", bench=replace(QUIET, approach=0, poisson=0.0))
    h = t.hysteresis()
    # loading: F ~ eps^(1/b) gives F u/(1 + 1/b); unloading by the part (1 - loss) of the way
    whole = t.force[t.turn - 1] * t.displacement[t.turn - 1] / (1 + 1 / LAW.b)
    assert h.loading == pytest.approx(whole, rel=2e-3)
    assert h.fraction == pytest.approx(QUIET.loss, abs=2e-3)


@pytest.mark.parametrize("seed", range(3))
def test_where_the_anvil_touches(seed):
    """Fitted, the touch gives the law back; out of the noise it comes late, and the exponent is a quarter too high."""
    bench = Bench(specimen=0.0)
    fitted, noise = (reduced(bench=bench, touch=t, seed=seed) for t in ("fit", "noise"))
    assert fitted.power_law().b == pytest.approx(LAW.b, rel=0.02)
    assert fitted.power_law().a == pytest.approx(LAW.coefficient(AT), rel=0.02)
    assert 1.15 < noise.power_law().b / LAW.b < 1.5
    # the zero of the load cell is found
    u, f, _ = record(AT, bench, rng(seed))
    assert first_touch(1e9 * f).offset == pytest.approx(0.02e9, rel=2e-3)
    # a force asked for is where the test begins
    t = measure.reduce_test(1e3 * u, 1e9 * f, 900.0, Geometry(500.0, 300.0, 1e8))
    assert t.force[0] <= 1e8 < t.force[1]


@pytest.mark.parametrize(
    ("change", "key"),
    [
        (lambda u, f, w: (u[:5], f[:5], w[:5]), "force"),
        (lambda u, f, w: (u, 0 * f, w), "force"),
        (lambda u, f, w: (u, -f, w), "force"),
        (lambda u, f, w: (np.tile(u, 2), np.concatenate([0.9 * f, f]), np.tile(w, 2)), "displacement"),
        (lambda u, f, w: (u[::-1], f, w), "displacement"),
        (lambda u, f, w: (u, f, 0 * w), "width"),
        (lambda u, f, w: (u, np.where(f == f.max(), np.nan, f), w), "force"),
        (lambda u, f, w: (3 * u, f, w), "initial_thickness"),
        (lambda u, f, w: (u[:-1], f, w[:-1]), "force"),
    ],
)
def test_bad_records_name_the_key(change, key):
    u, f, w = change(*(np.array(c) for c in record(AT, QUIET, rng())))
    with pytest.raises(InputError) as caught:
        measure.reduce_test(1e3 * u, 1e9 * f, 1e3 * w, Geometry(500.0, 300.0))
    assert caught.value.key == key and "\n" not in str(caught.value)


# --- zones -------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("breaks", "slopes"), [((), (0.23,)), ((0.5,), (0.5, 0.15)), ((0.1, 3.0), (0.6, 0.3, 0.12))])
@pytest.mark.parametrize("seed", range(3))
def test_zones_are_found(breaks, slopes, seed):
    p = np.geomspace(5e-3, 50, 200)
    y = slopes[0] * np.log(p / p[0])
    for at, before, after in zip(breaks, slopes[:-1], slopes[1:], strict=True):
        y += (after - before) * np.maximum(np.log(p / at), 0)
    eps = 0.02 * np.exp(y + 0.01 * rng(seed).standard_normal(len(p)))
    zones = find_zones(p, eps)
    assert len(zones.slopes) == len(slopes)
    assert zones.slopes == pytest.approx(slopes, abs=0.03)
    assert zones.breaks == pytest.approx(breaks, rel=0.35)
    assert np.all(np.abs(zones.slopes - slopes) < 5 * zones.slope_errors + 0.01)
    assert min(zones.bic, key=zones.bic.get) == len(slopes)
    for at, strain in zip(zones.breaks, zones.strains, strict=True):
        assert strain == pytest.approx(np.interp(at, p, eps), rel=0.03)
    assert len(find_zones(p, eps, most=1).slopes) == 1


# --- trials ------------------------------------------------------------------------------------------------------


def test_mean_and_band():
    tests = [reduced(bench=Bench(), seed=k) for k in range(4)]
    m = mean_curve(tests)
    at = float(m.pressure[30])
    each = [np.interp(at, t.pressure[: t.turn], t.strain[: t.turn]) for t in tests]
    assert m.strain[30] == pytest.approx(np.mean(each), rel=1e-6)
    assert m.half_width[30] == pytest.approx(3.182446 * np.std(each, ddof=1) / 2, rel=1e-5)  # t of 3, 95 %
    assert m.pressure[-1] == pytest.approx(min(t.pressure[t.turn - 1] for t in tests))
    assert np.all(np.isnan(mean_curve(tests[:1]).half_width))


@pytest.mark.validate
def test_the_band_covers():
    """Of 400 sets of three trials, 95 % of the bands hold the true strain (binomial: 93 to 97 %)."""
    held = 0
    for k in range(400):
        m = mean_curve([reduced(bench=Bench(noise=0.0), touch="fit", seed=1000 * k + i) for i in range(3)], points=5)
        held += abs(m.strain[3] - LAW.strain(m.pressure[3], AT)) < m.half_width[3]
    assert 0.925 < held / 400 < 0.975


# --- the law of a set --------------------------------------------------------------------------------------------


def set_of_tests(seed, design=DESIGN, trials=3):
    pairs = []
    for k, at in enumerate(design):
        pairs += [(reduced(at, sized(at), "fit", 100 * seed + 10 * k + i), at) for i in range(trials)]
    return [p[0] for p in pairs], [p[1] for p in pairs]


def test_the_empirical_law_is_fitted():
    fit = fit_empirical_law(*set_of_tests(1))
    found = np.array([np.log(fit.law.a0), fit.law.a1, fit.law.a2, fit.law.a3, fit.law.b])
    true = np.array([np.log(LAW.a0), LAW.a1, LAW.a2, LAW.a3, LAW.b])
    assert np.all(np.abs(found - true) < 4 * fit.errors + 1e-3)
    assert fit.errors == pytest.approx([0.03, 0.04, 0.006, 0.012, 0.0004], rel=1.0)
    assert fit.held == () and fit.n_tests == 24
    assert fit.rms == pytest.approx(0.03, rel=0.5)  # the specimens' scatter
    c = fit.correlation
    assert np.diag(c) == pytest.approx(np.ones(5)) and np.all(np.abs(c) <= 1 + 1e-12)
    # what is predicted, with its error
    at = Conditions(6, 0.3, 20)
    miss = fit.law.strain(3.0, at) / LAW.strain(3.0, at) - 1
    assert abs(miss) < 4 * fit.strain_error(3.0, at)[0] < 0.1


@pytest.mark.validate
def test_errors_are_those_of_repeated_sets():
    """The sandwich's standard errors against the scatter of 30 sets; independent samples would be 5 times too small."""
    fits = [fit_empirical_law(*set_of_tests(k)) for k in range(30)]
    found = np.array([[np.log(f.law.a0), f.law.a1, f.law.a2, f.law.a3] for f in fits])
    stated = np.sqrt(np.mean([f.errors[:4] ** 2 for f in fits], axis=0))
    assert found.std(axis=0, ddof=1) / stated == pytest.approx(np.ones(4), abs=0.4)


def test_what_the_tests_cannot_tell_is_held():
    twists = [Conditions(12, t, 10) for t in (0.26, 0.38, 0.55)]
    fit = fit_empirical_law(*set_of_tests(2, twists))
    assert fit.held == ("a2", "a3") and (fit.law.a2, fit.law.a3) == (0.4, 0.04)
    assert fit.law.a1 == pytest.approx(LAW.a1, abs=0.15) and fit.errors[2] == 0
    # together: tow and pre-load rise with the twist
    together = [Conditions(n, t, f) for n, t, f in ((3, 0.26, 10), (6, 1 - 0.74 * 0.8, 2 * 11 - 1))]
    assert fit_empirical_law(*set_of_tests(2, together)).held == ("a2", "a3")
    alone = fit_empirical_law(*set_of_tests(2, [AT]))
    assert alone.held == ("a1", "a2", "a3")
    assert alone.law.strain(5.0, AT) == pytest.approx(LAW.strain(5.0, AT), rel=0.08)


@pytest.mark.parametrize(
    ("law", "name"),
    [
        (FibreBed(80.0, 3.0, 0.25), "van Wyk"),
        (FibreBed(900.0, 9.0, 0.4), "Toll"),
        (AlignedBed(0.01, 0.45, 0.8), "Gutowski"),
    ],
)
def test_the_right_bed_wins(law, name):
    p = np.geomspace(0.01, 20, 80)
    v = law.volume_fraction(p) * np.exp(0.002 * rng(1).standard_normal(80))
    fits = fit_fibre_beds(p, v)
    assert fits[0].name == name and fits[0].rms < 0.003
    assert [f.aic for f in fits] == sorted(f.aic for f in fits)
    found = fits[0].law
    assert found.volume_fraction(5.0) == pytest.approx(law.volume_fraction(5.0), rel=2e-3)
    if name != "Gutowski":
        assert found.k == pytest.approx(law.k, rel=0.15) and found.V0 == pytest.approx(law.V0, rel=0.02)
    with pytest.raises(InputError, match="tow size"):
        fit_fibre_beds(p, 3 * v)


# --- files -------------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    """Two trials each of three conditions, as CSV, TSV and with decimal commas."""
    where = tmp_path_factory.mktemp("tests")
    return where, write_set(where, DESIGN[:2] + DESIGN[5:6], 2, rng(4))


def options(out, **change):
    return replace(towtest.TowOptions(out), **change)


def test_files_to_laws(folder, tmp_path):
    _, paths = folder
    result = towtest.analyse_tests(paths, options(tmp_path / "out", at=(1.0, 5.0)))
    assert all((tmp_path / "out" / name).stat().st_size > 0 for name in towtest.FILES)
    summary = json.loads((tmp_path / "out" / "summary.json").read_text())
    assert [c["n_tests"] for c in summary["conditions"]] == [2, 2, 2]
    for g, c in zip(result.groups, summary["conditions"], strict=True):
        assert c["power_law"]["b"] == pytest.approx(LAW.b, rel=0.03)
        assert c["poisson_ratio_at_peak"]["mean"] == pytest.approx(0.3, abs=0.03)
        assert c["hysteresis_loss"]["mean"] == pytest.approx(0.4, abs=0.03)
        for row in c["thickness"]:
            want = 1e3 * sized(g.conditions).thickness * (1 - LAW.strain(row["pressure_MPa"], g.conditions))
            assert row["measured_um"] == pytest.approx(want, rel=0.04)
            assert row["predicted_um"] == pytest.approx(want, rel=0.04)
            assert row["predicted_error_um"] > 0
    assert summary["empirical_law"]["held"] == ["a3"]  # of three conditions
    assert any("a3" in w for w in summary["warnings"])
    lines = (tmp_path / "out" / "tests.csv").read_text().splitlines()
    assert lines[0].startswith("file,tow_k,twist_per_cm") and len(lines) == 7
    text = "\n".join(towtest.report_lines(result))
    assert "law of all" in text and "modulus" in text


def test_gap_and_separate_widths(tmp_path):
    """A gauge that measures the gap, a table of widths from pictures, conditions by options."""
    u, f, w = record(AT, QUIET, rng())
    u = u - u[QUIET.approach]
    rows = "".join(f"{1e3 * (0.3 - a):.6f};{100 * b:.6f}\n" for a, b in zip(u, f, strict=True))
    (tmp_path / "a.txt").write_text("Gap (um);Load (cN)\n" + rows)
    picks = slice(QUIET.approach, QUIET.approach + QUIET.samples, 20)
    (tmp_path / "w.csv").write_text(
        "Gap (mm),Width (mm)\n" + "".join(f"{0.3 - a},{b}\n" for a, b in zip(u[picks], w[picks], strict=True))
    )
    opts = options(
        tmp_path / "out", thickness=300.0, widths=(tmp_path / "w.csv",), tow=(1.5,), twist=(0.26,), preload=(10.0,)
    )
    (g,) = towtest.analyse_tests([tmp_path / "a.txt"], opts).groups
    assert g.law.b == pytest.approx(LAW.b, rel=0.01) and g.conditions == AT
    assert g.specimens[0].width_varies and np.all(np.isnan(g.mean.half_width))
    # without anything known but the width
    opts = options(tmp_path / "bare", width=900.0)
    bare = towtest.analyse_tests([tmp_path / "a.txt"], opts)
    assert bare.law is None and bare.groups[0].name == "tests"


@pytest.mark.parametrize(
    ("text", "part"),
    [
        ("", "empty"),
        ("Displacement (mm),Force (N)\n0,0\n", "thickness"),
        ("Initial thickness: 0.3 mm\nDisplacement (mm),Force (N)\n0,0\n", "width"),
        ("Width: 0.9 mm\nInitial thickness: 0.3 mm\nDisplacement (mm),Force (N)\n0,0\n", "at least"),
        ("Time (s),Force (N)\n0,0\n1,1\n", "displacement"),
        ("Displacement (mm),Time (s)\n0,0\n1,1\n", "force"),
        ("Displacement (mm),Force (MPa)\n0,0\n1,1\n", "unit"),
        ("Displacement (N),Force (N)\n0,0\n1,1\n", "unit"),
        ("Twist: 0.3 turn/cm\nWidth: 1 mm\nInitial thickness: 0.3 mm\n" + "u (mm),F (N)\n", "Twist"),
    ],
)
def test_bad_files_give_one_line_and_write_nothing(text, part, tmp_path):
    (tmp_path / "bad.csv").write_text(text)
    with pytest.raises(InputError) as caught:
        towtest.analyse_tests([tmp_path / "bad.csv"], options(tmp_path / "out"))
    assert part.lower() in str(caught.value).lower() and "\n" not in str(caught.value)
    assert not (tmp_path / "out").exists()


def test_half_stated_conditions_are_asked_for(tmp_path):
    text = written(AT, QUIET, record(AT, QUIET, rng())).replace("Twist: 0.26 turn/cm\n", "")
    (tmp_path / "a.csv").write_text(text)
    with pytest.raises(InputError) as caught:
        towtest.analyse_tests([tmp_path / "a.csv"], options(tmp_path / "out"))
    assert caught.value.key == "--twist"
    with pytest.raises(InputError) as caught:
        towtest.analyse_tests([tmp_path / "a.csv"] * 3, options(tmp_path / "out", twist=(0.2, 0.3)))
    assert caught.value.key == "--twist" and "3 files" in caught.value.expected


def test_text_of_the_command_line(tmp_path):
    read = towtest.options_from_text(
        tmp_path,
        {"anvil": "0.5 mm", "tow": ("12k", "1500"), "twist": ("0.26 turn/cm",), "pre-load": ("0.1 N",),
         "at": ("2 bar",), "window": "0.1 MPa:20 MPa", "columns": "gap, load", "touch": "5 mN",
         "filament-diameter": "6 um"},
    )  # fmt: skip
    assert (read.anvil, read.tow, read.preload) == (500.0, (12.0, 1.5), (10.0,))
    assert read.twist == pytest.approx((0.26,)) and read.window == pytest.approx((0.1, 20.0))
    assert read.columns == ("gap", "load") and read.touch == 5e6 and read.diameter == 6.0
    assert read.at == pytest.approx((0.2,))
    for texts, key in (
        ({"tow": ("many",)}, "--tow"),
        ({"window": "3 MPa"}, "--window"),
        ({"window": "3 MPa:1 MPa"}, "--window"),
        ({"touch": "soon"}, "--touch"),
        ({"anvil": "5"}, "--anvil"),
    ):
        with pytest.raises(InputError) as caught:
            towtest.options_from_text(tmp_path, texts)
        assert caught.value.key == key


def test_the_verb(cgfibre, folder, tmp_path):
    done = cgfibre("towtest", *folder[1], "--out", tmp_path / "t", "--at", "1 MPa")
    assert done.returncode == 0, done.stderr
    assert "law of all" in done.stdout and (tmp_path / "t" / "laws.png").exists()
