"""Supports and condensed ends against the thesis' numbers, limits, transfer matrices and assembled bead chains."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import expm, solveh_banded

from cgfibre.errors import InputError
from cgfibre.mechanics import rod, support

EA, EI, GJ, P = 8.851e9, 2.711e10, 6.435e9, 4e5
L = 345e3
FAR: tuple[support.FarEnd, ...] = ("simply supported", "clamped")


def test_stiffness_of_the_thesis_filament() -> None:
    # CHECKED: exact 4.64e-6 N/mm; Eq 7-1 5.64e-6 (the thesis prints 5.63e-6); 1 nN/um = 1e-6 N/mm
    exact = support.mid_span_stiffness(L, EI, P)
    assert exact == pytest.approx(4.645, abs=1e-3)
    assert support.thesis_mid_span_stiffness(L, EI, P) == pytest.approx(5.63, rel=2e-3)
    assert support.thesis_mid_span_stiffness(L, EI, P) / exact == pytest.approx(1.21, abs=5e-3)
    lam = np.sqrt(P / EI)
    assert exact == pytest.approx(1 / (L / (4 * P) - np.tanh(lam * L / 2) / (2 * P * lam)), rel=1e-12)


def test_stiffness_without_tension() -> None:
    bare = 48 * EI / L**3
    assert support.mid_span_stiffness(L, EI) == pytest.approx(bare, rel=1e-14)
    assert support.thesis_mid_span_stiffness(L, EI) == pytest.approx(bare, rel=1e-14)
    x = np.geomspace(1e-9, 1, 200)
    k = support.mid_span_stiffness(L, EI, EI * (2 * x / L) ** 2)
    # x^3/3/(x - tanh x) = 1 + 2/5 x^2 - 1/525 x^4 + ... : no jump, no noise
    low = x < 0.03
    assert k[low] / bare - 1 == pytest.approx(0.4 * x[low] ** 2 - x[low] ** 4 / 525, abs=1e-12)
    assert np.all(np.diff(k) >= -1e-15 * bare)


def test_torsional_springs() -> None:
    assert support.thesis_torsional_stiffness(L, GJ) == pytest.approx(GJ / L)
    # two springs of a half each, in parallel
    assert support.mid_span_torsional_stiffness(L, GJ) == pytest.approx(2 * GJ / (L / 2))


def test_support_frequency() -> None:
    k, m = support.mid_span_stiffness(L, EI, P), 69.0
    assert support.support_frequency(k, m) ** 2 * m == pytest.approx(k)


# --- far field


def transfer_stiffness(a: float, tension: float, far_end: str) -> np.ndarray:
    """K by the matrix exponential of EI w'''' = P w''; state w, w', M = -EI w'', Q = EI w''' - P w'."""
    A = np.array([[0, 1, 0, 0], [0, 0, -1 / EI, 0], [0, -tension, 0, -1], [0, 0, 0, 0.0]])
    scale = np.diag([a, 1, EI / a, EI / a**2])
    T = expm(np.linalg.inv(scale) @ A @ scale * a)
    rows = [0, 2] if far_end == "simply supported" else [0, 1]
    reaction = -np.linalg.solve(T[rows, 2:], T[rows, :2])
    # work-conjugate to (w, w') on the near end of a beam lying outward
    K = np.diag([EI / a**2, EI / a]) @ np.array([[0, 1], [1, 0]]) @ reaction @ np.diag([1 / a, 1])
    return K


@pytest.mark.parametrize("far_end", FAR)
@pytest.mark.parametrize("phi", [0.0, 1e-3, 0.1, 0.9, 1.1, 4.0, 9.0])
def test_far_field_against_the_matrix_exponential(phi: float, far_end: support.FarEnd) -> None:
    a = 700.0
    tension = EI * (phi / a) ** 2
    want = transfer_stiffness(a, tension, far_end)
    assert support.far_field_stiffness(a, EI, tension, far_end) == pytest.approx(want, rel=1e-9)


def test_far_field_limits() -> None:
    a = 700.0
    scale = np.array([[EI / a**3, EI / a**2], [EI / a**2, EI / a]])
    pinned, clamped = (support.far_field_stiffness(a, EI, 0.0, far) for far in FAR)
    assert pinned / scale == pytest.approx(np.full((2, 2), 3.0), rel=1e-14)
    assert clamped / scale == pytest.approx(np.array([[12.0, 6.0], [6.0, 4.0]]), rel=1e-14)
    phi = np.geomspace(1e-6, 1e4, 400)
    tension = EI * (phi / a) ** 2
    for far in FAR:
        K = support.far_field_stiffness(a, EI, tension, far)
        assert K.shape == (400, 2, 2)
        assert np.all(np.isfinite(K))
        assert np.all(np.diff(K[:, [0, 1], [0, 1]], axis=0) >= -1e-15 * K[1:, [0, 1], [0, 1]])
        assert np.all(np.linalg.det(K[:200]) > 0)
    lam = phi[-1] / a
    # a long string: EI lambda turns its end, P/a moves it
    assert K[-1, 1, 1] == pytest.approx(EI * lam, rel=2e-4)
    assert K[-1, 0, 0] == pytest.approx(tension[-1] / a, rel=3e-4)


@pytest.mark.parametrize("phi", [0.0, 1e-3, 0.5, 5.0, 700.0, 1e4])
def test_two_far_fields_make_a_beam(phi: float) -> None:
    a = L / 2
    tension = EI * (phi / a) ** 2
    K = support.far_field_stiffness(a, EI, tension)
    # mid-span does not turn by symmetry
    assert 2 * K[0, 0] == pytest.approx(support.mid_span_stiffness(L, EI, tension), rel=1e-11)
    # moments about the support
    assert K[0, 0] * a - K[0, 1] == pytest.approx(tension, rel=1e-6, abs=1e-9 * K[0, 1])
    assert K[0, 1] * a == pytest.approx(K[1, 1], rel=1e-12)


def test_axial_end() -> None:
    assert support.axial_end_stiffness(L / 2, EA) == pytest.approx(EA / (L / 2))
    assert support.axial_end_stiffness(np.array([1.0, 2.0]), EA, load_controlled=True) == pytest.approx([0, 0])


# --- the condensed end in a chain


def test_half_hinge_in_series() -> None:
    K = support.far_field_stiffness(1000.0, EI, P)
    s, w, psi = 7.0, 0.3, 2e-3
    got = support.chain_end_stiffness(K, s, EI)
    # minimise the energy over the beam's end slope by hand
    h = 2 * EI / s
    theta = (h * psi - K[0, 1] * w) / (h + K[1, 1])
    force = K[0, 0] * w + K[0, 1] * theta
    moment = h * (psi - theta)
    assert got @ [w, psi] == pytest.approx([force, moment], rel=1e-9)
    assert support.chain_end_stiffness(K, 1e-9, EI) == pytest.approx(K, rel=1e-9)


@settings(deadline=None, max_examples=80)
@given(
    a=st.floats(10, 1e6),
    s=st.floats(0.5, 50),
    log_phi=st.floats(-3, 3.5),
    far_end=st.sampled_from(FAR),
)
def test_chain_end_has_the_far_field_s_stiffness(a: float, s: float, log_phi: float, far_end: support.FarEnd) -> None:
    tension = EI * (10**log_phi / a) ** 2
    K = support.far_field_stiffness(a, EI, tension, far_end)
    want = support.chain_end_stiffness(K, s, EI)
    end = support.chain_end(K, s, EI, tension)
    assert end.stiffness() == pytest.approx(want, rel=1e-8)
    assert end.distance <= a * (1 + 1e-9)
    assert min(end.spring, end.hinge, end.distance) > 0
    assert end.ground >= 0
    if far_end == "simply supported":
        assert end.ground == 0
    # any other arm in the range does as well
    longest, shortest = want[1, 1] / want[0, 1], want[1, 1] / (want[0, 1] + tension)
    for share in (0.2, 1.0):
        e = shortest + share * (longest - shortest)
        if e > shortest * (1 + 1e-4):
            other = support.chain_end(K, s, EI, tension, distance=e)
            assert other.distance == pytest.approx(e)
            assert other.stiffness() == pytest.approx(want, rel=1e-7)


def test_end_at_the_support_itself_is_a_pinned_bead() -> None:
    a, s = 1000.0, 7.0
    K = support.far_field_stiffness(a, EI, P)
    end = support.chain_end(K, s, EI, P, distance=a)
    assert end.rigid
    # hinge: half of the last segment and the far field's own turn stiffness in series
    assert end.hinge == pytest.approx(1 / (s / (2 * EI) + 1 / K[1, 1]))
    assert not support.chain_end(K, s, EI, P).rigid


def test_end_without_tension() -> None:
    K = support.far_field_stiffness(1000.0, EI)
    end = support.chain_end(K, 7.0, EI, 0.0)
    assert end.stiffness() == pytest.approx(support.chain_end_stiffness(K, 7.0, EI))
    assert end.distance == pytest.approx(1000.0)
    nearly = support.chain_end(support.far_field_stiffness(1000.0, EI, 1e-6), 7.0, EI, 1e-6)
    assert [nearly.spring, nearly.hinge] == pytest.approx([end.spring, end.hinge], rel=1e-6)


def test_arm_of_a_long_far_field() -> None:
    K = support.far_field_stiffness(L / 2 - 500, EI, P)
    end = support.chain_end(K, 7.0, EI, P)
    assert end.distance == pytest.approx(2 * np.sqrt(EI / P), rel=0.03)
    assert end.hinge == pytest.approx(P * end.distance)


SEGMENTS = 144  # of the 1 mm zone: beads at mid-span and on the edges of a 0.5 mm anvil
SPACING = 1000.0 / SEGMENTS


def full_chain(length: float, tension: float, loads: tuple[int, ...]) -> float:
    """Stiffness under equal loads at the beads +-i from mid-span: even chain, banded solve, simply supported."""
    s = SPACING
    n = round(length / s)
    inner = n - 1
    k, t = EI / s**3, tension / s
    band = np.zeros((3, inner))
    band[0], band[1], band[2] = k, -4 * k - t, 6 * k + 2 * t
    band[2, [0, -1]] = 5 * k + 2 * t
    f = np.zeros(inner)
    for i in loads:
        f[n // 2 - 1 + i] += 1 / len(loads)
    return float(1 / solveh_banded(band, f)[n // 2 - 1 + loads[0]])


def zone_chain(end: support.ChainEnd, tension: float, loads: tuple[int, ...]) -> float:
    """The same with the zone's beads, one bead X beyond either end and nothing else."""
    n = SEGMENTS
    lengths = np.concatenate([[end.distance], np.full(n, SPACING), [end.distance]])
    hinges = np.full(n + 1, EI / SPACING)
    hinges[[0, -1]] = end.hinge
    d = np.diff(np.eye(n + 3), axis=0) / lengths[:, None]
    turn = np.diff(d, axis=0)
    K = turn.T @ (hinges[:, None] * turn) + d.T @ ((tension * lengths)[:, None] * d)
    K[[0, -1], [0, -1]] += end.spring
    K[[1, -2], [1, -2]] += end.ground
    f = np.zeros(n + 3)
    for i in loads:
        f[1 + n // 2 + i] += 1 / len(loads)
    return float(1 / np.linalg.solve(K, f)[1 + n // 2 + loads[0]])


@pytest.mark.parametrize("loads", [(0,), (-36, 36)])
@pytest.mark.parametrize(("length", "tension"), [(2000.0, P), (2000.0, 0.0), (2000.0, 100 * P), (L, P)])
def test_zone_with_condensed_ends_is_the_whole_filament(length: float, tension: float, loads: tuple[int, ...]) -> None:
    a = (length - 1000) / 2
    end = support.chain_end(support.far_field_stiffness(a, EI, tension), SPACING, EI, tension)
    zone = zone_chain(end, tension, loads)
    width = 2 * loads[-1] * SPACING
    exact = 1 / rod.platen_compliance(length, EI, width=width, tension=tension)
    # what is left is the even chain's own error, of order (lambda s)^2: lambda s = 0.27 at the highest tension
    assert zone == pytest.approx(exact, rel=3e-4)
    # the banded solve of 49 680 segments has a condition of 1e13, hence its looser tolerance
    assert zone == pytest.approx(full_chain(length, tension, loads), rel=5e-4 if length == L else 3e-5)


def test_half_hinge_correction_matters() -> None:
    """Without it the hinge at Z would lack half a segment's bending; with it the error is of second order."""
    a, tension = 500.0, 0.0
    K = support.far_field_stiffness(a, EI, tension)
    exact = support.mid_span_stiffness(2000.0, EI)
    end = support.chain_end(K, SPACING, EI, tension)
    bare = support.chain_end(K, 1e-9, EI, tension)
    right, wrong = (abs(zone_chain(e, tension, (0,)) / exact - 1) for e in (end, bare))
    assert right < 1e-4
    assert wrong > 10 * right


# --- estimates


def test_bundle_force_against_a_loop() -> None:
    rng = np.random.default_rng(7)
    depths, k, D, pitch = rng.uniform(0, 50, 37), 5.63, 7.0, 8.028
    d = np.linspace(-1, 20, 12).reshape(3, 4)
    want = sum(k * np.maximum(0, d - h * (1 - D / pitch)) for h in depths)
    got = support.bundle_bending_force(d, depths, k, diameter=D, pitch=pitch)
    assert got.shape == (3, 4)
    assert got == pytest.approx(want, rel=1e-12, abs=1e-12)
    # touching filaments move together
    assert support.bundle_bending_force(2.0, depths, k, diameter=D, pitch=D) == pytest.approx(37 * k * 2)


def test_quasi_static_speed_bounds_the_impact() -> None:
    eps, force, kn, m = 0.05, 1e4, 3e5, 70.0
    v = support.quasi_static_speed(eps, force, kn, m)
    # a bead at rest hit by a platen at v: its spring peaks when all of m v^2/2 is in it
    assert kn * np.sqrt(m * v**2 / kn) == pytest.approx(eps * force)


@pytest.mark.parametrize(
    ("call", "key"),
    [
        (lambda: support.mid_span_stiffness(0.0, EI), "length"),
        (lambda: support.mid_span_stiffness(L, EI, -1.0), "tension"),
        (lambda: support.far_field_stiffness(L, EI, P, "free"), "far_end"),  # type: ignore[arg-type]
        (lambda: support.chain_end_stiffness(np.eye(3), 7.0, EI), "stiffness"),
        (lambda: support.chain_end(support.far_field_stiffness(L, EI, P), 7.0, EI, P, distance=100.0), "distance"),
        (lambda: support.chain_end(support.far_field_stiffness(L, EI, P), 7.0, EI, P, distance=2 * L), "distance"),
        (lambda: support.chain_end(support.far_field_stiffness(L, EI), 7.0, EI, 0.0, distance=L), "distance"),
        (lambda: support.bundle_bending_force(1.0, [1.0], 5.0, diameter=7.0, pitch=6.0), "pitch"),
        (lambda: support.bundle_bending_force(1.0, [-1.0], 5.0, diameter=7.0, pitch=8.0), "depths"),
        (lambda: support.quasi_static_speed(0.0, 1.0, 1.0, 1.0), "accuracy"),
    ],
)
def test_bad_input_names_the_key(call: object, key: str) -> None:
    with pytest.raises(InputError) as caught:
        call()  # type: ignore[operator]
    assert caught.value.key == key
