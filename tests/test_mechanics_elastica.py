"""The elastica of a filament under a platen: linear limit, shooting, Bisshopp and Drucker's cantilever."""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from cgfibre.errors import InputError
from cgfibre.mechanics import elastica
from cgfibre.mechanics.rod import platen_compliance

EI, P, L = 2.711e10, 4e5, 700.0


@pytest.mark.parametrize(("length", "width"), [(700.0, 500.0), (700.0, 0.0), (345e3, 500.0)])
def test_small_deflections_are_linear(length: float, width: float) -> None:
    law = elastica.spring_law(length, EI, P, width, 0.01 * (length - width) / 2)
    k = 1 / float(platen_compliance(length, EI, width=width, tension=P))
    d = law.deflection[1] / 10
    # the first knot is at 0.03 of the free span, where the law is 1e-3 stiffer than linear
    assert float(law(d)) == pytest.approx(k * d, rel=3e-3)


def test_bisshopp_and_drucker() -> None:
    # a cantilever of L/2 under V = F/2: V l^2/EI = 1 bends by 0.30172 l, 10 by 0.81061 l
    law = elastica.spring_law(L, EI, 0.0, 0.0, 0.82 * L / 2)
    load = law(np.array([0.30172, 0.81061]) * L / 2) / 2 * (L / 2) ** 2 / EI
    assert load == pytest.approx([1.0, 10.0], rel=3e-3)


def test_shooting_gives_the_same() -> None:
    # integrated from mid-span with the force that the law gives, the moment vanishes at the end
    law = elastica.spring_law(L, EI, P, 500.0, 30.0)
    d, force = law.deflection[-1], law.force[-1]

    def end(curvature: float) -> tuple[float, float]:
        def slopes(s, y, load):
            return [y[1] / EI, P * np.sin(y[0]) - load * np.cos(y[0]), np.cos(y[0]), np.sin(y[0])]

        edge = lambda s, y, load: y[2] - 250.0  # noqa: E731
        edge.terminal = True
        inner = solve_ivp(slopes, (0, L / 2), [0, EI * curvature, 0, 0], events=edge, args=(0.0,), rtol=1e-9)
        outer = solve_ivp(slopes, (inner.t[-1], L / 2), inner.y[:, -1], args=(force / 2,), rtol=1e-9)
        return float(outer.y[1, -1]), float(outer.y[3, -1] - inner.y[3, -1])

    curvature = brentq(lambda c: end(c)[0], 1e-5, 1e-2, xtol=1e-14)
    assert end(curvature)[1] == pytest.approx(d, rel=1e-4)


def test_where_the_law_ends() -> None:
    # free spans 100 and 350 um; between the edges of a wide platen the filament sags until it is drawn through
    wide, narrow = (elastica.spring_law(L, EI, P, width, 600.0) for width in (500.0, 0.0))
    assert 55 < wide.reach < 60
    assert 280 < narrow.reach < 300
    assert narrow.force[-1] > elastica.STEEPEST * narrow.force[1] / narrow.deflection[1] * narrow.deflection[-1]
    for law in (wide, narrow):
        assert np.all(np.diff(law.stiffness(np.array(law.deflection))) > 0)


def test_refused() -> None:
    with pytest.raises(InputError):
        elastica.spring_law(L, EI, P, L, 10.0)
