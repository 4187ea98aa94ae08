import numpy as np
import pytest
from measure_systems import D, hexagonal, straight, system_of

from cgfibre.errors import InputError
from cgfibre.measure import contacts as ct


def test_two_parallel_filaments_press_by_stiffness_times_length_times_overlap():
    s = straight([(0, 0), (0, D - 0.1)])
    c = ct.filament_contacts(s, s.positions, stiffness_per_length=3.3e6)
    assert len(c) == 11 and c.overlap == pytest.approx(0.1)
    # force per length k' delta over the whole length
    assert c.force.sum() == pytest.approx(3.3e6 * 0.1 * 10 * D)
    assert c.force_per_filament(2) == pytest.approx([c.force.sum()] * 2)
    assert c.force_per_bead(22) == pytest.approx(np.tile(c.force[np.argsort(c.x)], 2))
    assert c.count_per_filament(2).tolist() == [11, 11]


def test_slab_selects_by_x():
    s = straight([(0, 0), (0, D - 0.1)])
    c = ct.filament_contacts(s, s.positions, 1e6).within(2 * D - 1, 4 * D + 1)
    assert len(c) == 3 and c.force.sum() == pytest.approx(1e6 * 0.1 * 3 * D)


def test_one_filament_never_touches_itself():
    s = straight([(0, 0)], n=40, spacing=D / 4)
    assert len(ct.filament_contacts(s, s.positions, 1e6)) == 0


def test_gaps_within_the_tolerance_press_nothing():
    s = straight([(0, 0), (0, D + 0.1)])
    assert len(ct.filament_contacts(s, s.positions, 1e6)) == 0
    near = ct.filament_contacts(s, s.positions, 1e6, tolerance=0.2)
    assert len(near) == 11 and near.overlap == pytest.approx(-0.1) and near.force.max() == 0


def test_hexagonal_section_has_six_contacts_a_disc():
    c = hexagonal(4, pitch=D - 0.02)
    s = system_of([np.array([[0.0, *p]]) for p in c])
    got = ct.filament_contacts(s, s.positions, 1e6, length=1000.0)
    inner = np.linalg.norm(c, axis=1) < 3 * D
    assert got.count_per_filament(len(c))[inner].tolist() == [6] * inner.sum()
    assert got.force == pytest.approx(1e6 * 1000 * 0.02)
    with pytest.raises(InputError, match="depth"):
        ct.filament_contacts(s, s.positions, 1e6)


@pytest.mark.parametrize("periodic", [(False,) * 3, (True, True, False)])
def test_against_the_naive_double_loop(periodic):
    rng = np.random.default_rng(6)
    box = np.array([[0, 40.0], [-20, 20], [0, 30]])
    # unwrapped: some beads lie outside the box
    chains = [box[:, 0] + rng.random((8, 3)) * 1.3 * (box[:, 1] - box[:, 0]) for _ in range(12)]
    s = system_of(chains, box=box, periodic=periodic)
    got = ct.filament_contacts(s, s.positions, 2.0, length=np.linspace(1, 2, s.n_beads), tolerance=0.5)
    naive = {}
    lengths, owner = np.linspace(1, 2, s.n_beads), s.filament_of_bead
    for i in range(s.n_beads):
        for j in range(i + 1, s.n_beads):
            d = s.positions[j] - s.positions[i]
            for axis in np.flatnonzero(periodic):
                size = box[axis, 1] - box[axis, 0]
                d[axis] -= size * round(d[axis] / size)
            overlap = D - np.linalg.norm(d)
            if owner[i] != owner[j] and overlap >= -0.5:
                naive[i, j] = 2.0 * np.sqrt(lengths[i] * lengths[j]) * max(overlap, 0)
    assert {(int(min(p)), int(max(p))) for p in got.beads} == set(naive)
    assert sorted(got.force) == pytest.approx(sorted(naive.values()))


def test_platens_touch_top_and_bottom():
    s = straight([(0, D / 2 - 0.05), (0, 3 * D)])
    bottom = ct.platen_contacts(s, s.positions, ct.FlatPlaten(z=0.0, above=False), 2e6)
    assert len(bottom) == 11 and set(bottom.filaments.ravel()) == {0}
    assert bottom.force.sum() == pytest.approx(2e6 * 0.05 * 10 * D)
    anvil = ct.FlatPlaten(z=3.5 * D - 0.2, above=True, x=(2 * D, 4 * D))
    top = ct.platen_contacts(s, s.positions, anvil, 2e6)
    assert len(top) == 3 and top.overlap == pytest.approx(0.2) and top.force_per_filament(2)[0] == 0
    assert np.isinf(anvil(np.array([[0.0, 0, 0]])))[0]


def test_crimped_platen_by_a_gap_function():
    s = straight([(0, 0)], n=21)
    radius, crest = 500.0, 10 * D

    def gap(p):  # convex cylinder below, its crest at the middle
        return np.hypot(p[:, 0] - crest, p[:, 2] + radius + 3.4) - radius

    c = ct.platen_contacts(s, s.positions, gap, 1.0)
    half = np.sqrt((radius + D / 2) ** 2 - (radius + 3.4) ** 2)
    assert c.x == pytest.approx(s.positions[np.abs(s.positions[:, 0] - crest) <= half, 0])
    assert c.overlap.max() == pytest.approx(0.1)


@pytest.mark.parametrize(
    ("key", "positions", "stiffness"),
    [("positions", np.zeros((3, 3)), 1.0), ("positions", np.full((22, 3), np.nan), 1.0), ("stiffness", None, -1.0)],
)
def test_bad_input_is_named(key, positions, stiffness):
    s = straight([(0, 0), (0, D)])
    with pytest.raises(InputError, match=key):
        ct.filament_contacts(s, s.positions if positions is None else positions, stiffness)
    with pytest.raises(InputError, match="length"):
        ct.filament_contacts(s, s.positions, 1.0, length=np.ones(3))
