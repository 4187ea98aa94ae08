r"""Large deflection of a pre-tensioned filament under a platen: the elastica of a simply supported, sliding beam.

Units: um, nN; EI nN um2. The linear law is :func:`cgfibre.mechanics.rod.platen_compliance`.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_bvp
from scipy.interpolate import PchipInterpolator

from cgfibre.errors import InputError
from cgfibre.mechanics._checks import FloatArray, non_negative, positive
from cgfibre.mechanics.rod import platen_compliance

#: steps of the deflection over the free span at which the elastica is solved; the law between them is a cubic
STEP = 0.03
#: secant stiffness over the linear one beyond which the ends are all but under the platen's edges
STEEPEST = 4.0


@dataclass(frozen=True)
class SpringLaw:
    """Force (nN) of a filament on its supports against its deflection (um): knots from (0, 0) on.

    Between knots a monotone cubic, beyond the last one its tangent. ``reach`` um is where the filament
    would be drawn through between the platen's edges, or its ends come up to them (inf: beyond the knots).
    """

    deflection: tuple[float, ...]
    force: tuple[float, ...]
    reach: float

    def __call__(self, deflection: npt.ArrayLike) -> FloatArray:
        """Force at a deflection, nN."""
        d = np.asarray(deflection, dtype=np.float64)
        law = PchipInterpolator(self.deflection, self.force)
        last = self.deflection[-1]
        return np.where(d > last, law(last) + law(last, 1) * (d - last), law(np.minimum(d, last)))

    def stiffness(self, deflection: npt.ArrayLike) -> FloatArray:
        """Tangent stiffness, nN/um."""
        law = PchipInterpolator(self.deflection, self.force)
        return np.asarray(law(np.minimum(deflection, self.deflection[-1]), 1))


@lru_cache(maxsize=64)
def spring_law(length: float, EI: float, tension: float, width: float, deepest: float) -> SpringLaw:
    r"""Law of a simply supported filament whose ends slide under a constant pull, pushed by a flat platen.

    Inextensible, without shear: with the slope theta, the moment M and the arc length s from mid-span,

    EI theta' = M, M' = P sin(theta) - V cos(theta), x' = cos(theta), z' = sin(theta),

    V = 0 between the platen's edges (the filament sags away from the platen there) and F/2 beyond x = width/2, the
    end free to slide: M(L/2) = 0. The deflection is that of the edge, z(L/2) - z(edge) = d. Solved by collocation
    (scipy.solve_bvp) from one deflection to the next; d -> 0 gives ``platen_compliance``, P = w = 0 Bisshopp and
    Drucker's cantilever (1945). The edge pushes along z and keeps its x, as platens of segments do. Knots end where
    there is no further equilibrium (``reach``: under a wide platen it sags between the edges until it is drawn through,
    0.58 of the free span for 0.5 mm on 0.7 mm), or where the secant stiffness is STEEPEST times the linear one (its
    ends come up to the edges).

    Parameters: ``length`` L, ``width`` w < L, ``deepest`` um of the law; ``EI`` nN um2; ``tension`` P nN.
    """
    L, stiff = float(positive("length", length)), float(positive("EI", EI))
    P, w = float(non_negative("tension", tension)), float(non_negative("width", width))
    k = 1 / float(platen_compliance(L, stiff, width=w, tension=P))
    deepest = float(positive("deepest", deepest))
    half, step = L / 2, STEP * (L - w) / 2
    solver = _Elastica(P * half**2 / stiff, w / L)
    scale = 2 * stiff / half**2
    solver.start(k * step / scale)
    knots, forces, reach = [0.0], [0.0], np.inf
    while knots[-1] < deepest:
        d = knots[-1] + step
        load = solver.advance(d / half)
        # near the reach the force rises ever more steeply: halve the step until its place is known
        if load is None or load * scale > 1.5 * STEEPEST * k * d:
            if step < 1e-3 * (L - w) / 2:
                reach = d
                break
            step /= 2
            continue
        knots.append(d)
        forces.append(load * scale)
        if forces[-1] > STEEPEST * k * d:
            reach = d
            break
    if len(knots) < 2:
        raise InputError("deepest", deepest, "a deflection at which the filament can be solved")
    return SpringLaw(tuple(knots), tuple(forces), float(reach))


class _Elastica:
    """The boundary value problem in lengths of L/2: y = (theta, M, x, z) between the edges and beyond, p = (arc length
    to the edge, V); without a width (theta, M, z) and p = (V,). ``pull`` P h^2/EI, ``edge`` w/L."""

    def __init__(self, pull: float, edge: float) -> None:
        self.pull, self.edge = pull, edge
        self.p: FloatArray = np.zeros(1)

    def start(self, load: float) -> None:
        """First guess: a straight filament under ``load`` (V h^2/EI)."""
        self.s = np.linspace(0, 1, 21)
        if self.edge > 0:
            self.y = np.zeros((8, len(self.s)))
            self.y[2], self.y[6] = self.edge * self.s, self.edge + (1 - self.edge) * self.s
            self.p = np.array([self.edge, load])
        else:
            self.y, self.p = np.zeros((3, len(self.s))), np.array([load])

    def advance(self, deflection: float) -> float | None:
        """V at the next deflection; None where there is no solution."""
        found = solve_bvp(
            self._slopes,
            lambda a, b, p: self._ends(a, b, p, deflection),
            self.s,
            self.y,
            p=self.p,
            tol=1e-5,
            max_nodes=2000,
        )
        # falling back to a fifth: another branch, on which the filament has been drawn through
        if not found.success or found.p is None or not found.p[-1] > self.p[-1] * 0.2:
            return None
        self.s, self.y, self.p = found.x, found.y, np.asarray(found.p)
        return float(self.p[-1])

    def _slopes(self, s: FloatArray, y: FloatArray, p: FloatArray) -> FloatArray:
        if self.edge == 0:
            theta, moment, _ = y
            return np.array([moment, self.pull * np.sin(theta) - p[0] * np.cos(theta), np.sin(theta)])
        inner, outer = p[0], 1 - p[0]
        t, m, _, _, u, n, _, _ = y
        return np.array(
            [
                *(inner * q for q in (m, self.pull * np.sin(t), np.cos(t), np.sin(t))),
                *(outer * q for q in (n, self.pull * np.sin(u) - p[1] * np.cos(u), np.cos(u), np.sin(u))),
            ]
        )

    def _ends(self, a: FloatArray, b: FloatArray, p: FloatArray, deflection: float) -> FloatArray:
        if self.edge == 0:
            return np.array([a[0], a[2], b[1], b[2] - deflection])
        joint = a[4:] - b[:4]
        return np.array([a[0], a[2], a[3], b[2] - self.edge, *joint, b[5], b[7] - b[3] - deflection])
