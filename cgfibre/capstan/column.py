"""Quasi-static capstan model: a column of filaments over a pulley, one on the other, with the stick-slip law.

Model (i) of Chakladar 2014, 4.3, is one filament with the axial stiffness of all; model (ii) has each of them. Nodes
stand at equal angles on the pulley; each filament is a chain of springs EA/l between them, with the free length up to
the moving crosshead as one more spring and a dead load W/n on the other end. Inertia, bending and the radius of the
column against that of the pulley are left out. Units: um, us, nN.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.linalg import solve_banded

from cgfibre.errors import EngineError, InputError
from cgfibre.mechanics.stick_slip import Contacts, StickSlipLaw

FloatArray = npt.NDArray[np.float64]

#: residual force over the dead load of a filament at which a step has converged
TOLERANCE = 1e-9
MOST_ITERATIONS = 40
LARGEST_TURN = 0.5  # rad at a node
#: a step that does not converge is cut in half, this many times at most
MOST_CUTS = 10


@dataclass(frozen=True)
class Column:
    """What is modelled: ``filaments`` one on the other, of axial stiffness ``EA`` (nN) each, over ``nodes``.

    ``load`` (nN) is the dead load on all of them together, ``radius`` (um) that of the pulley, ``wrap`` in rad,
    ``free_length`` (um) from the pulley to the crosshead, which moves at ``speed`` (um/us). ``pulley`` is the law
    between the lowest filament and the pulley, ``between`` that of filament on filament.
    """

    filaments: int
    nodes: int
    EA: float
    load: float
    radius: float
    wrap: float
    free_length: float
    speed: float
    pulley: StickSlipLaw
    between: StickSlipLaw

    def __post_init__(self) -> None:
        for name in ("filaments", "nodes"):
            if getattr(self, name) < 1:
                raise InputError(name, getattr(self, name), "1 or more")
        for name in ("EA", "load", "radius", "wrap", "free_length", "speed"):
            value = getattr(self, name)
            if not (value > 0 and math.isfinite(value)):
                raise InputError(name, value, "a positive number")
        if self.turn > LARGEST_TURN:
            raise InputError("nodes", self.nodes, f"{math.ceil(self.wrap / LARGEST_TURN)} or more on this wrap")

    @property
    def spring(self) -> float:
        """Stiffness of a filament between two nodes, EA/l with l = R theta/n, nN/um."""
        return self.EA * self.nodes / (self.radius * self.wrap)

    @property
    def turn(self) -> float:
        """Angle of a filament at a node, theta/n."""
        return self.wrap / self.nodes


@dataclass(frozen=True)
class ColumnResult:
    """What a pull gave: at ``time`` (m,) us the force (m, n) nN of each filament on the crosshead.

    ``tension`` (k, n, nodes + 1) nN is that between the nodes, from the load to the crosshead, at the times ``kept``
    (k,) us; ``slip`` (k, n, nodes) um that of each filament on what lies below; ``iterations`` a step on average.
    """

    time: FloatArray
    force: FloatArray
    kept: FloatArray
    tension: FloatArray
    slip: FloatArray
    iterations: float

    @property
    def total(self) -> FloatArray:
        """Force (m,) nN on the crosshead."""
        return self.force.sum(axis=1)


class _Stepper:
    """Equilibrium of a column at a displacement of the crosshead, by Newton's method from the state before."""

    def __init__(self, column: Column) -> None:
        c = self.column = column
        n, m = c.filaments, c.nodes
        self.u = np.zeros((n, m))
        self.on_pulley = Contacts.at_rest(m)
        self.on_filament = Contacts.at_rest((n - 1) * m)
        #: stiffness of the segments 0 .. m: none towards the dead load, the free length last
        self.k = np.concatenate([[0.0], np.full(m - 1, c.spring), [c.EA / c.free_length]])
        self.load = c.load / n
        self.tan = math.tan(c.turn / 2)
        self.band = 2 * n - 1
        upper = np.triu(np.ones((n, n)))
        self.push = np.eye(n, k=1) - np.eye(n)  # a filament is held by what lies below and holds what lies above
        self.over = self.tan * np.einsum("ab,bc->abc", self.push, upper)  # over[:, k, :] mu_k
        self.slide = np.einsum("ab,bc->abc", self.push, np.eye(n) - np.eye(n, k=-1))
        self.places = [self._places(offset) for offset in (-1, 0, 1)]
        self.iterations = 0

    def _places(self, offset: int) -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
        """Rows and columns, in the banded matrix, of the blocks that couple node i to node i + offset."""
        n, m = self.column.filaments, self.column.nodes
        at = np.arange(max(0, -offset), m - max(0, offset))
        row = (at[:, None, None] * n + np.arange(n)[None, :, None]) + np.zeros((1, 1, n), dtype=np.int64)
        column = ((at + offset)[:, None, None] * n + np.arange(n)[None, None, :]) + np.zeros((1, n, 1), dtype=np.int64)
        return self.band + row - column, column

    def tensions(self, u: FloatArray, pulled: float) -> FloatArray:
        """(n, nodes + 1) tensions between the nodes at their displacements along the belt."""
        stretch = np.diff(u, axis=1, prepend=u[:, :1], append=pulled)
        return self.load + self.k * stretch

    def step(self, pulled: float, ahead: float) -> FloatArray:
        """Go to the crosshead's displacement ``pulled``, guessing that all nodes go ``ahead``; tensions there."""
        n, m = self.column.filaments, self.column.nodes
        u = self.u + ahead
        last = math.inf
        for _ in range(MOST_ITERATIONS):
            self.iterations += 1
            tension = self.tensions(u, pulled)
            press = tension[:, 1:] + tension[:, :-1]
            normal = np.cumsum(press[::-1], axis=0)[::-1] * self.tan
            mu, slope = np.empty((n, m)), np.empty((n, m))
            mu[0], slope[0], pulley = self.column.pulley.follow(self.on_pulley, u[0])
            between = self.on_filament
            if n > 1:
                a, b, between = self.column.between.follow(self.on_filament, np.diff(u, axis=0).ravel())
                mu[1:], slope[1:] = a.reshape(n - 1, m), b.reshape(n - 1, m)
            held = mu * normal
            residual = np.diff(tension, axis=1) - held
            residual[:-1] += held[1:]
            worst = float(np.abs(residual).max())
            if worst <= TOLERANCE * self.load:
                self.u, self.on_pulley, self.on_filament = u, pulley, between
                return tension
            if not math.isfinite(worst) or (worst > 1e3 * last and worst > self.load):
                break
            last = worst
            u = u - self._solve(mu, slope * normal, residual)
        raise ArithmeticError

    def _solve(self, mu: FloatArray, stiff: FloatArray, residual: FloatArray) -> FloatArray:
        """Newton's step: the tangent of the residual is block tridiagonal, node by node."""
        n, m = self.column.filaments, self.column.nodes
        k = self.k
        rub = np.einsum("abc,bi->iac", self.over, mu)  # how friction follows the tensions
        eye = np.eye(n)
        low, high = k[:-1, None, None], k[1:, None, None]
        here = -(low + high) * eye + (low - high) * rub + np.einsum("abc,bi->iac", self.slide, stiff)
        right = (high * (eye + rub))[:-1]
        left = (low * (eye - rub))[1:]
        matrix = np.zeros((2 * self.band + 1, n * m))
        for (row, column), block in zip(self.places, (left, here, right), strict=True):
            matrix[row, column] = block
        x = solve_banded((self.band, self.band), matrix, residual.T.ravel(), overwrite_ab=True, check_finite=False)
        return np.asarray(x.reshape(m, n).T)

    def snapshot(self) -> tuple[FloatArray, Contacts, Contacts]:
        """What a step changes."""
        return self.u, self.on_pulley, self.on_filament

    def restore(self, state: tuple[FloatArray, Contacts, Contacts]) -> None:
        """Back to a snapshot."""
        self.u, self.on_pulley, self.on_filament = state


def pull(column: Column, duration: float, step: float, kept: npt.ArrayLike = ()) -> ColumnResult:
    """Pull a column at its speed for ``duration`` us in steps of ``step`` us; tensions along the wrap at ``kept`` us
    (the nearest steps) and at the end.

    A step that does not converge is cut in half, ten times over at most; raises EngineError where that is not enough.
    """
    if not 0 < step <= duration:
        raise InputError("step", step, f"above 0 and at most the duration, {duration:g} us")
    steps = round(duration / step)
    marks = {min(steps, max(0, round(float(t) / step))) for t in np.atleast_1d(np.asarray(kept, dtype=float))} | {steps}
    stepper = _Stepper(column)
    n = column.filaments
    force = np.empty((steps + 1, n))
    force[0] = stepper.load
    tensions: dict[int, FloatArray] = {}
    slips: dict[int, FloatArray] = {}

    def keep(i: int, tension: FloatArray) -> None:
        if i in marks:
            tensions[i] = tension
            slips[i] = np.concatenate([stepper.u[:1], np.diff(stepper.u, axis=0)])

    keep(0, np.full((n, column.nodes + 1), stepper.load))
    for i in range(1, steps + 1):
        tension = _advance(stepper, (i - 1) * step, i * step)
        force[i] = tension[:, -1]
        keep(i, tension)
    order = sorted(tensions)
    return ColumnResult(
        np.asarray(np.arange(steps + 1) * step),
        force,
        np.array(order) * step,
        np.array([tensions[i] for i in order]),
        np.array([slips[i] for i in order]),
        stepper.iterations / steps,
    )


def _advance(stepper: _Stepper, before: float, after: float, cuts: int = 0) -> FloatArray:
    speed = stepper.column.speed
    state = stepper.snapshot()
    try:
        return stepper.step(speed * after, speed * (after - before))
    except (ArithmeticError, np.linalg.LinAlgError, ValueError):
        stepper.restore(state)
    if cuts == MOST_CUTS:
        raise EngineError(
            f"the quasi-static capstan model finds no equilibrium at {before:.6g} us",
            "a shorter capstan.step, or a longer critical_slip or drop_slip",
        )
    middle = 0.5 * (before + after)
    _advance(stepper, before, middle, cuts + 1)
    return _advance(stepper, middle, after, cuts + 1)
