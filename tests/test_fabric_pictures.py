"""Figures of fabrics on an analytic weave, and the statistics that a run of one stores."""

from dataclasses import replace

import numpy as np
import pytest
from weave_systems import S, plain

from cgfibre import plot_fabric, plot_weave
from cgfibre.errors import InputError
from cgfibre.measure.crossing_forces import crossing_loads, touches
from cgfibre.measure.crossings import tow_crossings
from cgfibre.measure.fabric import bare_crimp, fabric_of, tow_lines
from cgfibre.measure.fabric_section import cut_fabric
from cgfibre.plot import new_axes
from cgfibre.record import Frames
from cgfibre.review_fabric import fabric_statistics, fabric_summary, planes_of


@pytest.fixture(scope="module")
def pressed():
    """A weave of A = 10 um pressed to A = 9 um, D = 20 um: crossings overlap by 0, then 2 um."""
    states = [plain(2, amplitude, per_spacing=24).positions for amplitude in (10.0, 9.5, 9.0)]
    system = plain(2, 10.0, per_spacing=24)
    return system, Frames(np.arange(3), np.array([0.0, 1.0, 2.0]), np.array(states))


def statistics_of(system, frames):
    faces = np.column_stack([np.full(3, -20.0), 20.0 - frames.displacement_um])
    return fabric_statistics(system, frames, faces, lambda overlap: 100.0 * overlap, None)


def test_statistics_of_every_frame(pressed):
    system, frames = pressed
    found = statistics_of(system, frames)
    assert all(len(values) == 3 for values, _ in found.values())
    crimp, units = found["crimp_warp"]
    assert units == "1" and crimp == pytest.approx([bare_crimp(a, S) for a in (10.0, 9.5, 9.0)], rel=1e-3)
    angle, units = found["crimp_angle_weft"]
    assert units == "rad" and angle[0] == pytest.approx(np.arctan(np.pi * 10 / S), rel=1e-3)
    force, units = found["crossing_force"]
    assert units == "nN" and force.shape == (3, 4) and found["crossing_place"][0].shape == (3, 4, 3)
    assert np.all(force[0] < 1e-3 * force[2]) and np.all(force[2] > 2 * force[1])
    # the other tow takes 1 um of a tow at A = 9; the upper platen at 18 um, top at 19, 1 um; the lower one none
    thickness = found["thickness_warp_crossing"][0]
    assert thickness[2] == pytest.approx(20.0 - 1.0 - (1.0 + 0.0) / 2, abs=0.05)
    assert found["open_area"][0][0] == pytest.approx((1 - 20 / S) ** 2, rel=0.03)
    # half-way between wefts warp alone is cut, under its slope
    void = 1 - 2 * np.pi * 100 * np.hypot(1, np.pi * 10 / S) / (2 * S * 40)
    assert found["void_fraction_between"][0][0] == pytest.approx(void, rel=0.02)
    summary = fabric_summary(found)
    assert summary["as_built"]["crimp_warp"] == pytest.approx(crimp[0])
    assert summary["at_largest_displacement"]["crossing_force_mean_nN"] == pytest.approx(float(force[2].mean()))
    assert "crossing_force_nN" not in summary["as_built"]


def test_a_strained_cell_is_measured_with_the_box_of_its_frame(pressed):
    system, frames = pressed
    stretch = np.array([1.2, 1.0, 1.0])
    box = np.tile(system.box * stretch[:, None], (3, 1, 1))
    strained = Frames(frames.step, frames.displacement_um, frames.positions * stretch, box=box)
    found, as_built = statistics_of(system, strained), statistics_of(system, frames)
    assert found["crimp_warp"][0] == pytest.approx([bare_crimp(a, 1.2 * S) for a in (10.0, 9.5, 9.0)], rel=1e-3)
    assert found["crimp_weft"][0] == pytest.approx(as_built["crimp_weft"][0], rel=1e-9)
    # crossings lie where they were, in the longer cell
    assert found["crossing_place"][0] == pytest.approx(as_built["crossing_place"][0] * stretch, abs=0.05)
    assert found["open_area"][0][0] == pytest.approx((1 - 20 / S) * (1 - 20 / (1.2 * S)), rel=0.03)


def test_planes_go_through_a_weft_tow_and_between(pressed):
    system, frames = pressed
    assert planes_of(fabric_of(system), frames.positions[0]) == pytest.approx((S / 2, S))
    # two chains as one weft tow: its middle, S, lies in neither
    ribbon = replace(system, tow=np.where(fabric_of(system).filament_axis == 1, 2, system.tow))
    assert planes_of(fabric_of(ribbon), ribbon.positions)[0] in (pytest.approx(S / 2), pytest.approx(3 * S / 2))
    single = plain(1, 0.0)
    assert planes_of(fabric_of(single), single.positions) == pytest.approx((S / 2, S))


def test_a_cell_is_drawn_so_often_that_four_tows_stand_each_way(pressed):
    system, frames = pressed
    cells = plot_weave.repeated(frames.system_at(system, 0))
    assert cells.n_filaments == 4 * 4 and not cells.closed.any()
    extent = np.ptp(cells.positions, axis=0)
    assert extent[:2] == pytest.approx([4 * S, 4 * S])
    patch = plain(2, periodic=False)
    assert plot_weave.repeated(patch).n_filaments == 4
    with pytest.raises(InputError, match="at least one"):
        plot_weave.figure_weave({})


def test_pictures_show_what_they_are_given(pressed, tmp_path):
    system, frames = pressed
    fabric = fabric_of(system)
    plot_weave.figure_weave({"as built": frames.system_at(system, 0)}).savefig(tmp_path / "weave.png", dpi=40)
    views = [
        plot_fabric.CutView(cut_fabric(fabric, frames.positions[2], 0, x), fabric.axis, -20.0, 18.0, "cut")
        for x in (S / 2, S)
    ]
    figure = plot_fabric.figure_cuts(views)
    strips, discs = figure.axes[0].collections
    assert len(strips.get_paths()) == 1 and len(discs.get_offsets()) == 2
    assert len(figure.axes[1].collections) == 1 and len(figure.axes[1].patches) == 2
    figure.savefig(tmp_path / "sections.png", dpi=40)
    with pytest.raises(InputError, match="cuts a filament"):
        empty = replace(views[0], cut=replace(views[0].cut, bands=(), ellipses=_none(views[0])), z_top=None)
        plot_fabric.figure_cuts([replace(empty, z_bottom=None)])
    lines = tow_lines(fabric, frames.positions[2])
    loads = crossing_loads(
        fabric, tow_crossings(fabric, lines), touches(fabric, frames.positions[2], lambda d: 1e5 * d)
    )
    size = np.array([[0, 2 * S], [0, 2 * S]])
    view = plot_fabric.CrossingMap(loads, [line.points for line in lines], np.full(4, 20.0), fabric.axis, size)
    ax = plot_fabric.plot_crossings(new_axes(), view)
    named = [t.get_text() for t in ax.texts]
    assert sorted(named) == ["warp above"] * 2 + ["weft above"] * 2
    ax.figure.savefig(tmp_path / "map.png", dpi=40)
    balance = plot_fabric.Balance(np.arange(3.0), np.array([0.0, 1.0, 2.0]), np.array([0.0, 0.5, 1.5]))
    shown = plot_fabric.plot_balance(new_axes(), balance).lines[-1].get_ydata()
    assert shown.tolist() == [0.5, 0.75]


def _none(view):
    e = view.cut.ellipses
    names = ("centres", "major", "minor", "tilt", "tow", "filament")
    return type(e)(**{name: getattr(e, name)[:0] for name in names})


def test_crimp_against_pressure_parts_loading_from_unloading():
    p = np.array([0.0, 1.0, 2.0, 1.0])
    pair = (np.array([3.0, 2.0, 1.0, 1.5]), np.array([4.0, 3.0, 2.0, 2.5]))
    history = plot_fabric.CrimpHistory(p, pair, pair, pair, pair, pair, pair, turn=2)
    figure = plot_fabric.figure_crimp(history)
    assert [len(ax.lines) for ax in figure.axes] == [4, 4, 8, 8]
    assert figure.axes[0].lines[0].get_ydata().tolist() == [300.0, 200.0, 100.0]
    assert figure.axes[0].lines[1].get_xdata().tolist() == [2.0, 1.0]
