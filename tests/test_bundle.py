"""Bundles: derived quantities, helices, prestrain, migration, jitter, seeds."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from cgfibre.build import curves
from cgfibre.build.bundle import BundleSpec, build_bundle, build_section, filament_type, jittered
from cgfibre.build.curves import MigrationSpec
from cgfibre.build.packing import ArrangementSpec, circular, hexagonal, min_distance, random_packing
from cgfibre.build.spacing import SpacingSpec
from cgfibre.build.system import FilamentSystem
from cgfibre.errors import InputError

D, P = 7.0, 8.028
CARBON = filament_type(D, 2.3e8, 2.73e7, 1.8)
RINGS = ArrangementSpec("circular", 37, pitch=P)
TWIST = 1.0 / 2000.0  # a turn in 2 mm


def rng(seed=1):
    return np.random.default_rng(seed)


def bundle(seed=1, **change):
    return build_bundle(
        BundleSpec(**({"filament": CARBON, "section": RINGS, "stations": SpacingSpec(700.0, D)} | change)), rng(seed)
    )


def paths(system):
    return system.positions.reshape(system.n_filaments, -1, 3)


def test_filament_constants():
    """Carbon by the thesis: EA 8.851 N, EI 2.711e-5 N mm2, GJ 6.435e-6 N mm2, GA 1.05 N."""
    assert pytest.approx(8.851e9, rel=1e-4) == CARBON.EA
    assert pytest.approx(2.711e10, rel=1e-4) == CARBON.EI
    assert pytest.approx(6.435e9, rel=1e-3) == CARBON.GJ
    assert CARBON.kGA / 0.9 == pytest.approx(1.05e9, rel=1e-3)
    assert CARBON.mass_per_length == pytest.approx(1.8 * np.pi * 49 / 4)
    with pytest.raises(InputError, match=r"filament\.E1"):
        filament_type(D, 0.0, 1.0, 1.0)


def chain(beads, closed):
    n = len(beads)
    start = np.concatenate([[0], np.cumsum(beads)])
    x = np.arange(start[-1], dtype=float)
    return FilamentSystem(
        np.column_stack([x, np.zeros_like(x), np.zeros_like(x)]),
        start,
        np.array(closed),
        np.zeros(n, int),
        np.zeros(n, int),
        (CARBON,),
        np.array([[0.0, 100.0]] * 3),
        np.zeros(3, bool),
        np.zeros(n),
    )


def naive(beads, closed, width):
    """Every run of ``width`` beads along each filament, by hand; order does not matter."""
    found, first = set(), 0
    for n, loop in zip(beads, closed, strict=True):
        for i in range(n if loop else n - width + 1):
            found.add(tuple(first + (i + k) % n for k in range(width)))
        first += n
    return found


@settings(max_examples=60, deadline=None)
@given(st.lists(st.tuples(st.integers(1, 8), st.booleans()), min_size=1, max_size=5))
def test_bonds_angles_dihedrals(filaments):
    beads = [n for n, _ in filaments]
    closed = [c and n >= 4 for n, c in filaments]
    system = chain(beads, closed)
    for got, width in ((system.bonds(), 2), (system.angles(), 3), (system.dihedrals(), 4)):
        rows = [tuple(r) for r in got.tolist()]
        assert len(rows) == len(set(rows))
        assert set(rows) == naive(beads, closed, width)
    np.testing.assert_array_equal(system.filament_of_bead, np.repeat(np.arange(len(beads)), beads))


def test_tributary_lengths_of_an_open_filament():
    system = bundle(stations=np.array([0.0, 4.0, 10.0, 20.0]), section=np.zeros((1, 2)))
    np.testing.assert_allclose(system.tributary_lengths(), [2.0, 5.0, 8.0, 5.0])


def test_closed_filament_across_a_periodic_box():
    system = chain([100], [True])
    system = FilamentSystem(**{**vars(system), "periodic": np.array([True, False, False])})
    np.testing.assert_allclose(system.bond_lengths(), 1.0)
    np.testing.assert_allclose(system.tributary_lengths(), 1.0)


def test_straight_bundle():
    system = bundle(tow=3)
    assert (system.n_filaments, system.n_beads) == (37, 37 * 101)
    p = paths(system)
    np.testing.assert_array_equal(p[:, :, 1:], np.broadcast_to(circular(37, P)[:, None], (37, 101, 2)))
    np.testing.assert_allclose(p[:, :, 0], np.broadcast_to(np.linspace(0, 700, 101), (37, 101)))
    assert np.all(system.prestrain == 0.0) and np.all(system.tow == 3) and not system.closed.any()
    assert system.tributary_lengths().sum() == pytest.approx(37 * 700.0)


def test_box_leaves_room_for_a_flat_layer():
    for system in (bundle(), build_section(BundleSpec(CARBON, RINGS), rng())):
        low, high = system.positions.min(axis=0), system.positions.max(axis=0)
        assert np.all(system.box[:, 0] <= low - 1.5 * D) and np.all(system.box[:, 1] >= high + 1.5 * D)
        width = high[1] - low[1] + D
        assert system.box[1, 1] - system.box[1, 0] == pytest.approx(min(37 * D, 4 * width) + 2 * D)
    two = bundle(section=np.array([[0.0, 0.0], [0.0, D]]))
    assert two.box[1, 1] - two.box[1, 0] >= 2 * D
    assert bundle(box_half_width=500.0).box[1].tolist() == pytest.approx([-500.0, 500.0], abs=1.0)


@pytest.mark.parametrize("sign", [1, -1])
def test_handedness(sign):
    """Positive is Z: with the axis upright, filaments in front rise to the right; torsion of the curve is positive."""
    system = bundle(section=np.array([[40.0, 0.0]]), twist=sign * TWIST)
    p = paths(system)[0]
    d1 = np.gradient(p, p[:, 0], axis=0)
    d2 = np.gradient(d1, p[:, 0], axis=0)
    d3 = np.gradient(d2, p[:, 0], axis=0)
    torsion = np.einsum("ij,ij->i", np.cross(d1, d2), d3)[5:-5]
    assert np.all(sign * torsion > 0.0)
    # seen from +y with x upright, right is +z (x cross y); the filament is in front at mid-length
    middle = len(p) // 2
    assert p[middle, 1] == pytest.approx(40.0)
    assert sign * (p[middle + 1, 2] - p[middle - 1, 2]) > 0.0


def test_helix_length_curvature_and_convergence():
    """Chord lengths and discrete curvature of the beads come to the helix' own as 1/s^2."""
    radius, errors = 40.0, []
    for s in (20.0, 10.0):
        system = bundle(section=np.array([[radius, 0.0]]), twist=TWIST, stations=SpacingSpec(2000.0, s))
        true = 2000.0 * np.hypot(1.0, 2 * np.pi * TWIST * radius)
        length = system.bond_lengths().sum()
        v = system.bond_vectors()
        u = v / np.linalg.norm(v, axis=1)[:, None]
        turn = 2 * np.arcsin(np.linalg.norm(np.diff(u, axis=0), axis=1) / 2)
        kappa = turn / system.tributary_lengths()[1:-1]
        w = 2 * np.pi * TWIST
        assert curves.helix_curvature(radius, TWIST) == pytest.approx(radius * w**2 / (1 + (radius * w) ** 2))
        np.testing.assert_allclose(kappa, curves.helix_curvature(radius, TWIST), rtol=1e-3)
        errors.append((true - length) / true)
    assert 0.0 < errors[1] < 1e-5
    assert errors[0] / errors[1] == pytest.approx(4.0, rel=0.01)


def test_twist_states():
    """Stress-free: no prestrain. Tensioned: cut to the bundle's length, prestrain sqrt(1 + (2 pi n R)^2) - 1."""
    free = bundle(twist=TWIST)
    tensioned = bundle(twist=TWIST, twist_state="tensioned")
    np.testing.assert_array_equal(free.positions, tensioned.positions)
    assert np.all(free.prestrain == 0.0)
    radius = P * np.repeat([0, 1, 2, 3], [1, 6, 12, 18])
    expected = np.sqrt(1 + (2 * np.pi * TWIST * radius) ** 2) - 1
    np.testing.assert_allclose(tensioned.prestrain, expected, rtol=1e-9, atol=1e-15)
    # natural length = built length / (1 + prestrain): every filament the bundle's own length, but for the chords
    built = tensioned.bond_lengths().reshape(37, -1).sum(axis=1)
    np.testing.assert_allclose(built / (1 + tensioned.prestrain), 700.0, rtol=1e-6)


def test_small_twist_keeps_its_prestrain():
    """0.26 turns/cm at 10 um: 1.3e-6, where 1 + x - 1 would lose ten figures."""
    a = 2 * np.pi * 2.6e-5 * 10.0
    assert curves.helix_stretch(10.0, 2.6e-5) == pytest.approx(a**2 / 2 - a**4 / 8, rel=1e-9)


def test_turn_keeps_distances_within_planes():
    p = paths(bundle(twist=TWIST))
    assert curves.largest_overlap(p, P + 1e-9) == pytest.approx(1e-9, abs=1e-10)
    assert curves.largest_overlap(p, D) == 0.0


def test_largest_overlap_against_all_pairs():
    p = rng().uniform(0, 30, (6, 9, 3))
    p[:, :, 0] = np.arange(9)
    d = np.linalg.norm(p[:, None, :, 1:] - p[None, :, :, 1:], axis=3)
    d[np.arange(6), np.arange(6)] = np.inf
    assert curves.largest_overlap(p, D) == pytest.approx(D - d.min())
    assert curves.largest_overlap(p[:1], D) == 0.0


def test_migration_radius():
    """Eq. 2-2: from Rmin to Rmax and back in one wavelength along x = h theta."""
    theta = np.linspace(0, 20 * np.pi, 2001)
    r = curves.migration_radius(theta, 10.0, 40.0, height=100.0, wavelength=500.0 * np.pi)
    assert r[0] == pytest.approx(10.0) and r.min() >= 10.0 - 1e-12
    at = 100.0 * theta
    assert r[np.argmin(np.abs(at - 250.0 * np.pi))] == pytest.approx(40.0)
    np.testing.assert_allclose(r[:1501], r[500:], atol=1e-9)
    with pytest.raises(InputError):
        curves.migration_radius(theta, 50.0, 40.0, 1.0, 1.0)


def test_exchange_law_keeps_the_radial_density():
    """At any x the target radii are spread as in the section; the cosine of Eq. 2-2 crowds its ends."""
    centres = random_packing(400, D, 0.6, rng())
    radius = np.hypot(*centres.T)
    order = np.argsort(radius)
    direction = np.empty(400)
    direction[order] = np.tile([1.0, -1.0], 200)
    target = curves.exchange_law(radius, direction, MigrationSpec(1000.0))
    np.testing.assert_allclose(target(0.0), radius, rtol=1e-9)
    for x in (130.0, 300.0, 500.0, 777.0):
        np.testing.assert_allclose(np.sort(target(x)), np.sort(radius), atol=0.05 * radius.max())
        assert np.abs(target(x) - radius).max() > 0.3 * radius.max()
    cosine = curves.cosine_law(radius, direction, MigrationSpec(1000.0, law="cosine"))
    np.testing.assert_allclose(cosine(0.0), radius, atol=1e-6)
    assert np.abs(np.sort(cosine(500.0)) - np.sort(radius)).max() > 0.2 * radius.max()


@pytest.mark.parametrize("law", ["exchange", "cosine"])
def test_migrating_bundle(law):
    spec = {"stations": SpacingSpec(2000.0, 5.0), "migration": MigrationSpec(2000.0, law), "twist_state": "tensioned"}
    system = bundle(**spec)
    p = paths(system)
    np.testing.assert_allclose(p[:, 200, 1:], circular(37, P), atol=1e-9)  # the section given stands at mid-length
    radius = np.hypot(p[:, :, 1], p[:, :, 2])
    assert np.ptp(radius, axis=1).mean() > 0.4 * 3 * P  # most of the outer radius is covered
    assert curves.largest_overlap(p, D) <= 0.02 * D
    assert system.provenance["measured"]["largest_overlap_um"] <= 0.02 * D
    if law == "exchange":
        rms = np.sqrt(np.mean(radius**2, axis=0))
        assert rms.max() / rms.min() < 1.15  # density kept
    built = system.bond_lengths().reshape(37, -1).sum(axis=1)
    np.testing.assert_allclose(built / 2000.0 - 1, system.prestrain, rtol=0.02)  # chords of 5 um: 0.5 %
    assert np.all(system.prestrain > 0.0)
    again, other = bundle(**spec), bundle(seed=2, **spec)
    np.testing.assert_array_equal(system.positions, again.positions)
    assert np.abs(system.positions - other.positions).max() > 1.0


def test_migration_that_does_not_fit_is_refused():
    touching = hexagonal(37, D)
    tight = MigrationSpec(60.0, planes_per_period=16, max_overlap=1e-3)
    with pytest.raises(InputError, match=r"migration\.period"):
        bundle(section=touching, migration=tight, stations=SpacingSpec(300.0, 2.0))


def test_arc_length_of_migration_with_twist_off_is_the_helix():
    """Filaments outside the migrating band stay on helices: arc length in closed form."""
    centres = np.array([[0.0, 0.0], [40.0, 0.0], [0.0, 40.0], [-80.0, 0.0]])
    result = curves.migrating(
        centres, np.linspace(0, 2000, 101), D, MigrationSpec(1000.0, inner=0.0, outer=0.1), TWIST, rng()
    )
    expected = 2000.0 * np.hypot(1.0, 2 * np.pi * TWIST * np.array([0.0, 40.0, 40.0, 80.0]))
    np.testing.assert_allclose(result.arc_lengths, expected, rtol=1e-9)


@settings(max_examples=30, deadline=None)
@given(st.integers(1, 120), st.floats(0.01, 6.0), st.sampled_from([D, 7.3, P]), st.integers(0, 2**32))
def test_jitter_never_overlaps(count, amplitude, pitch, seed):
    c = hexagonal(count, pitch)
    moved = jittered(c, amplitude, D, rng(seed))
    assert min_distance(moved) >= D * (1 - 1e-12)
    shift = np.hypot(*(moved - c).T)
    assert shift.max() <= amplitude
    if pitch - D > 2 * amplitude:
        assert np.all(shift > 0.0)  # room for every first draw


def test_jitter_fills_its_disc():
    """Uniform in the disc where there is room: mean square shift a^2/2, mean zero."""
    c = hexagonal(2000, 3 * D)
    shift = jittered(c, 0.4, D, rng()) - c
    assert np.mean(np.sum(shift**2, axis=1)) == pytest.approx(0.08, rel=0.06)
    np.testing.assert_allclose(shift.mean(axis=0), 0.0, atol=0.03)


def test_jitter_keeps_filaments_straight_and_is_the_seeds():
    a, b, c = bundle(1, jitter=0.4), bundle(1, jitter=0.4), bundle(2, jitter=0.4)
    np.testing.assert_array_equal(a.positions, b.positions)
    assert np.abs(a.positions - c.positions).max() > 0.05
    p = paths(a)
    assert np.all(np.ptp(p[:, :, 1:], axis=1) == 0.0)
    section = build_section(BundleSpec(CARBON, RINGS, jitter=0.4), rng(1))
    np.testing.assert_array_equal(section.positions[:, 1:], p[:, 0, 1:])


def test_section():
    system = build_section(BundleSpec(CARBON, RINGS), rng())
    assert system.n_beads == system.n_filaments == 37
    assert np.all(system.positions[:, 0] == 0.0)
    assert len(system.bonds()) == len(system.angles()) == len(system.dihedrals()) == 0
    assert np.all(system.tributary_lengths() == 0.0)


def test_provenance_is_json_and_holds_spec_and_seed():
    system = bundle(7, jitter=0.1, twist=TWIST, section=circular(7, P))
    p = json.loads(json.dumps(system.provenance))
    assert p["builder"] == "bundle" and p["seed"]["entropy"] == 7
    assert p["spec"]["twist"] == TWIST and p["spec"]["section"]["shape"] == [7, 2]
    assert p["measured"]["largest_turn_per_bond"] == pytest.approx(7.0 * TWIST)
    assert p["measured"]["largest_helix_angle_rad"] == pytest.approx(np.arctan(2 * np.pi * TWIST * P), rel=0.05)
    assert 0.03 < p["measured"]["jitter_rms_um"] < 0.1


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"stations": None}, "bundle.stations"),
        ({"stations": np.array([0.0, 2.0, 1.0])}, "bundle.stations"),
        ({"section": np.array([[0.0, 0.0], [6.9, 0.0]])}, "bundle.section"),
        ({"section": np.array([[0.0, np.nan]])}, "bundle.section"),
        ({"section": np.zeros((3, 3))}, "bundle.section"),
        ({"twist": float("inf")}, "bundle.twist"),
        ({"twist_state": "slack"}, "bundle.twist_state"),
        ({"jitter": -0.1}, "bundle.jitter"),
    ],
)
def test_bad_bundles_name_the_key(change, key):
    with pytest.raises(InputError) as error:
        bundle(**change)
    assert error.value.key == key


@pytest.mark.parametrize(
    ("change", "key"),
    [
        ({"period": 0.0}, "migration.period"),
        ({"law": "drift"}, "migration.law"),
        ({"inner": 0.7, "outer": 0.5}, "migration.inner, outer"),
        ({"max_overlap": 0.0}, "migration.max_overlap"),
        ({"planes_per_period": 4}, "migration.planes_per_period"),
    ],
)
def test_bad_migrations_name_the_key(change, key):
    with pytest.raises(InputError) as error:
        MigrationSpec(**({"period": 1000.0} | change))
    assert error.value.key == key
