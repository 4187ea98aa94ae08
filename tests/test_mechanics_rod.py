"""Rod closed forms against printed numbers, limits and assembled matrices (numpy, independent of the formulas)."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.linalg import eigh

from cgfibre.errors import InputError
from cgfibre.mechanics import rod

D, EA, EI, GJ, KGA = 7.0, 8.851e9, 2.711e10, 6.435e9, 0.9 * 1.05e9
P = 4e5


def turn_rows(s: np.ndarray, closed: bool = False) -> np.ndarray:
    """(n_angles, n_beads) turn angle of every interior bead per deflection."""
    n = len(s) if closed else len(s) + 1
    rows = []
    for i in range(n) if closed else range(1, n - 1):
        row = np.zeros(n)
        before, after = s[i - 1], s[i] if i < len(s) else s[0]
        row[(i - 1) % n] += 1 / before
        row[i] -= 1 / before + 1 / after
        row[(i + 1) % n] += 1 / after
        rows.append(row)
    return np.array(rows).reshape(-1, n)


def difference_rows(s: np.ndarray, closed: bool = False) -> np.ndarray:
    """(n_bonds, n_beads) difference of the two ends of every bond."""
    n = len(s) if closed else len(s) + 1
    rows = np.zeros((len(s), n))
    b = np.arange(len(s))
    rows[b, b] -= 1
    rows[b, (b + 1) % n] += 1
    return rows


def chain_matrices(
    s: np.ndarray, c: rod.ChainCoefficients, tension: float = 0.0, closed: bool = False
) -> tuple[np.ndarray, np.ndarray]:
    """Axial and transverse stiffness of a straight chain."""
    d, t = difference_rows(s, closed), turn_rows(s, closed)
    axial = d.T @ (2 * c.bond[:, None] * d)
    return axial, t.T @ (c.angle[:, None] * t) + d.T @ ((tension / s)[:, None] * d)


def rod_matrix(s: np.ndarray, c: rod.RodCoefficients, tension: float = 0.0) -> np.ndarray:
    """Bending stiffness of a straight rod in (w_0..w_n, theta_0..theta_n)."""
    n = len(s) + 1
    d = difference_rows(s)
    shear = np.hstack([d, -s[:, None] / 2 * np.abs(d)])
    bend, string = np.hstack([0 * d, d]), np.hstack([d, 0 * d])
    assert shear.shape == (n - 1, 2 * n)
    return sum(v.T @ (k[:, None] * v) for v, k in ((shear, c.ks), (bend, c.kb), (string, tension / s)))  # type: ignore[return-value]


def deflect(K: np.ndarray, held: list[int], loads: dict[int, float]) -> np.ndarray:
    free = np.setdiff1d(np.arange(len(K)), held)
    f = np.zeros(len(K))
    for i, value in loads.items():
        f[i] = value
    w = np.zeros(len(K))
    w[free] = np.linalg.solve(K[np.ix_(free, free)], f[free])
    return w


def graded(rng: np.random.Generator, n: int) -> np.ndarray:
    return D * np.exp(rng.uniform(-1, 3, n))


def test_section_of_t700() -> None:
    # thesis Table 4-1: EA = 8.851 N; I = 1.18e-10 mm4 (printed as EI); EI = 2.711e-5 N mm2; GJ = 6.435e-6 N mm2
    assert 230e6 * rod.circle_area(D) == pytest.approx(8.851e9, rel=1e-4)
    assert rod.circle_second_moment(D) == pytest.approx(118, rel=2e-3)
    assert 230e6 * rod.circle_second_moment(D) == pytest.approx(2.711e10, rel=1e-4)
    assert 27.3e6 * rod.circle_polar_moment(D) == pytest.approx(6.435e9, rel=1e-4)
    assert rod.circle_shear_coefficient([0.0, 0.5]) == pytest.approx([6 / 7, 0.9])


def test_even_chain_coefficients_are_those_measured() -> None:
    c = rod.chain_coefficients(np.full(5, 3.5), EA, EI, clamped=(True, False))
    assert c.bond == pytest.approx(np.full(5, EA / 7))
    assert c.angle == pytest.approx(EI / 3.5 * np.array([2, 1, 1, 1]))


@pytest.mark.parametrize("closed", [False, True])
def test_graded_chain_stores_the_energy_of_an_even_curvature(closed: bool) -> None:
    s = graded(np.random.default_rng(1), 9)
    c = rod.chain_coefficients(s, EA, EI, closed=closed)
    if closed:
        # every half bond belongs to one hinge
        assert np.sum(EI / c.angle) == pytest.approx(np.sum(s))
        return
    x = np.concatenate([[0], np.cumsum(s)])
    curvature = 1e-5
    turn = turn_rows(s) @ (curvature * x**2 / 2)
    energy = np.sum(c.angle * turn**2) / 2
    assert energy == pytest.approx(EI * curvature**2 / 2 * (x[-1] - (s[0] + s[-1]) / 2), rel=1e-9)


# lammps-findings, L = 40 D: the engine's errors at s/D = 0.5, 1, 2, 4; the assembled chain must have the same
@pytest.mark.parametrize(("ratio", "measured"), [(0.5, 6e-5), (1, 2.7e-4), (2, 1.2e-3), (4, 4.9e-3)])
def test_cantilever_chain(ratio: float, measured: float) -> None:
    s = np.full(round(40 / ratio) + 1, ratio * D)
    _, K = chain_matrices(s, rod.chain_coefficients(s, EA, EI, clamped=(True, False)))
    tip = deflect(K, [0, 1], {len(s): 1.0})[-1]
    assert abs(tip / rod.cantilever_deflection(1.0, 40 * D, EI) - 1) < 1.4 * measured


@pytest.mark.parametrize(("ratio", "measured"), [(0.5, 3e-4), (1, 1.2e-3), (2, 5e-3), (4, 2e-2)])
def test_three_point_chain(ratio: float, measured: float) -> None:
    n = round(40 / ratio)
    s = np.full(n, ratio * D)
    _, K = chain_matrices(s, rod.chain_coefficients(s, EA, EI))
    w = deflect(K, [0, n], {n // 2: 1.0})[n // 2]
    exact = rod.three_point_deflection(1.0, 40 * D, EI)
    assert exact == pytest.approx((40 * D) ** 3 / (48 * EI))
    assert abs(w / exact - 1) < 1.1 * measured


def test_graded_chain_bends_as_the_beam() -> None:
    s = np.geomspace(3.5, 40, 30)
    s = np.concatenate([s[::-1], s])
    n, L = len(s), float(np.sum(s))
    _, K = chain_matrices(s, rod.chain_coefficients(s, EA, EI), P)
    w = deflect(K, [0, n], {n // 2: 1.0})[n // 2]
    assert w == pytest.approx(rod.three_point_deflection(1.0, L, EI, tension=P), rel=1e-3)


def test_cantilever_rod_is_exact_at_every_spacing() -> None:
    for n in (1, 3, 10):
        s = np.full(n, 40 * D / n)
        K = rod_matrix(s, rod.rod_coefficients(s, EA, EI, GJ, KGA))
        tip = deflect(K, [0, n + 1], {n: 1.0})[n]
        assert tip == pytest.approx(rod.cantilever_deflection(1.0, 40 * D, EI, kGA=KGA), rel=1e-9)


def test_rod_coefficients() -> None:
    c = rod.rod_coefficients(D, EA, EI, GJ, KGA)
    assert (c.kr, c.kt, c.kb) == pytest.approx((EA / D, GJ / D, EI / D))
    assert 1 / c.ks == pytest.approx(D / KGA + D**3 / (12 * EI))
    assert rod.rod_coefficients(D, EA, EI, GJ, np.inf).ks == pytest.approx(12 * EI / D**3)


def test_pre_tension_by_rest_length() -> None:
    assert rod.axial_strain(P, EA) == pytest.approx(4.519e-5, rel=1e-3)
    natural = rod.rest_length(np.array([7.0, 28.0]), P, EA)
    assert EA * (np.array([7.0, 28.0]) / natural - 1) == pytest.approx([P, P], rel=1e-9)
    with pytest.raises(InputError, match="tension"):
        rod.rest_length(7.0, -EA, EA)


# --- frequencies and bounds


@pytest.mark.parametrize("spacing", [0.5, 7.0, 28.0])
@pytest.mark.parametrize("tension", [0.0, 1e9])
def test_even_chain_limit_is_the_highest_eigenvalue(spacing: float, tension: float) -> None:
    n, m = 40, 123.0
    s = np.full(n, spacing)
    c = rod.chain_coefficients(s, EA, EI, closed=True)
    highest = max(np.linalg.eigvalsh(K)[-1] for K in chain_matrices(s, c, tension, closed=True)) / m
    assert rod.chain_frequency_squared(spacing, m, EA, EI, tension=tension) == pytest.approx(highest, rel=1e-10)
    bound = rod.chain_stiffness_bound(s, c, tension, closed=True)
    assert bound / m == pytest.approx(np.full(n, highest), rel=1e-10)


def test_chain_limit_of_carbon() -> None:
    # lammps-findings: from s = D/2 on the limit of the step is s/c, 6.2e-4 us at s = D
    mass = 1.8 * rod.circle_area(D) * D
    limit = 2 / np.sqrt(rod.chain_frequency_squared(D, mass, EA, EI))
    assert limit == pytest.approx(D / np.sqrt(230e6 / 1.8), rel=1e-4)
    assert limit == pytest.approx(6.2e-4, rel=5e-3)
    assert rod.chain_frequency_squared(D, mass, EA, EI, kn=1e12) == pytest.approx(14e12 / mass)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 25), tension=st.sampled_from([0.0, P, 1e10]))
def test_bound_of_a_graded_chain_holds_and_is_met(seed: int, n: int, tension: float) -> None:
    rng = np.random.default_rng(seed)
    s = graded(rng, n)
    clamp = (n > 2, False)
    c = rod.chain_coefficients(s, EA, EI, clamped=clamp)
    k = rod.chain_stiffness_bound(s, c, tension)
    matrices = chain_matrices(s, c, tension)
    m = np.exp(rng.uniform(-3, 3, n + 1))
    highest = max(eigh(K, np.diag(m), eigvals_only=True)[-1] for K in matrices)
    assert highest <= np.max(k / m) * (1 + 1e-9)
    # masses in proportion to one row sum alone: the alternating mode meets the bound exactly
    rows = np.sum(np.abs(matrices[1]), axis=1)
    if n > 1:
        sums = rod.chain_stiffness_bound(s, rod.ChainCoefficients(0 * c.bond, c.angle), tension)
        assert sums == pytest.approx(rows, rel=1e-9)
        assert eigh(matrices[1], np.diag(rows), eigvals_only=True)[-1] == pytest.approx(1, rel=1e-9)


def test_closed_graded_chain_bound_is_the_row_sum() -> None:
    s = graded(np.random.default_rng(3), 7)
    c = rod.chain_coefficients(s, EA, EI, closed=True)
    axial, transverse = (np.sum(np.abs(K), axis=1) for K in chain_matrices(s, c, P, closed=True))
    assert rod.chain_stiffness_bound(s, c, P, closed=True) == pytest.approx(np.maximum(axial, transverse))
    assert rod.chain_stiffness_bound(s, c, P, closed=True, bent=True) == pytest.approx(axial + transverse)


def test_bent_bound_covers_crooked_chains() -> None:
    rng = np.random.default_rng(0)
    n, eps = 10, 1e-6
    for _ in range(40):
        s = D * np.exp(rng.uniform(-1.5, rng.uniform(-1, 3), n))
        c = rod.chain_coefficients(s, EA, EI)
        heading = np.cumsum(rng.normal(0, rng.uniform(0, 0.8), n))
        steps = s[:, None] * np.stack([np.cos(heading), np.sin(heading)], axis=1)
        base = np.concatenate([[[0.0, 0.0]], np.cumsum(steps, axis=0)]).ravel()

        def rows(flat: np.ndarray, c: rod.ChainCoefficients = c) -> np.ndarray:
            b = np.diff(flat.reshape(-1, 2), axis=0)
            cross = b[:-1, 0] * b[1:, 1] - b[:-1, 1] * b[1:, 0]
            turn = np.arctan2(cross, np.sum(b[:-1] * b[1:], axis=1))
            return np.concatenate([np.sqrt(2 * c.bond) * np.hypot(*b.T), np.sqrt(c.angle) * turn])

        J = np.array([(rows(base + eps * e) - rows(base - eps * e)) / (2 * eps) for e in np.eye(base.size)]).T
        for bent, most in ((True, 1.0), (False, 1.03)):
            mass = np.diag(np.repeat(rod.chain_stiffness_bound(s, c, bent=bent), 2))
            assert eigh(J.T @ J, mass, eigvals_only=True)[-1] <= most


def test_bound_broadcasts_over_chains() -> None:
    s = graded(np.random.default_rng(4), 12).reshape(3, 4)
    many = rod.chain_stiffness_bound(s, rod.chain_coefficients(s, EA, EI), P)
    for row, k in zip(s, many, strict=True):
        assert k == pytest.approx(rod.chain_stiffness_bound(row, rod.chain_coefficients(row, EA, EI), P))


def test_mass_and_time_step_are_each_other_s_inverse() -> None:
    s = graded(np.random.default_rng(5), 20)
    k = rod.chain_stiffness_bound(s, rod.chain_coefficients(s, EA, EI), P)
    mass = rod.mass_for_time_step(k, 1e-3, fraction=0.65)
    assert 0.65 * rod.limiting_time_step(k, mass) == pytest.approx(1e-3)
    highest = max(
        eigh(K, np.diag(mass), eigvals_only=True)[-1] for K in chain_matrices(s, rod.chain_coefficients(s, EA, EI), P)
    )
    # not merely safe: within a factor of the true limit, since every bead is at its own bound
    assert 0.65 * 2 / np.sqrt(highest) == pytest.approx(1e-3, rel=0.05)
    assert 0.65 * 2 / np.sqrt(highest) >= 1e-3 * (1 - 1e-12)


def rod_bloch_highest(s: float, m: float, c: rod.RodCoefficients) -> float:
    inertia = 0.1 * m * D**2
    highest = max(4 * float(c.kr) / m, 4 * float(c.kt) / inertia)
    for q in np.linspace(0, np.pi, 501):
        step, mean = np.exp(1j * q) - 1, -s / 2 * (np.exp(1j * q) + 1)
        v = np.array([step / np.sqrt(m), mean / np.sqrt(inertia)])
        K = c.ks * np.outer(v.conj(), v)
        K[1, 1] += c.kb * abs(step) ** 2 / inertia
        highest = max(highest, np.linalg.eigvalsh(K)[-1])
    return highest


@pytest.mark.parametrize("ratio", [0.25, 0.5, 1.0, 2.0, 4.0])
def test_even_rod_limit_is_the_highest_of_all_waves(ratio: float) -> None:
    s, m = ratio * D, 100.0
    c = rod.rod_coefficients(s, EA, EI, GJ, KGA)
    got = rod.rod_frequency_squared(s, m, D, c)
    assert got == pytest.approx(rod_bloch_highest(s, m, c), rel=1e-4)
    n = 6
    bound = rod.rod_stiffness_bound(np.full(n, s), D, c, closed=True) / m
    assert bound == pytest.approx(np.full(n, bound[0]))
    assert got <= bound[0] * (1 + 1e-12)


def test_rod_limit_exceeds_the_plain_maximum_where_bending_terms_are_alike() -> None:
    s, m = D, 1.0
    rho2 = 0.1 * D**2
    c = rod.RodCoefficients(np.array(1e-3), np.array(1.0), np.array(1e-3), np.array(rho2))
    got = rod.rod_frequency_squared(np.sqrt(4 * rho2), m, D, c)
    # a = b = d = 4: the interior maximum is 4/3 of them
    assert got == pytest.approx(16 / 3, rel=1e-12)
    assert got == pytest.approx(rod_bloch_highest(float(np.sqrt(4 * rho2)), m, c), rel=1e-4)
    assert rod.rod_frequency_squared(s, m, D, c, kn=100.0) == pytest.approx(1400)


@settings(deadline=None, max_examples=30)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 20), tension=st.sampled_from([0.0, 1e9]))
def test_bound_of_a_graded_rod_holds(seed: int, n: int, tension: float) -> None:
    rng = np.random.default_rng(seed)
    s = graded(rng, n)
    c = rod.rod_coefficients(s, EA, EI, GJ, KGA)
    m = np.exp(rng.uniform(-3, 3, n + 1))
    k = rod.rod_stiffness_bound(s, D, c, tension)
    inertia = 0.1 * m * D**2
    d = difference_rows(s)
    highest = max(
        eigh(rod_matrix(s, c, tension), np.diag(np.concatenate([m, inertia])), eigvals_only=True)[-1],
        eigh(d.T @ (c.kr[:, None] * d), np.diag(m), eigvals_only=True)[-1],
        eigh(d.T @ (c.kt[:, None] * d), np.diag(inertia), eigvals_only=True)[-1],
    )
    assert highest <= np.max(k / m) * (1 + 1e-9)


def hexagonal_highest(kt: float, inertia: float) -> float:
    """Highest omega^2 m/kn over all waves of a hexagonal lattice of touching discs (D = 1), all contacts sticking."""
    normals = [np.array([np.cos(a), np.sin(a)]) for a in np.arange(3) * np.pi / 3]
    highest = 0.0
    for qx in np.linspace(0, 2 * np.pi, 13):
        for qy in np.linspace(0, 2 * np.pi, 13):
            K, out = np.zeros((3, 3), complex), 0.0
            for n in normals:
                t = np.array([-n[1], n[0]])
                p = np.exp(1j * (qx * n[0] + qy * n[1] * 2 / np.sqrt(3)))
                rows = [(1.0, np.append((p - 1) * n, 0))]
                rows.append((kt, np.append((p - 1) * t, -(p + 1) / 2 / np.sqrt(inertia))))
                K += sum(k * np.outer(v.conj(), v) for k, v in rows)
                out += kt * abs(p - 1) ** 2
            highest = max(highest, np.linalg.eigvalsh(K)[-1], out)
    return highest


def test_contact_bound() -> None:
    still = hexagonal_highest(0.8, 1e12)
    bound = rod.contact_stiffness_bound(1.0)
    assert still <= bound < rod.CONTACT_BOUND
    assert bound == pytest.approx(10.8)
    # spin: all turning the same way is a mode of the lattice itself
    assert hexagonal_highest(0.8, 0.125) == pytest.approx(rod.contact_stiffness_bound(1.0, inertia=0.125))
    assert rod.contact_stiffness_bound(1.0, inertia=0.125) == pytest.approx(19.2)
    assert hexagonal_highest(0.8, 0.1) == pytest.approx(24) == rod.contact_stiffness_bound(1.0, inertia=0.1)


# --- statics


def test_tension_functions_against_their_definitions() -> None:
    x = np.array([1.5, 5.0, 20.0])
    assert rod.scaled_sinh(x) == pytest.approx(np.sinh(x) * np.exp(-x) / x, rel=1e-14)
    assert rod.scaled_cosh(x) == pytest.approx(np.cosh(x) * np.exp(-x), rel=1e-14)
    assert rod.scaled_sinh_excess(x) == pytest.approx(6 * (np.sinh(x) - x) * np.exp(-x) / x**3, rel=1e-13)
    assert rod.scaled_bending(x) == pytest.approx(3 * (x * np.cosh(x) - np.sinh(x)) * np.exp(-x) / x**3, rel=1e-13)
    for f in (rod.scaled_sinh, rod.scaled_cosh, rod.scaled_sinh_excess, rod.scaled_bending):
        assert f(np.array(0.0)) == 1
        # no step where the series takes over
        low, high = f(np.array([1 - 1e-12, 1 + 1e-12]))
        assert low == pytest.approx(high, rel=1e-11)


@pytest.mark.parametrize("x", [1e-3, 0.3, 3.0, 30.0])
@pytest.mark.parametrize("width", [0.0, 0.2, 0.9])
def test_platen_compliance_against_a_fine_chain(x: float, width: float) -> None:
    L, n = 700.0, 600
    tension = EI * (2 * x / L) ** 2
    s = np.full(n, L / n)
    _, K = chain_matrices(s, rod.chain_coefficients(s, EA, EI), tension)
    left = n // 2 - round(width * n / 2)
    loads = {left: 0.5, n - left: 0.5} if width else {left: 1.0}
    w = deflect(K, [0, n], loads)[left]
    # (lambda s)^2 = 4e-3 at x = 30
    assert rod.platen_compliance(L, EI, width=width * L, tension=tension) == pytest.approx(w, rel=1e-3)


@pytest.mark.parametrize("x", [2.0, 5.0, 300.0])
def test_platen_compliance_against_its_printed_form(x: float) -> None:
    L, w = 700.0, 200.0
    lam = 2 * x / L
    tension = EI * lam**2
    a = (L - w) / 2
    ratio = np.exp(lam * (a + w / 2 - L / 2)) * (1 - np.exp(-2 * lam * a)) * (1 + np.exp(-lam * w)) / 2
    want = a / (2 * tension) - ratio / (1 + np.exp(-lam * L)) / (2 * tension * lam)
    assert rod.platen_compliance(L, EI, width=w, tension=tension) == pytest.approx(want, rel=1e-12)
    mid = L / (4 * tension) - np.tanh(lam * L / 2) / (2 * tension * lam)
    assert rod.three_point_deflection(3.0, L, EI, tension=tension) == pytest.approx(3 * mid, rel=1e-12)


def test_platen_without_tension() -> None:
    L, w = 700.0, 200.0
    a = (L - w) / 2
    # four-point bending, deflection under the loads: F/2 a^2 (3 L - 4 a)/(6 EI)
    want = a**2 * (3 * L - 4 * a) / (12 * EI)
    assert rod.platen_compliance(L, EI, width=w) == pytest.approx(want, rel=1e-12)
    assert rod.platen_force(2.0, L, EI, width=w) == pytest.approx(2 / want, rel=1e-12)
    near = rod.platen_compliance(L, EI, width=w, tension=EI * (2e-5 / L) ** 2)
    assert near == pytest.approx(want, rel=1e-9)


@pytest.mark.parametrize("tension", [0.0, 0.3 * KGA])
def test_timoshenko_three_point_against_a_fine_rod(tension: float) -> None:
    n, L = 400, 10 * D
    s = np.full(n, L / n)
    K = rod_matrix(s, rod.rod_coefficients(s, EA, EI, GJ, KGA), tension)
    w = deflect(K, [0, n], {n // 2: 1.0})[n // 2]
    got = rod.three_point_deflection(1.0, L, EI, tension=tension, kGA=KGA)
    assert got == pytest.approx(w, rel=1e-4)
    if tension == 0:
        assert got == pytest.approx(L**3 / (48 * EI) + L / (4 * KGA), rel=1e-12)


def test_axial_and_torsion_of_a_row_of_springs() -> None:
    s = graded(np.random.default_rng(6), 8)
    c = rod.rod_coefficients(s, EA, EI, GJ, KGA)
    assert rod.axial_elongation(P, np.sum(s), EA) == pytest.approx(np.sum(P / c.kr))
    assert rod.twist_angle(1e6, np.sum(s), GJ) == pytest.approx(np.sum(1e6 / c.kt))


@pytest.mark.parametrize("mode", [1, 2])
def test_bending_frequency_of_a_chain(mode: int) -> None:
    n, L, line = 200, 700.0, 69.27
    s = np.full(n, L / n)
    _, K = chain_matrices(s, rod.chain_coefficients(s, EA, EI), P)
    inner = slice(1, n)
    omega2 = np.linalg.eigvalsh(K[inner, inner])[mode - 1] / (line * s[0])
    assert rod.bending_frequency(L, EI, line, tension=P, mode=mode) ** 2 == pytest.approx(omega2, rel=1e-3)
    with pytest.raises(InputError, match="tension"):
        rod.bending_frequency(L, EI, line, tension=-1.01 * rod.euler_buckling_load(L, EI))


def test_buckling_loads() -> None:
    n, L = 60, 40 * D
    s = np.full(n, L / n)
    _, K = chain_matrices(s, rod.chain_coefficients(s, EA, EI))
    d = difference_rows(s)
    G = d.T @ (d / s[:, None])
    inner = slice(1, n)
    load = 1 / eigh(G[inner, inner], K[inner, inner], eigvals_only=True)[-1]
    assert rod.euler_buckling_load(L, EI) == pytest.approx(load, rel=5e-4)
    assert rod.euler_buckling_load(L, EI, effective_length=0.5) == pytest.approx(4 * load, rel=5e-4)
    short = 4 * D
    s = np.full(n, short / n)
    K = rod_matrix(s, rod.rod_coefficients(s, EA, EI, GJ, KGA))
    G = np.zeros_like(K)
    G[: n + 1, : n + 1] = d.T @ (d / s[:, None])
    free = np.setdiff1d(np.arange(2 * n + 2), [0, n])
    load = 1 / eigh(G[np.ix_(free, free)], K[np.ix_(free, free)], eigvals_only=True)[-1]
    assert rod.timoshenko_buckling_load(short, EI, KGA) == pytest.approx(load, rel=1e-3)
    assert load < 0.9 * rod.euler_buckling_load(short, EI)


@pytest.mark.parametrize(
    ("call", "key"),
    [
        (lambda: rod.circle_area(-1.0), "diameter"),
        (lambda: rod.circle_shear_coefficient(0.6), "nu"),
        (lambda: rod.chain_coefficients(7.0, EA, EI), "lengths"),
        (lambda: rod.chain_coefficients([7.0, 7.0], EA, EI, closed=True), "lengths"),
        (lambda: rod.chain_coefficients([7.0, np.nan], EA, EI), "lengths"),
        (lambda: rod.chain_coefficients([7.0] * 4, EA, EI, closed=True, clamped=(True, False)), "clamped"),
        (lambda: rod.chain_coefficients([7.0, 7.0], EA, EI, clamped=(True, True)), "lengths"),
        (lambda: rod.rod_coefficients(7.0, EA, EI, GJ, 0.0), "kGA"),
        (lambda: rod.platen_compliance(100.0, EI, width=100.0), "width"),
        (lambda: rod.platen_compliance(100.0, EI, tension=-1.0), "tension"),
        (lambda: rod.bending_frequency(100.0, EI, 1.0, mode=0), "mode"),
        (lambda: rod.mass_for_time_step(1.0, 1.0, fraction=1.5), "fraction"),
        (lambda: rod.contact_stiffness_bound(1.0, neighbours=2), "neighbours"),
    ],
)
def test_bad_input_names_the_key(call: object, key: str) -> None:
    with pytest.raises(InputError) as caught:
        call()  # type: ignore[operator]
    assert caught.value.key == key


def test_packed_contacts_limit_the_step_as_their_own_lattice_does():
    """Against the Bloch frequencies of a hexagonal lattice with normal and tangential springs, no spin and spin.

    The highest without spin lies beside the corner of the Brillouin zone, 0.2 % above it.
    """
    kn, r, m, J = 3.0, 0.8, 2.0, 0.125
    angles = np.arange(6) * np.pi / 3
    normal = np.column_stack([np.cos(angles), np.sin(angles)])
    tangent = np.column_stack([-np.sin(angles), np.cos(angles)])
    q = np.stack(np.meshgrid(np.linspace(-2 * np.pi, 2 * np.pi, 121), np.linspace(-2 * np.pi, 2 * np.pi, 121)), -1)
    phase = q.reshape(-1, 2) @ normal.T  # lattice of unit pitch = D
    # deflection u (2) and turn t; a contact feels (u_j - u_i).n, (u_j - u_i).t - (t_i + t_j) D/2
    K = np.zeros((len(phase), 3, 3), dtype=complex)
    for b in range(6):
        e = np.exp(1j * phase[:, b])
        gap = np.zeros((len(phase), 3), dtype=complex)
        gap[:, :2] = (e - 1)[:, None] * normal[b]
        slip = np.zeros((len(phase), 3), dtype=complex)
        slip[:, :2] = (e - 1)[:, None] * tangent[b]
        slip[:, 2] = -(1 + e) / 2
        for row, k in ((gap, kn), (slip, r * kn)):
            K += 0.5 * k * row.conj()[:, :, None] * row[:, None, :]
    without = np.linalg.eigvalsh(K[:, :2, :2] / m)[:, -1].max()
    mass = np.diag([m, m, J * m]) ** 0.5
    scale = np.linalg.inv(mass)
    spinning = np.linalg.eigvalsh(scale @ K @ scale)[:, -1].max()
    assert rod.packed_time_step(kn, 0.0, m, kt_ratio=r) == pytest.approx(2 / np.sqrt(without), rel=2e-3)
    found = rod.packed_time_step(kn, 0.0, m, kt_ratio=r, inertia=J)
    assert found == pytest.approx(2 / np.sqrt(spinning), rel=1e-3)
    assert rod.packed_time_step(kn, 1.0, m, inertia=J) < 0.6 * found
