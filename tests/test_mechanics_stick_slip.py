"""Stick-slip law and slider: values of the thesis, path against closed form, exact events against an ODE solver."""

import math
from dataclasses import replace

import numpy as np
import pytest
from friction_signals import LAW
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.integrate import solve_ivp

from cgfibre.errors import InputError
from cgfibre.mechanics.stick_slip import Contacts, Phase, Slider, StickSlipLaw


def walk(law, path):
    """Coefficients along a path of slips, and the phases."""
    state, mu, phase = Contacts.at_rest(1), [], []
    for g in path:
        m, _, state = law.follow(state, np.array([g]))
        mu.append(float(m[0]))
        phase.append(int(state.phase[0]))
    return np.array(mu), phase


def test_the_law_at_the_points_that_eqs_4_3_name():
    slips = np.array([0, 10, 20, 22.5, 25, 25 + LAW.stick_length, 25 + LAW.cycle_length])
    # (i) to mu_s0 at 2 % of 1 mm, (ii) to mu_k, (iii) to mu_s, back to mu_k
    assert LAW.coefficient(slips) == pytest.approx([0, 0.11, 0.22, 0.19, 0.16, 0.18, 0.16])
    assert LAW.coefficient(-slips) == pytest.approx(-LAW.coefficient(slips))
    assert LAW.stiffness == pytest.approx(0.011) and LAW.stick_length == pytest.approx(0.02 / (0.05 * 0.011))
    # slip: mu_k + (mu_s - mu_k) cos(omega gamma/V)
    g = 4.0
    expected = 0.16 + 0.02 * math.cos(2 * math.pi * 3.97 * g * 1e-3 / 0.16)
    assert LAW.coefficient(25 + LAW.stick_length + g) == pytest.approx(expected)


def test_its_own_frequency():
    assert LAW.cycle_frequency * 1e6 == pytest.approx(3.45, abs=0.01)
    model = replace(LAW, mu_s=0.16, mu_k=0.15)
    assert model.cycle_frequency * 1e6 == pytest.approx(5.66, abs=0.01)
    smooth = replace(LAW, mu_s=0.16, mu_k=0.16 - 1e-12)
    assert smooth.cycle_frequency * 1e6 == pytest.approx(4 * 3.97, rel=1e-6)
    # counted on the signal itself
    t = np.linspace(1.0, 60.0, 600_000)
    mu = LAW.coefficient(160.0 * t) - 0.17
    ups = np.sum((mu[:-1] < 0) & (mu[1:] >= 0))
    assert ups / 59.0 == pytest.approx(3.4454, abs=0.02)


@given(st.floats(0.5, 60.0))
@settings(max_examples=15, deadline=None)
def test_steps_of_any_size_come_to_the_closed_form(step):
    path = np.arange(0.0, 200.0, step)
    assert walk(LAW, path)[0] == pytest.approx(LAW.coefficient(path), abs=1e-9)
    assert walk(LAW, -path)[0] == pytest.approx(-LAW.coefficient(path), abs=1e-9)


@given(st.lists(st.floats(-80.0, 80.0), min_size=2, max_size=6))
@settings(max_examples=20, deadline=None)
def test_there_and_back_is_continuous_and_bounded(turns):
    fine = 0.5
    path = np.concatenate(
        [np.linspace(a, b, 2 + int(abs(b - a) / fine)) for a, b in zip([0.0, *turns], turns, strict=False)]
    )
    mu, _ = walk(LAW, path)
    steepest = max(LAW.stiffness, 0.06 / LAW.drop_slip, 0.02 * math.pi / 2 / LAW.slip_length)
    assert np.abs(mu).max() <= 0.22 + 1e-12
    assert np.abs(np.diff(mu)).max() <= steepest * fine * 1.001


def test_a_way_back_sticks_and_slips_on_the_other_side():
    mu, phase = walk(LAW, [19.0, 0.0])
    assert mu[-1] == pytest.approx(0.0) and phase[-1] == Phase.FIRST_STICK  # elastic
    mu, phase = walk(LAW, [19.0, 22.0, 21.0])  # in the fall: back along the soft stiffness
    assert phase[-1] == Phase.STICK and mu[-1] == pytest.approx(mu[-2] - 0.05 * LAW.stiffness)
    mu, phase = walk(LAW, [19.0, 22.0, 21.0, 22.0, 22.5])  # and on with the fall
    assert phase[-1] == Phase.DROP and mu[-1] == pytest.approx(0.19)
    mu, _ = walk(LAW, [*np.linspace(0, 100, 200), *np.linspace(100, -900, 4000)])
    assert mu.min() == pytest.approx(-0.18, abs=1e-3)


def test_slopes_are_the_derivatives():
    for start in (5.0, 22.0, 40.0, 63.0, 68.0):
        _, _, state = LAW.follow(Contacts.at_rest(1), np.array([start]))
        mu, slope, _ = LAW.follow(state, np.array([start + 0.1]))
        further, _, _ = LAW.follow(state, np.array([start + 0.1 + 1e-6]))
        assert slope[0] == pytest.approx((further[0] - mu[0]) / 1e-6, rel=1e-4, abs=1e-9)


@pytest.mark.parametrize(
    "change",
    [{"mu_s": 0.23}, {"mu_k": 0.19}, {"mu_k": 0.0}, {"critical_slip": 0.0}, {"speed": -1.0}, {"mu_s0": math.inf}],
)
def test_a_law_that_cannot_be_is_refused(change):
    with pytest.raises(InputError):
        replace(LAW, **change)


def test_one_coefficient_alone_is_coulomb():
    law = StickSlipLaw(0.2, 0.2, 0.2, 1.0, 1.0, 1e-6, 1e-4)
    assert walk(law, np.linspace(0, 50, 300))[0][10:] == pytest.approx(0.2, abs=1e-9)


# --- slider ----------------------------------------------------------------------------------------------------------

SLIDER = Slider(mass=2.0, stiffness=5.0, speed=0.3, static=1.0, kinetic=0.7)


def ode(slider, end, rtol=1e-8):
    """The spring's force by scipy's solver with events, in place of the closed forms."""
    m, k, c, v = slider.mass, slider.stiffness, slider.damping, slider.speed
    times, forces = [np.array([0.0])], [np.array([0.0])]
    t, stretch, sliding = 0.0, 0.0, False

    def free(_t, y):
        extension, speed = y
        return [v - speed, (k * extension + c * (v - speed) - slider.kinetic) / m]

    def stands(_t, y):
        return y[1]

    stands.terminal, stands.direction = True, -1
    while t < end:
        if not sliding:
            until = t + (slider.static / k - stretch) / v
            at = np.linspace(t, until, 50)
            forces.append(k * (stretch + v * (at - t)))
            stretch = slider.static / k
        else:
            # from rest: an event at the very start is none
            first = solve_ivp(free, (t, t + 1e-6), [stretch, 0.0], rtol=rtol, atol=1e-11)
            sol = solve_ivp(free, (t + 1e-6, t + 1e3), first.y[:, -1], events=stands, rtol=rtol, atol=1e-11)
            at, until, stretch = sol.t, sol.t[-1], sol.y[0, -1]
            forces.append(k * sol.y[0])
        times.append(at)
        t, sliding = until, not sliding
    return np.concatenate(times), np.concatenate(forces)


@pytest.mark.parametrize("damping", [0.0, 0.2, 0.6])
def test_events_in_closed_form_agree_with_an_ode_solver(damping):
    slider = Slider(2.0, 5.0, 0.05, 1.0, 0.7, damping)
    t, force = ode(slider, 20.0)
    assert np.abs(slider.force(t) - force).max() < 1e-5
    assert slider.period < 10 < t[-1]


def test_the_undamped_cycle():
    w, a = math.sqrt(2.5), 0.3 / 5.0
    assert SLIDER.amplitude == pytest.approx(a)
    assert SLIDER.slip_time == pytest.approx(2 * (math.pi - math.atan(a * w / 0.3)) / w)
    assert SLIDER.stick_time == pytest.approx(2 * a / 0.3)
    # energy of the slide: what the spring loses goes into friction; the force swings evenly about the kinetic one
    t = np.linspace(0.0, 40 * SLIDER.period, 200_001)[1000:]
    force = SLIDER.force(t)
    amplitude = math.hypot(a, 0.3 / w) * 5.0
    assert force.max() == pytest.approx(0.7 + amplitude, rel=1e-4)
    assert force.min() == pytest.approx(0.7 - amplitude, rel=1e-4)
    assert SLIDER.force(0.0) == 0.0 and SLIDER.force(0.1) == pytest.approx(0.15)


def test_a_slow_pull_is_a_sawtooth_and_enough_damping_ends_it():
    slow = replace(SLIDER, speed=1e-6)
    assert slow.period == pytest.approx(2 * slow.amplitude / 1e-6, rel=1e-4)
    over = Slider(2.0, 5.0, 0.3, 1.0, 0.7, 1.5)
    assert math.isinf(over.slip_time) and over.force(100.0) == pytest.approx(0.7, abs=1e-9)
    for bad in ({"kinetic": 1.0}, {"mass": 0.0}, {"damping": 7.0}):
        with pytest.raises(InputError):
            replace(SLIDER, **bad)
