"""Capsules on ranks, sorted, over joints and in odd places: what the cases of the suite (test_cases.py) do not ask."""

import numpy as np
import pytest
from capsule_bench import Box, forces_on

from cgfibre.cases import capsule_motion, experiment
from cgfibre.cases import capsule_ranks as ranks
from cgfibre.engine.lammps import find_engine
from cgfibre.engine.plugin import Build, build_plugin, sanitized
from cgfibre.errors import EngineError

levels = pytest.mark.parametrize("level", ["chain", "rod"])


@pytest.fixture(scope="module")
def one_rank(tmp_path_factory):
    """level: plan, system as pressed, outcome on one rank; computed once."""
    done = {}

    def of(level):
        if level not in done:
            done[level] = ranks.pressed(tmp_path_factory.mktemp(level) / "one", level, 1, steps=1600)
        return done[level]

    return of


def same_forces(tmp_path, one_rank, level, n):
    plan, pressed, _ = one_rank(level)
    for name, system in (("squeezed", ranks.squeezed(pressed)), ("pressed", pressed)):
        expected, rows = ranks.forces(tmp_path / f"{name}-1", system, plan, 1)
        found, others = ranks.forces(tmp_path / f"{name}-{n}", system, plan, n)
        assert len(rows) > 50 and np.max(np.abs(expected)) > 1e6
        assert np.allclose(found, expected, rtol=0, atol=1e-12 * np.max(np.abs(expected)))
        assert rows.shape == others.shape
        assert np.allclose(rows, others, rtol=1e-12, atol=1e-9)


@levels
def test_two_ranks_find_the_same_forces(tmp_path, one_rank, level):
    same_forces(tmp_path, one_rank, level, 2)


@pytest.mark.validate
@levels
def test_four_ranks_find_the_same_forces(tmp_path, one_rank, level):
    same_forces(tmp_path, one_rank, level, 4)


@levels
def test_two_ranks_press_to_the_same_curve(tmp_path, one_rank, level):
    """With friction on: histories go with their beads from rank to rank. Rounding is amplified by the contacts."""
    expected = one_rank(level)[2].record.mean["top_force"]
    found = ranks.pressed(tmp_path / "two", level, 2, steps=1600)[2].record.mean["top_force"]
    assert np.max(expected) > 1e5
    assert np.allclose(found, expected, rtol=1e-7, atol=1e-7 * np.max(expected))


@levels
@pytest.mark.parametrize("lanes", ["two", "four", "eight"])
def test_every_width_of_registers_finds_the_same_forces(tmp_path, monkeypatch, one_rank, level, lanes):
    """With stretched friction springs; what this processor has not got is refused by name."""
    plan, pressed, _ = one_rank(level)
    expected, rows = ranks.forces(tmp_path / "best", pressed, plan, 1)
    monkeypatch.setenv("CGFIBRE_LANES", lanes)
    try:
        found, others = ranks.forces(tmp_path / lanes, pressed, plan, 1)
    except EngineError as refused:
        assert lanes != "two" and f"CGFIBRE_LANES is {lanes}" in str(refused)
        return
    assert f"contacts by {lanes} a register" in (tmp_path / lanes / "log.lammps").read_text()
    assert np.allclose(found, expected, rtol=0, atol=1e-12 * np.max(np.abs(expected)))
    assert rows.shape == others.shape
    assert np.allclose(rows, others, rtol=1e-11, atol=1e-9)


@levels
def test_sorted_atoms_press_to_the_same_curve(tmp_path, one_rank, level):
    expected = one_rank(level)[2].record.mean["top_force"]
    sort = ["atom_modify sort 50 40.0"]
    found = ranks.pressed(tmp_path / "sorted", level, 1, sort, steps=1600)[2].record.mean["top_force"]
    assert np.allclose(found, expected, rtol=1e-7, atol=1e-7 * np.max(expected))


# --- odd places ------------------------------------------------------------------------------------------------------

D = 7.0


def unit(rng):
    v = rng.normal(size=3)
    return v / np.linalg.norm(v)


def turned(rng, way, angle):
    side = np.cross(way, unit(rng))
    return np.cos(angle) * way + np.sin(angle) * side / np.linalg.norm(side)


def odd_pair(rng):
    """Two segments: any, parallel, coincident, end to end, antiparallel, nearly parallel, of no length, interlocked."""
    lengths = 10 ** rng.uniform(-1.5, 2, 2) if rng.random() < 0.5 else np.full(2, 10 ** rng.uniform(0, 2))
    way, across = unit(rng), unit(rng)
    across -= way * (way @ across)
    across /= np.linalg.norm(across)
    gap = rng.choice([0.0, 1e-12, 1e-3, 0.5, 1.0 - 1e-9, 1.0, 1.0 - 1e-3]) * D
    kind = rng.integers(9)
    if kind == 0:  # any
        other, shift = unit(rng), rng.uniform(-5, 5, 3)
    elif kind == 1:  # parallel, in register, or aside
        other, shift = way, gap * across + rng.choice([0.0, 0.5, 0.999, 1.0]) * lengths[0] * way
    elif kind == 2:  # the same
        lengths[1] = lengths[0]
        other, shift = way, 0 * way
    elif kind == 3:  # end to end
        other, shift = rng.choice([1, -1]) * way, lengths[0] * way
    elif kind == 4:  # antiparallel
        other, shift = -way, lengths[0] * way * rng.uniform(0, 1) + gap * across
    elif kind == 5:  # tiny angles
        other, shift = turned(rng, way, 10 ** rng.uniform(-16, -3)), gap * across
    elif kind == 6:  # square, at an end, in the middle
        other, shift = across, rng.choice([0.0, 0.5, 1.0]) * lengths[0] * way + gap * np.cross(way, across)
    elif kind == 7:  # no length
        lengths[rng.integers(2)] = 0.0
        other, shift = unit(rng), gap * across
    else:  # deep in each other
        other, shift = unit(rng), rng.uniform(-0.05, 0.05, 3)
    return np.array([[0 * way, lengths[0] * way], [shift, shift + lengths[1] * other]])


def test_odd_pairs_have_finite_forces_that_add_up_to_nothing(tmp_path):
    """1000 pairs far from each other; neither force nor moment is left over."""
    rng = np.random.default_rng(1)
    side, cell = 10, 400.0
    places = cell * np.stack(np.meshgrid(*[np.arange(side)] * 3), axis=-1).reshape(-1, 3)
    pairs = [odd_pair(rng) for _ in places]
    filaments = [segment + place for pair, place in zip(pairs, places, strict=True) for segment in pair]
    box = Box(np.array([[-300.0, side * cell]] * 3))
    found = forces_on(tmp_path, filaments, box, reach=110.0)
    assert np.all(np.isfinite(found.forces)) and np.all(np.isfinite(found.rows))
    assert len(found.rows) > 400
    force = found.forces.reshape(-1, 4, 3)
    points = np.array(pairs).reshape(-1, 4, 3)
    size = np.max(np.abs(force), axis=(1, 2))
    assert np.all(np.abs(force.sum(axis=1)) <= 1e-13 * size[:, None] + 1e-12)
    moment = np.cross(points, force).sum(axis=1)
    assert np.all(np.abs(moment) <= 1e-9 * (size * (1 + np.max(np.abs(points), axis=(1, 2))))[:, None] + 1e-9)
    assert np.max(size) < 1e12


@pytest.mark.parametrize("sides", ["one", "both"])
def test_the_order_of_filaments_does_not_matter(tmp_path, sides):
    """Parallel and crossing segments of one length: the same push and moment in the other order; along the first of two
    that cross, its own stretch takes up to a hundredth where contacts are seen from one side."""
    rng = np.random.default_rng(2)
    filaments, box = [], Box(np.array([[-300.0, 40 * 300.0], [-300.0, 300.0], [-300.0, 300.0]]))
    for k in range(40):
        way, across = np.array([1.0, 0, 0]), np.array([0, 0, 1.0])
        other = turned(rng, way, 0.0 if k % 2 else rng.uniform(0.2, 1.5))
        other -= across * (other @ across)
        other /= np.linalg.norm(other)
        place = np.array([300.0 * k, 0, 0])
        first = place + 30 * np.array([-way, way])
        second = place + 0.98 * D * across + 30 * np.array([-other, other])
        filaments.append((first, second))
    one = forces_on(tmp_path / "one", [f for pair in filaments for f in pair], box, reach=65.0, sides=sides)
    two = forces_on(tmp_path / "two", [f for pair in filaments for f in pair[::-1]], box, reach=65.0, sides=sides)
    expected = one.forces.reshape(-1, 2, 2, 3)[:, ::-1].reshape(-1, 3)
    size = np.max(np.abs(expected))
    assert size > 1e5
    assert np.allclose(two.forces[:, 2], expected[:, 2], rtol=0, atol=1e-12 * size)
    assert np.allclose(two.forces, expected, rtol=0, atol=(1e-12 if sides == "both" else 1e-2) * size)
    parallel = np.arange(len(expected)) // 4 % 2 == 1
    assert np.allclose(two.forces[parallel], expected[parallel], rtol=0, atol=1e-12 * size)


def test_a_crossing_over_joints_is_alike_from_both_sides(tmp_path):
    """Two soft rods that cross where both have a bead: as wide as their contact is, neither is pressed at a point."""
    cross = np.array([[-20.0, 0, 0], [0, 0, 0], [20.0, 0, 0]])
    over = np.array([[0, -20.0, 5.0], [0, 0, 5.0], [0, 20.0, 5.0]])
    box = Box(np.array([[-100.0, 100.0]] * 3))
    way = np.array([1.0, 1.0, -1.0])  # the upper one, turned and from below, is the lower one
    for sides in ("one", "both"):
        found = forces_on(tmp_path / sides, [cross, over], box, reach=25.0, law="hooke 1e5", sides=sides)
        low, high = found.forces.reshape(2, 3, 3)
        assert high.sum(axis=0) == pytest.approx(-low.sum(axis=0), rel=1e-12, abs=1e-6)
        assert np.abs(low[0, 2]) > 0.02 * np.abs(low[1, 2])  # the lens reaches out to the neighbours
        alike = np.allclose(high[:, [1, 0, 2]] * way, low, rtol=0, atol=1e-12 * np.max(np.abs(low)))
        assert alike == (sides == "both")


@pytest.mark.parametrize("n", [1, 2])
def test_both_sides_of_a_tangle_are_the_mean_of_either_order(tmp_path, n):
    """On any number of ranks; a pair has a row from either segment."""
    edge = 350.0
    filaments = polylines(np.random.default_rng(7), 300, edge)
    box, of = Box(np.array([[0.0, edge]] * 3), True), {"reach": 100.0}
    one = forces_on(tmp_path / "one", filaments, box, **of)
    two = forces_on(tmp_path / "two", filaments[::-1], box, **of)
    both = forces_on(tmp_path / "both", filaments, box, n, **of, sides="both")
    bead = np.concatenate(np.split(np.arange(len(two.forces)), np.cumsum([len(f) for f in filaments[::-1]])[:-1])[::-1])
    expected = (one.forces + two.forces[bead]) / 2
    assert np.allclose(both.forces, expected, rtol=0, atol=1e-11 * np.max(np.abs(expected)))
    assert len(both.rows) == len(one.rows) + len(two.rows) > 100
    assert both.rows[:, 4].sum() == pytest.approx((one.rows[:, 4].sum() + two.rows[:, 4].sum()) / 2, rel=1e-12)


# --- the search ------------------------------------------------------------------------------------------------------


def polylines(rng, count, edge):
    """Filaments of one to five segments, 1 to 100 um long, softly bent."""
    out = []
    for _ in range(count):
        lengths = 10 ** rng.uniform(0, 2, rng.integers(1, 6))
        way, points = unit(rng), [rng.uniform(0, edge, 3)]
        for length in lengths:
            points.append(points[-1] + length * way)
            way = turned(rng, way, rng.uniform(0, 0.5))
        out.append(np.array(points))
    return out


def contacts_by_hand(filaments, edge, samples=400):
    """{(first bead of the one segment, of the other): touching length}, points of the segment of the lower molecule in
    the slab of the other; box periodic with ``edge`` (0: not)."""
    start = np.cumsum([1, *(len(f) for f in filaments)])
    shifts = edge * np.stack(np.meshgrid(*[[-1, 0, 1]] * 3), axis=-1).reshape(-1, 3) if edge else np.zeros((1, 3))
    s = (np.arange(samples) + 0.5) / samples
    segments = []  # first bead, molecule, from, to, plane before, plane after
    for m, (f, first) in enumerate(zip(filaments, start[:-1], strict=True)):
        t = np.diff(f, axis=0)
        t /= np.linalg.norm(t, axis=1)[:, None]
        for k in range(len(t)):
            before, after = t[k] + (t[k - 1] if k else 0), t[k] + (t[k + 1] if k + 1 < len(t) else 0)
            segments.append((first + k, m, f[k], f[k + 1], before, after))
    table = {}
    low = np.array([np.minimum(x[2], x[3]) for x in segments]) - D
    high = np.array([np.maximum(x[2], x[3]) for x in segments]) + D
    molecule = np.array([x[1] for x in segments])
    for tag, m, a, b, _, _ in segments:
        for shift in shifts:
            over = np.all((low + shift < np.maximum(a, b)) & (high + shift > np.minimum(a, b)), axis=1)
            for k in np.flatnonzero(over & (molecule > m)):
                other, _, p, q, before, after = segments[k]
                along = (q - p) / np.linalg.norm(q - p)
                w = a + s[:, None] * (b - a) - p - shift
                way = w - (w @ along)[:, None] * along
                inside = (np.linalg.norm(way, axis=1) < D) & (w @ before > 0) & ((w - (q - p)) @ after < 0)
                if np.any(inside):
                    table[tag, other] = table.get((tag, other), 0.0) + np.mean(inside) * np.linalg.norm(b - a)
    return table


@pytest.mark.parametrize(("periodic", "n"), [(False, 1), (True, 1), (True, 2)])
def test_every_contact_is_found_once(tmp_path, periodic, n):
    """Segments of lengths 1:100 at random, against all pairs by hand, with their lengths of contact."""
    rng = np.random.default_rng(3 + n)
    edge = 350.0
    filaments = polylines(rng, 400, edge)
    box = Box(np.array([[0.0, edge]] * 3) if periodic else np.array([[-600.0, 1000.0]] * 3), periodic)
    found = forces_on(tmp_path, filaments, box, n, reach=100.0)
    expected = contacts_by_hand(filaments, edge if periodic else 0.0)
    got = {(int(r[0]), int(r[1])): r[14] for r in found.rows}
    assert len(got) == len(found.rows) > 100
    for pair in set(got) | set(expected):
        # sampled at 400 points of a segment of 100 um at most: three steps
        assert abs(got.get(pair, 0.0) - expected.get(pair, 0.0)) < 0.8, (pair, got.get(pair), expected.get(pair))
    assert np.all(np.abs(found.forces.sum(axis=0)) < 1e-12 * np.max(np.abs(found.forces)) * len(found.forces))


# --- convergence -----------------------------------------------------------------------------------------------------


@pytest.mark.validate
@pytest.mark.parametrize("count", [7, 19])
def test_thickness_converges_with_the_spacing(tmp_path, count):
    """At the planner's longest segment, 4 D, within 1 % of what segments of D give; 8 D within 3 %."""
    forces = np.array([0.2e6, 0.4e6, 0.8e6, 1.6e6])
    of = {s: capsule_motion.thickness_at(tmp_path / f"{s:g}", s, forces, count) for s in (8.0, 4.0, 2.0, 1.0)}
    error = {s: np.abs(of[s] / of[1.0] - 1) for s in of}
    assert np.all(error[2.0] < 0.005) and np.all(error[4.0] < 0.01) and np.all(error[8.0] < 0.03)


# --- memory ----------------------------------------------------------------------------------------------------------


@pytest.mark.validate
@pytest.mark.parametrize("n", [1, 2])
def test_sanitizers_find_nothing(tmp_path_factory, tmp_path, monkeypatch, n):
    """Odd pairs, a search over periodic borders, a pressed bundle of chains and one of rods, compiled with the address
    and undefined-behaviour sanitizers."""
    plugin = built_with_sanitizers(tmp_path_factory)
    engine = sanitized(find_engine())
    monkeypatch.setattr(experiment, "find_engine", lambda: engine)
    rng = np.random.default_rng(4)
    box = Box(np.array([[0.0, 350.0]] * 3), True)
    forces_on(tmp_path / "search", polylines(rng, 100, 350.0), box, n, engine=engine, reach=100.0, plugin=plugin)
    pairs = [segment + 150 * k for k in range(100) for segment in odd_pair(rng)]
    box = Box(np.array([[-300.0, 16000.0]] * 3))
    forces_on(tmp_path / "odd", pairs, box, n, engine=engine, reach=110.0, plugin=plugin)
    for level in ("chain", "rod"):
        sort = ["atom_modify sort 50 40.0"] if level == "chain" else []
        _, _, out = ranks.pressed(tmp_path / level, level, n, sort, 400, plugin=plugin)
        assert len(out.record.mean["top_force"]) == 40
    for path in tmp_path.glob("*/engine.err"):
        assert "Sanitizer" not in path.read_text() and "runtime error" not in path.read_text()


def built_with_sanitizers(tmp_path_factory):
    """Library built with sanitizers, once a session; in a folder without blanks."""
    folder = tmp_path_factory.getbasetemp() / "sanitized"
    return build_plugin(Build(out=folder, sanitize=True)).library
