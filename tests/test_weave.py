"""Weaves as built: sections, patterns, centre lines against closed forms, nothing overlaps, periodic closure."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.special import ellipe

from cgfibre.build.bundle import filament_type
from cgfibre.build.packing import min_distance
from cgfibre.build.tow_path import stations
from cgfibre.build.tow_shape import SECTIONS
from cgfibre.build.weave import (
    TowShape,
    WeaveSpec,
    consistent_plain,
    filament_system,
    holding,
    initial_overlap,
    minimum_spacing,
    packed_section,
    pattern_from_rows,
    plain,
    resample,
    ribbon_system,
    satin,
    tow_system,
    twill,
    weave_geometry,
    weave_paths,
)
from cgfibre.build.weave_spec import transition
from cgfibre.errors import InputError

#: nylon yarns of Table 8-2: 1.2 mm thick, 5 mm apart
T, P = 1200.0, 5000.0
ROUND = TowShape("circular", T, T)
NYLON = {"E1": 1.05e6, "G12": 4e5, "density": 1.172}
TOW = filament_type(T, **NYLON)
FILAMENT = filament_type(300.0, **NYLON)


def shape(section, width=3000.0, thickness=T):
    return TowShape(section, thickness if section == "circular" else width, thickness)


def spec(pattern=None, tow=ROUND, spacing=P, **more):
    return WeaveSpec(plain() if pattern is None else pattern, tow, tow, spacing, spacing, **more)


# --- sections ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("section", SECTIONS)
def test_a_section_agrees_with_its_outline(section):
    s = shape(section)
    ring = s.outline(4000)
    y, z = ring.T
    assert 0.5 * np.sum(y * np.roll(z, -1) - np.roll(y, -1) * z) == pytest.approx(s.area, rel=2e-5)
    assert np.ptp(ring, axis=0) == pytest.approx([s.width, s.thickness], rel=1e-4)
    # on the outline: distance 0, the height is half the thickness there, the support is the farthest point
    assert np.abs(s.signed_distance(ring)).max() < 1e-5 * s.width
    inner = np.abs(y) < 0.49 * s.width
    assert np.abs(z[inner]) == pytest.approx(s.half_thickness_at(y[inner]), abs=2e-3 * T)
    for a in (0.0, 0.3, 1.0, 1.5):
        n = np.array([np.sin(a), np.cos(a)])
        assert s.support(n) == pytest.approx(np.max(ring @ n), rel=1e-3)  # no point on a corner
        assert s.edge(a) @ n == pytest.approx(s.support(n), rel=1e-12)
    assert s.contains(0.99 * ring).all() and not s.contains(1.01 * ring).any()
    assert not s.contains(0.99 * ring, margin=0.02 * s.width).any()


def test_distance_from_a_round_section_is_exact():
    points = np.random.default_rng(0).normal(size=(200, 2)) * T
    assert ROUND.signed_distance(points) == pytest.approx(np.hypot(*points.T) - 0.5 * T, abs=1e-7 * T)


@pytest.mark.parametrize(
    "bad", [("oval", 2.0, 1.0), ("circular", 2.0, 1.0), ("elliptic", 1.0, 2.0), ("elliptic", np.nan, 1.0)]
)
def test_impossible_sections_are_refused(bad):
    with pytest.raises(InputError):
        TowShape(*bad)


# --- patterns ---------------------------------------------------------------------------------------------------------


def floats(column):
    """Lengths of runs of equal entries around a cyclic sequence."""
    changes = np.flatnonzero(column != np.roll(column, 1))
    return sorted(np.diff(np.append(changes, changes[0] + len(column))))


def test_floats_of_the_patterns():
    for pattern, lengths in ((plain(), [1, 1]), (twill(2, 2), [2, 2]), (twill(3, 1, 1), [1, 3]), (satin(5, 2), [1, 4])):
        for j in range(pattern.shape[1]):
            assert floats(pattern[:, j]) == lengths
        for i in range(pattern.shape[0]):
            assert floats(pattern[i]) == lengths
    # each warp of a satin dips once, no two neighbours at neighbouring wefts
    dips = np.argmin(satin(8, 3), axis=0)
    assert sorted(dips) == list(range(8)) and all((np.diff(dips) % 8) == 3)


def test_patterns_from_text():
    assert (pattern_from_rows("X.\n.X") == plain()).all()
    assert (pattern_from_rows(["1 0", "0 1"]) == pattern_from_rows("10,01")).all()
    for bad in ("", "X.\nX", "X?"):
        with pytest.raises(InputError):
            pattern_from_rows(bad)
    for make in (lambda: satin(4, 2), lambda: satin(6, 3), lambda: twill(0, 1), lambda: twill(2, 2, 4)):
        with pytest.raises(InputError):
            make()


# --- centre lines -----------------------------------------------------------------------------------------------------


def test_round_plain_weave_is_the_cosine():
    paths = weave_paths(spec())
    geometry = weave_geometry(spec(), mass_per_length=(2.0, 3.0))
    for path in paths:
        u = path.points[:, 0 if path.is_warp else 1]
        expected = 0.5 * T * np.cos(np.pi * (u / P - 0.5))
        assert np.abs(np.abs(path.points[:, 2]) - np.abs(expected)).max() < 1e-9 * T
        # one crossing: (2 / pi) sqrt(p^2 + (pi h)^2) E(m)
        long = np.hypot(P, np.pi * 0.5 * T)
        length = 2.0 / np.pi * long * ellipe((np.pi * 0.5 * T / long) ** 2)
        assert path.arc_length == pytest.approx(2.0 * length, rel=1e-6)
        assert path.crimp == pytest.approx(length / P - 1.0, rel=1e-4)
    assert geometry.crimp_angle == pytest.approx((np.arctan(np.pi * 0.5 * T / P),) * 2, rel=1e-6)
    assert geometry.path == ("cosine", "cosine") and geometry.crest == (0.0, 0.0)
    assert geometry.thickness == pytest.approx(2.0 * T)
    assert geometry.cover_factor == pytest.approx(1.0 - (1.0 - T / P) ** 2)
    assert geometry.areal_density == pytest.approx(5.0 * length / P / P, rel=1e-6)
    assert geometry.volume_fraction == pytest.approx(2.0 * np.pi * T**2 / 4.0 * length / P**2 / (2.0 * T), rel=1e-6)


def test_taut_round_weave_is_peirces():
    p = 1.9 * T
    s = spec(spacing=p, path="taut")
    geometry = weave_geometry(s)
    a = geometry.crimp_angle[0]
    # Peirce: p = (l - D a) cos a + D sin a;  2 h = (l - D a) sin a + D (1 - cos a), D the sum of the thicknesses
    length = p * (1.0 + geometry.crimp[0])
    assert (length - 2.0 * T * a) * np.cos(a) + 2.0 * T * np.sin(a) == pytest.approx(p, rel=1e-5)
    assert (length - 2.0 * T * a) * np.sin(a) + 2.0 * T * (1.0 - np.cos(a)) == pytest.approx(T, rel=1e-5)
    assert geometry.crimp[0] < weave_geometry(replace(s, path="cosine")).crimp[0]


def test_jammed_weaves_are_refused():
    assert minimum_spacing(ROUND, ROUND) == pytest.approx(np.sqrt(3.0) * T, rel=1e-6)
    # a rectangle: up its side, half a thickness away on both sides
    assert minimum_spacing(shape("rectangular"), shape("rectangular")) == pytest.approx(3000.0 + T, rel=1e-6)
    for path in ("auto", "taut", "cosine"):
        with pytest.raises(InputError, match="at least 2078"):
            weave_paths(spec(spacing=1.72 * T, path=path))
    tight = transition(spec(spacing=1.7321 * T, path="taut"), True)
    assert np.max(np.abs(tight.angle)) == pytest.approx(np.pi / 3.0, rel=0.02)
    with pytest.raises(InputError, match="warp_spacing"):
        spec(spacing=0.9 * T)


def test_the_thesis_weave_is_inconsistent():
    angle = np.radians(8.0)
    assert consistent_plain(spacing=225.0, crimp_angle=angle)[0] == pytest.approx(20.13, abs=0.01)
    assert consistent_plain(thickness=70.0, crimp_angle=angle)[1] == pytest.approx(782.0, abs=0.5)
    assert np.degrees(consistent_plain(thickness=70.0, spacing=225.0)[2]) == pytest.approx(26.04, abs=0.01)
    with pytest.raises(InputError, match=r"26 degrees.*782"):
        consistent_plain(70.0, 225.0, angle)
    with pytest.raises(InputError):
        consistent_plain(thickness=70.0)
    # the angle is that of the path
    paths = weave_paths(spec(tow=TowShape("circular", 70.0, 70.0), spacing=225.0))
    assert np.degrees(paths[0].crimp_angle) == pytest.approx(26.04, abs=0.01)


@pytest.mark.parametrize("section", SECTIONS)
@pytest.mark.parametrize("path", ["auto", "taut"])
def test_lines_keep_their_distance_from_the_sections_they_cross(section, path):
    s = spec(tow=shape(section, 2400.0), spacing=4300.0, path=path)
    warp, weft = weave_paths(s)[0], s.weft
    for i in range(2):
        other = -1.0 if s.over(i, 0) else 1.0
        at = np.column_stack([warp.points[:, 0] - (i + 0.5) * P * 4300.0 / P, warp.points[:, 2] - other * 0.5 * T])
        assert weft.signed_distance(at).min() >= 0.5 * T * (1.0 - 3e-5)
        assert weft.signed_distance(at).min() <= 0.5 * T * (1.0 + 1e-9)


def test_flat_crests_are_no_longer_than_needed():
    s = spec(tow=shape("rectangular", 2400.0))
    change = transition(s, True)
    assert change.kind == "cosine" and 0.45 * 2400.0 < change.crest < 0.5 * 2400.0
    assert weave_geometry(s).crest == (change.crest, change.crest)
    assert transition(spec(tow=shape("lenticular", 2400.0)), True).crest == 0.0


def test_unbalanced_crimp():
    s = replace(spec(), balance=0.0)
    warp, weft = weave_paths(s)[0], weave_paths(s)[2]
    assert np.abs(warp.points[:, 2]).max() == 0.0 and warp.crimp == pytest.approx(0.0, abs=1e-12)
    assert np.abs(weft.points[:, 2]).max() == pytest.approx(T)
    thin = WeaveSpec(plain(), ROUND, TowShape("circular", 600.0, 600.0), P, P)
    assert thin.amplitudes == pytest.approx((300.0, 600.0))  # flush: both reach as high
    assert weave_geometry(thin).thickness == pytest.approx(T + 600.0)


@pytest.mark.parametrize("pattern", [plain(), twill(2, 2), satin(5, 2)], ids=["plain", "twill", "satin"])
def test_periodic_lines_close_and_patches_are_their_parts(pattern):
    cell = weave_paths(spec(pattern))
    for path in cell:
        axis = 0 if path.is_warp else 1
        step = path.points[-1] - path.points[0]
        assert step[axis] == pytest.approx(len(pattern) * P) and np.abs(np.delete(step, axis)).max() < 1e-9
        assert path.tangent[0] == pytest.approx(path.tangent[-1], abs=1e-9)
        assert np.sum(path.tangent * path.normal, axis=1) == pytest.approx(0.0, abs=1e-12)
        assert path.binormal[:, 2] == pytest.approx(0.0, abs=1e-12)
    patch = weave_paths(replace(spec(pattern), periodic=False))
    for a, b in zip(cell, patch, strict=True):
        assert a.closed and not b.closed
        assert b.points == pytest.approx(a.points, abs=1e-9)
    for ends, beyond in (("flat", 0.0), ("crest", 0.5 * P)):
        for path in weave_paths(replace(spec(pattern), periodic=False, ends=ends)):
            axis = 0 if path.is_warp else 1
            assert path.points[[0, -1], axis] == pytest.approx([-beyond, len(pattern) * P + beyond])
            assert path.tangent[[0, -1], 2] == pytest.approx(0.0, abs=1e-12)
            assert np.abs(path.points[[0, -1], 2]) == pytest.approx(0.5 * T)


def test_a_patch_has_the_tows_asked_for():
    s = WeaveSpec(twill(2, 2), ROUND, ROUND, P, P, periodic=False, tows=(3, 6))
    paths = weave_paths(s)
    assert [p.is_warp for p in paths] == [True] * 3 + [False] * 6
    assert [p.index for p in paths] == list(range(9))
    assert s.size == (6 * P, 3 * P)


# --- systems ----------------------------------------------------------------------------------------------------------


def test_beads_at_equal_arc_length_and_on_every_crossing():
    path = weave_paths(spec())[0]
    s = stations(path, spacing=300.0)
    steps = np.diff(np.append(s, s[0] + path.arc_length))
    assert steps == pytest.approx(steps[0], rel=1e-9) and steps[0] <= 300.0
    assert np.min(np.abs(s[:, None] - path.crossings), axis=0) == pytest.approx(0.0, abs=1e-6)
    assert len(resample(path, n=40)) == 40
    for bad in ({}, {"n": 1}, {"spacing": 0.0}, {"n": 10, "spacing": 3.0}):
        with pytest.raises(InputError):
            resample(path, **bad)


def brute_overlap(system):
    """Largest overlap by dense points on every segment and all images."""
    start = system.positions[system.bonds()[:, 0]]
    share = np.arange(12)[:, None, None] / 12
    dense = (start + share * system.bond_vectors()).swapaxes(0, 1).reshape(-1, 3)
    filament = np.repeat(system.filament_of_bead[system.bonds()[:, 0]], 12)
    size = system.box[:, 1] - system.box[:, 0]
    worst = 0.0
    for a in range(system.n_filaments):
        for b in range(a):
            d = dense[filament == a][:, None] - dense[filament == b][None]
            d[..., :2] -= size[:2] * np.round(d[..., :2] / size[:2])
            reach = 0.5 * (system.diameter[a] + system.diameter[b])
            worst = max(worst, reach - float(np.linalg.norm(d, axis=2).min()))
    return worst


def test_overlap_against_every_pair_of_points():
    system = tow_system(spec(), TOW, 600.0)
    assert initial_overlap(system)[0] <= 1e-6 * T
    thick = replace(system, types=(replace(TOW, diameter=1.1 * T),))
    overlap, pair = initial_overlap(thick)
    assert overlap == pytest.approx(brute_overlap(thick), rel=2e-3) and 0.1 * T <= overlap < 0.102 * T
    assert sorted(pair)[0] < 2 <= sorted(pair)[1]  # a warp tow and a weft tow
    # the same weave moved by half a cell crosses the boundary with its contacts
    moved = thick.positions + np.array([0.5 * P, 0.0, 0.0])
    moved[:, 0] %= 2.0 * P
    assert initial_overlap(replace(thick, positions=moved))[0] == pytest.approx(overlap, rel=1e-9)


@pytest.mark.parametrize("pattern", [plain(), twill(2, 2), satin(5, 2)], ids=["plain", "twill", "satin"])
def test_tows_touch_and_do_not_overlap(pattern):
    system = tow_system(spec(pattern), TOW, 300.0)
    n = len(pattern)
    assert (system.tow == np.arange(2 * n)).all() and system.closed.all()
    assert system.periodic.tolist() == [True, True, False]
    assert initial_overlap(system)[0] <= 1e-6 * T
    # every crossing: the right one on top, touching but for what chords took
    z, bead_tow = system.positions[:, 2], system.tow[system.filament_of_bead]
    for j in range(n):
        for i in range(n):
            x, y = (i + 0.5) * P, (j + 0.5) * P
            warp, weft = (
                np.flatnonzero((bead_tow == k) & (np.hypot(*(system.positions[:, :2] - [x, y]).T) < 1.0))
                for k in (j, n + i)
            )
            assert len(warp) == len(weft) == 1
            apart = float(z[warp[0]] - z[weft[0]])
            assert apart == pytest.approx(T if pattern[i, j] else -T, abs=0.003 * T)
    assert system.provenance["gap_added_um"] < 0.003 * T
    # closing bonds are as long as the others
    assert np.ptp(system.bond_lengths()) < 0.05 * 300.0


def test_flat_tows_as_ribbons():
    flat = shape("lenticular", 3000.0)
    system = ribbon_system(spec(tow=flat), TOW, 300.0, chains=4)
    assert (np.bincount(system.tow) == 4).all()
    assert initial_overlap(system, between_tows=True)[0] <= 1e-6 * T
    assert initial_overlap(system)[0] > 0.3 * T  # chains of a tow stand in each other
    warp = system.positions[: system.filament_start[4]].reshape(4, -1, 3)
    assert np.ptp(warp[:, :, 1]) == pytest.approx(3000.0 - T)
    assert np.diff(warp[:, 0, 1]) == pytest.approx((3000.0 - T) / 3.0)
    assert len(np.unique(ribbon_system(spec(tow=flat), TOW, 300.0).filament_start)) == 4 * 3 + 1
    with pytest.raises(InputError, match="2 chains"):
        ribbon_system(spec(tow=flat), TOW, 300.0, chains=1)
    with pytest.raises(InputError, match="thickness"):
        ribbon_system(spec(tow=flat), filament_type(1.1 * T, **NYLON), 300.0)


@pytest.mark.parametrize("section", SECTIONS)
@pytest.mark.parametrize("packing", ["random", "hexagonal"])
def test_filaments_lie_inside_their_section(section, packing):
    tow = holding(section, T, 30, 300.0, 0.6)
    assert tow.area == pytest.approx(30 * np.pi * 300.0**2 / 4.0 / 0.6, rel=1e-9)
    rng = np.random.default_rng(3)
    centres = packed_section(tow, 30, 300.0, packing, rng, jitter=20.0 if section == "elliptic" else 0.0)
    assert centres.shape == (30, 2)
    assert min_distance(centres) >= 300.0 * (1.0 - 1e-9)
    assert tow.contains(centres, 150.0 * (1.0 - 1e-6)).all()


def test_filaments_that_do_not_fit_are_refused():
    for count, packing in ((60, "random"), (60, "hexagonal"), (30, "square"), (0, "random")):
        with pytest.raises(InputError):
            packed_section(shape("elliptic"), count, 300.0, packing, np.random.default_rng(0))
    assert packed_section(shape("elliptic"), 1, 300.0, "random", np.random.default_rng(0)).tolist() == [[0.0, 0.0]]
    with pytest.raises(InputError, match="thinner"):
        holding("lenticular", 2000.0, 3, 300.0, 0.6)


@pytest.mark.parametrize("section", ["circular", "lenticular", "racetrack"])
def test_nylon_filaments_do_not_overlap(section):
    tow = holding(section, T, 30, 300.0, 0.6)
    system = filament_system(spec(tow=tow), FILAMENT, 30, 300.0, seed=2)
    assert system.n_filaments == 120 and (np.bincount(system.tow) == 30).all()
    assert initial_overlap(system)[0] < 1e-3 * T
    assert initial_overlap(system, between_tows=True)[0] <= 1e-6 * T
    again = filament_system(spec(tow=tow), FILAMENT, 30, 300.0, seed=2)
    assert (again.positions == system.positions).all()


@pytest.mark.parametrize("count", [12, 30])
def test_one_seed_is_one_specimen_at_every_bead_spacing(count):
    def places(spacing, seed=3):
        """Filaments in the sections of their tows, (n, 2) um, at a tow's first beads (chords open the gap)."""
        system = filament_system(spec(tow=shape("lenticular", 4400.0)), FILAMENT, count, spacing, seed=seed)
        first = system.positions[system.filament_start[:-1]]
        across = np.where(system.tow < 2, first[:, 1], first[:, 0])
        height = np.array([np.mean(first[system.tow == t, 2]) for t in range(4)])
        return np.column_stack([across - np.floor(across / P) * P, first[:, 2] - height[system.tow]])

    one = places(150.0)
    assert np.array_equal(places(150.0 * (1.0 + 1e-9)), one)
    for spacing in (75.0, 300.0, 450.0, 600.0):
        # what chords want beyond ROOM is a matter of moving a few filaments a little
        moved = np.abs(places(spacing) - one).max(axis=1)
        assert moved.max() < 0.01 * 300.0
    assert np.abs(places(150.0, seed=4) - one).max() > 0.5 * 300.0


def test_twisted_filaments_are_right_handed_helices_and_close():
    tow = holding("circular", T, 12, 300.0, 0.45)
    s = WeaveSpec(np.array([[True], [True]]), tow, tow, P, P)  # warps that stay on top: straight
    system = filament_system(s, FILAMENT, 12, 200.0, twist=1.9 / (2.0 * P))
    assert initial_overlap(system)[0] < 1e-3 * T
    middle = weave_paths(s)[0].points[0]
    for k in range(12):
        beads = system.positions[system.filament_start[k] : system.filament_start[k + 1]] - middle
        radius = np.hypot(beads[:, 1], beads[:, 2])
        assert radius == pytest.approx(radius[0], rel=1e-9)
        angle = np.unwrap(np.arctan2(beads[:, 2], beads[:, 1]))
        # two whole turns in the cell, from +y to +z along +x
        assert np.diff(angle) == pytest.approx(2.0 * 2.0 * np.pi * np.diff(beads[:, 0]) / (2.0 * P), rel=1e-6)
    assert np.ptp(system.bond_lengths()[:40]) < 0.3 * 200.0
    with pytest.raises(InputError, match="longer cell"):
        filament_system(s, FILAMENT, 12, 200.0, twist=0.2 / (2.0 * P))
    with pytest.raises(InputError, match=r"filaments\.count"):
        filament_system(s, FILAMENT, 12, 200.0, twist=8.0 / (2.0 * P))
    with pytest.raises(InputError, match="only round"):
        filament_system(spec(tow=shape("elliptic")), FILAMENT, 12, 200.0, twist=1e-4)


@settings(max_examples=12, deadline=None)
@given(
    st.integers(1, 4),
    st.integers(1, 4),
    st.integers(0, 2**16 - 1),
    st.floats(2.3, 5.0),
    st.floats(0.6, 1.0),
    st.floats(0.2, 0.8),
    st.booleans(),
)
def test_no_pattern_overlaps(n_weft, n_warp, bits, spacing, thin, balance, periodic):
    pattern = np.array([(bits >> k) & 1 for k in range(n_weft * n_warp)], dtype=bool).reshape(n_weft, n_warp)
    weft = TowShape("circular", thin * T, thin * T)
    s = WeaveSpec(pattern, ROUND, weft, spacing * T, spacing * T, periodic=periodic, balance=balance)
    system = tow_system(s, (TOW, filament_type(thin * T, **NYLON)), 0.25 * T)
    assert initial_overlap(system)[0] <= 1e-6 * thin * T
    for path in weave_paths(s):
        assert path.crimp >= -1e-9 and path.arc_length >= path.projected_length * (1.0 - 1e-9)


def test_impossible_weaves_are_refused():
    for bad in (
        {"pattern": np.zeros((0, 2), dtype=bool)},
        {"pattern": np.zeros((2, 2))},
        {"gap": -1.0},
        {"balance": 1.5},
        {"repeats": (0, 1)},
        {"tows": (2, 2)},
        {"path": "arc"},
        {"ends": "loop", "periodic": False},
        {"weft_spacing": np.inf},
    ):
        with pytest.raises(InputError):
            replace(spec(), **bad)
