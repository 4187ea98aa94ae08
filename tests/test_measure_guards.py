import numpy as np
import pytest
from measure_systems import D, hexagonal, straight, system_of

from cgfibre.errors import InputError
from cgfibre.measure import guards as gd
from cgfibre.measure.contacts import FlatPlaten, filament_contacts, platen_contacts
from cgfibre.record import CURVE_COLUMNS, Curve, Frames


def frames_of(*states, moved=None) -> Frames:
    n = len(states)
    u = np.arange(n, dtype=float) if moved is None else np.asarray(moved, dtype=float)
    return Frames(step=np.arange(n), displacement_um=u, positions=np.stack(states))


def curve_of(**columns) -> Curve:
    n = len(next(iter(columns.values())))
    full = {name: np.zeros(n) for name in CURVE_COLUMNS} | {k: np.asarray(v, float) for k, v in columns.items()}
    return Curve(columns=full, phase=np.zeros(n, dtype=np.int64), width_um=np.ones(n))


def bent(system, filament, y=0.0, z=0.0):
    """Positions with one filament bowed by a half sine, its ends held."""
    p = system.positions.copy()
    a, b = system.filament_start[filament : filament + 2]
    shape = np.sin(np.pi * np.linspace(0, 1, b - a))
    p[a:b, 1] += y * shape
    p[a:b, 2] += z * shape
    return p


def test_overlap_depth():
    s = straight([(0, 0), (0, 0.9 * D)])
    deep = gd.overlap_depth(s, filament_contacts(s, s.positions), limit=0.05)
    assert not deep.ok and deep.value == pytest.approx(0.1) and "filament 0 and 1" in deep.message
    assert gd.overlap_depth(s, filament_contacts(s, s.positions), limit=0.11).ok
    wall = platen_contacts(s, s.positions, FlatPlaten(z=-0.49 * D, above=False))
    assert gd.overlap_depth(s, wall, limit=0.005, name="platen").value == pytest.approx(0.01)
    assert gd.overlap_depth(s, platen_contacts(s, s.positions, FlatPlaten(z=-D, above=False))).ok


def test_beads_past_a_platen():
    s = straight([(0, 0), (0, D)])
    top = [[FlatPlaten(z=z, above=True)] for z in (1.5 * D, 0.9 * D)]
    guard = gd.beads_past_platen(frames_of(s.positions, s.positions), top)
    assert not guard.ok and guard.value == 11
    assert gd.beads_past_platen(frames_of(s.positions, s.positions), [top[0], top[0]]).ok
    with pytest.raises(InputError, match="gaps"):
        gd.beads_past_platen(frames_of(s.positions), top)


def test_winding_of_a_helix_about_a_line_is_two_pi_a_turn():
    x = np.linspace(0, 100, 60)
    turns = 3.0
    helix = np.stack([x, 9 * np.cos(2 * np.pi * turns * x / 100), 9 * np.sin(2 * np.pi * turns * x / 100)], axis=1)
    line = np.stack([x, 0 * x, 0 * x], axis=1)
    for chains in ([line, helix], [line, helix[::-1]], [line[[0, 20, 59]], helix]):
        s = system_of(chains)
        assert gd.pair_winding(s, s.positions, np.array([[0, 1]]))[0] == pytest.approx(2 * np.pi * turns)


def test_winding_against_a_loop_with_other_bead_counts():
    rng = np.random.default_rng(2)
    chains = []
    for n in (9, 14, 30, 30):
        x = np.concatenate([[0], np.sort(rng.random(n - 2)) * 100, [100]])
        chains.append(np.stack([x, rng.normal(0, 9, n), rng.normal(0, 9, n)], axis=1))
    s = system_of(chains)
    pairs = np.array([[0, 1], [0, 3], [2, 3], [1, 2]])
    stations = np.linspace(0, 100, 41)
    naive = []
    for i, j in pairs:
        yz = [[np.interp(stations, chains[k][:, 0], chains[k][:, a]) for a in (1, 2)] for k in (i, j)]
        angle = np.unwrap(np.arctan2(yz[1][1] - yz[0][1], yz[1][0] - yz[0][0]))
        naive.append(angle[-1] - angle[0])
    assert gd.pair_winding(s, s.positions, pairs, stations) == pytest.approx(naive)


def crossing(gap=D, n=31):
    """One filament above another that it crosses at a small angle."""
    x = np.linspace(0, 300, n)
    return system_of([np.stack([x, 0 * x, 0 * x], axis=1), np.stack([x, (x - 150) / 15, 0 * x + gap], axis=1)])


def test_winding_jumps_by_two_pi_when_one_passes_through():
    s, pairs = crossing(), np.array([[0, 1]])
    before = gd.pair_winding(s, s.positions, pairs)
    assert np.abs(before) == pytest.approx([2 * np.arctan(10 / D)])
    assert gd.pair_winding(s, bent(s, 1, y=3 * D, z=3 * D), pairs) == pytest.approx(before)
    through = gd.pair_winding(s, bent(s, 1, z=-2 * D), pairs)
    assert np.abs(through - before) == pytest.approx([2 * np.pi])


@pytest.mark.parametrize("depths", [[0, -2.0], list(np.linspace(0, -2, 15)), [0, -2, 0]])
def test_passing_through_is_found_and_remembered(depths):
    s = crossing()
    guard = gd.filaments_through_each_other(s, frames_of(*[bent(s, 1, z=d * D) for d in depths]))
    assert not guard.ok and guard.value == 1 and "first 0 and 1" in guard.message
    pressed = frames_of(*[bent(s, 1, z=0.3 * d * D, y=d * D) for d in depths])
    assert gd.filaments_through_each_other(s, pressed).ok


def test_a_bundle_that_is_pressed_flat_is_quiet():
    s = straight(list(hexagonal(2, pitch=1.1 * D)), n=21)
    states = [s.positions * [1, 1 + 0.4 * w, 1 - 0.5 * w] for w in np.linspace(0, 1, 8)]
    assert gd.filaments_through_each_other(s, frames_of(*states)).ok


def test_parallel_filaments_that_change_places_in_contact_are_found():
    s = straight([(0, 0), (0, D), (3 * D, 0)], n=21)
    # upper one through the lower, in a plane: no winding, but a swap under the platen
    through = frames_of(*[bent(s, 1, z=d * D) for d in (0.0, -0.4, -2.0)])
    guard = gd.filaments_through_each_other(s, through)
    assert guard.value == 1
    # round it by small steps, always in contact
    angles = np.linspace(0, np.pi, 12)
    middle = np.sin(np.pi * np.linspace(0, 1, 21)) > 0.5
    states = []
    for angle in angles:
        p = s.positions.copy()
        p[21:42][middle, 1:] = D * np.stack([np.sin(-angle), np.cos(angle)])
        states.append(p)
    assert gd.filaments_through_each_other(s, frames_of(*states)).ok


def test_ends_that_turn_about_each_other_are_no_passage():
    s = straight([(0, 0), (0, D)], n=21)
    states = []
    for angle in np.linspace(0, 3 * np.pi, 13):
        p = s.positions.copy()
        share = np.linspace(0, 1, 21)  # one end held, the other led round: twisting of the pair
        p[21:, 1], p[21:, 2] = -D * np.sin(angle * share), D * np.cos(angle * share)
        states.append(p)
    assert gd.filaments_through_each_other(s, frames_of(*states)).ok


def test_passing_through_in_a_large_bundle_follows_near_pairs(monkeypatch):
    s = straight(list(hexagonal(3, pitch=1.05 * D)), n=15)
    moved = frames_of(s.positions, bent(s, 18, y=2 * D))
    all_pairs = gd.filaments_through_each_other(s, moved)
    monkeypatch.setattr(gd, "ALL_PAIRS_UP_TO", 5)
    quiet = gd.filaments_through_each_other(s, frames_of(s.positions, s.positions * [1, 1.05, 0.95]))
    assert quiet.ok and "of 90 pairs" in quiet.message  # a hexagon of 37 has 90 neighbouring pairs
    near_pairs = gd.filaments_through_each_other(s, moved)
    assert not near_pairs.ok and near_pairs.value == all_pairs.value


@pytest.mark.parametrize("direction", [1, -1])
@pytest.mark.parametrize("drift", [0.0, 700.0])
def test_periodic_filaments_pass_through(direction, drift):
    x = np.arange(20) * 5.0
    wave = np.stack([x, 2 * np.cos(2 * np.pi * x / 100), D + 0 * x], axis=1)[::direction]
    line = np.stack([x + 2.5, 0 * x + 0.1, 0 * x], axis=1)
    s = system_of([line, wave], closed=True, box=[[0, 100], [-50, 50], [-50, 50]], periodic=(True, False, False))
    p = s.positions.copy()
    p[20:, 0] += drift + 3.3
    sparse = [0, D]  # frames too far apart for anything but the winding
    assert gd.filaments_through_each_other(s, frames_of(s.positions, p, moved=sparse)).ok
    assert gd.pair_winding(s, p, np.array([[0, 1]])) == pytest.approx([0], abs=1e-9)
    # pushed through where it crosses over: down on one side, up on the other
    p[20:, 2] -= 2.5 * D * np.cos(np.pi * (p[20:, 0] - 28.3) / 100) ** 8
    assert gd.filaments_through_each_other(s, frames_of(s.positions, p, moved=sparse)).value == 1


def test_discs_that_swap_are_found():
    c = np.array([[0, 0], [D, 0], [2 * D, 0.0]])
    s = system_of([np.array([[0.0, *p]]) for p in c])
    swapped = s.positions[[1, 0, 2]]
    assert gd.filaments_through_each_other(s, frames_of(s.positions, swapped)).value == 1
    assert gd.filaments_through_each_other(s, frames_of(s.positions, s.positions + np.array([0, 3, 3]))).ok
    sparse = gd.filaments_through_each_other(s, frames_of(s.positions, swapped, moved=[0, D]))
    assert sparse.ok and "not applicable" in sparse.message


def test_through_guard_refuses_and_abstains():
    s = straight([(0, 0), (0, D)])
    assert "not applicable" in gd.filaments_through_each_other(s, frames_of(s.positions)).message
    with pytest.raises(InputError, match="frames"):
        gd.filaments_through_each_other(s, frames_of(s.positions[:-1]))
    assert not gd.filaments_through_each_other(s, frames_of(s.positions, s.positions * np.nan)).ok


def test_axis_distance_of_crossed_and_parallel_filaments():
    x = np.linspace(-50, 50, 6)
    along = np.stack([x, 0 * x, 0 * x], axis=1)
    across = np.stack([0 * x, x, 0 * x + 2.0], axis=1)
    s = system_of([along, across])
    # beads are 10 um from the crossing, the axes 2 um
    assert gd.minimum_axis_distance(s, s.positions, D) == pytest.approx(2.0)
    assert not gd.axis_distance(s, s.positions).ok
    parallel = straight([(0, 0), (0, 0.9 * D)])
    assert gd.axis_distance(parallel, parallel.positions).value == pytest.approx(0.9)
    apart = straight([(0, 0), (0, 2 * D)])
    assert gd.axis_distance(apart, apart.positions).ok and "above 1" in gd.axis_distance(apart, apart.positions).message
    assert not gd.axis_distance(apart, apart.positions * np.nan).ok


def test_axis_distance_against_sampled_segments():
    rng = np.random.default_rng(9)
    for _ in range(20):
        ends = rng.random((2, 2, 3)) * 20
        s = system_of(list(ends))
        t = np.linspace(0, 1, 401)[:, None]
        points = [e[0] + t * (e[1] - e[0]) for e in ends]
        sampled = np.linalg.norm(points[0][:, None] - points[1], axis=2).min()
        assert gd.minimum_axis_distance(s, s.positions, 40.0) == pytest.approx(sampled, abs=0.05)


def test_axis_distance_of_discs():
    s = system_of([np.array([[0.0, *p]]) for p in [(0, 0), (D, 0), (1.3 * D, 0)]])
    assert gd.axis_distance(s, s.positions).value == pytest.approx(0.3)


def test_stretch_owed_to_softening():
    s = straight([(0, 0), (0, D)])
    longer = s.positions * [1.03, 1, 1]
    assert "not applicable" in gd.stretch(s, frames_of(longer), 1.0).message
    assert gd.stretch(s, frames_of(s.positions), 30.0).value == pytest.approx(0, abs=1e-12)
    guard = gd.stretch(s, frames_of(s.positions, longer), 3.0)
    assert not guard.ok and guard.value == pytest.approx(0.03 * (1 - 1 / 3))
    x = np.arange(20) * 5.0
    ring = system_of([np.stack([x, 0 * x, 0 * x], axis=1)], closed=True, box=[[0, 100]] * 3, periodic=(True,) * 3)
    assert gd.stretch(ring, frames_of(ring.positions + 7.0), 30.0).value == pytest.approx(0, abs=1e-12)


def test_largest_bend():
    t = np.linspace(0, np.pi / 2, 6)  # a quarter of a circle in five chords
    s = straight([(0, 0)], n=6)
    arc = 30 * np.stack([np.sin(t), 0 * t, np.cos(t)], axis=1)
    assert gd.largest_bend(s, frames_of(s.positions, arc)).value == pytest.approx(np.pi / 10)
    folded = arc.copy()
    folded[4] = arc[2] + np.array([0.0, 0.1, 0.0])
    assert not gd.largest_bend(s, frames_of(arc, folded)).ok
    assert "not applicable" in gd.largest_bend(straight([(0, 0)], n=2), frames_of(np.zeros((2, 3)))).message


def test_quasi_static():
    u = np.linspace(0, 10, 11)
    work = u**2
    calm = curve_of(displacement_um=u, work_J=work, kinetic_J=0.01 * work)
    assert gd.quasi_static(calm, after_um=1.0, limit=0.05).value == pytest.approx(0.01)
    # a start with a jolt counts only from after_um on
    jolt = curve_of(displacement_um=u, work_J=work, kinetic_J=np.where(u < 3, 0.5, 0.01))
    assert gd.quasi_static(jolt, after_um=3.0).ok and not gd.quasi_static(jolt, after_um=1.0).ok
    assert not gd.quasi_static(curve_of(displacement_um=u, kinetic_J=u), after_um=1.0).ok
    assert "not applicable" in gd.quasi_static(calm, after_um=20.0).message
    back = curve_of(displacement_um=[0, 5, 0.0], work_J=[0, 10, 0.001], kinetic_J=[0, 0.01, 0.01])
    assert gd.quasi_static(back, after_um=1.0).ok


def test_force_balance():
    top = np.array([0, 1, 5, 10.0])
    assert gd.force_balance(curve_of(force_top_N=top, force_bottom_N=0.98 * top), True).value == pytest.approx(0.02)
    assert not gd.force_balance(curve_of(force_top_N=top, force_bottom_N=0.5 * top), True).ok
    assert "not applicable" in gd.force_balance(curve_of(force_top_N=top), False).message
    assert "not applicable" in gd.force_balance(curve_of(force_top_N=0 * top), True).message
    assert not gd.force_balance(curve_of(force_top_N=top * np.nan), True).ok


def test_finite():
    s = straight([(0, 0)])
    good = curve_of(force_top_N=[0, 1.0])
    assert gd.finite(good, frames_of(s.positions)).ok
    broken = s.positions.copy()
    broken[3, 1] = np.inf
    assert gd.finite(curve_of(force_top_N=[np.nan, 1.0]), frames_of(broken)).value == 2


def test_lost_beads_and_left_the_box():
    assert gd.lost_beads(10, 10).ok
    assert gd.lost_beads(10, 8).value == 2
    s = straight([(0, 0), (0, D), (0, 2 * D)])
    assert gd.filaments_outside_box(s, s.positions).ok
    gone = s.positions.copy()
    gone[12:14, 2] = 2000.0
    assert gd.filaments_outside_box(s, gone).value == 1
    wrapped = system_of([s.positions], periodic=(True, False, False))
    assert gd.filaments_outside_box(wrapped, wrapped.positions + np.array([5000, 0, 0])).ok
