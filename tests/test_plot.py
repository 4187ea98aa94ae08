import subprocess
import sys
import time

import matplotlib
import numpy as np
import pytest
from measure_systems import D, bundle_between, pressed, rings, straight, system_of

from cgfibre import plot, plot_bundle, plot_section
from cgfibre.errors import InputError
from cgfibre.measure import distribution as ds
from cgfibre.measure.voids import find_voids, fraction_map
from cgfibre.record import CURVE_COLUMNS, Curve


def synthetic_curve(n: int = 120, diameter: float = 54.5) -> Curve:
    """A curve with the marks of carbon-37: the bottom platen wakes late, unloading is softer."""
    rng = np.random.default_rng(3)
    u = np.concatenate([np.linspace(0, 28, n), np.full(5, 28.0), np.linspace(28, 6, n // 2)])
    phase = np.repeat([0, 1, 2], [n, 5, n // 2])
    force = 6e-2 * (u / 28) ** 2.6
    force = np.where(phase == 2, force * np.clip((u - 5) / 23, 0, 1) ** 1.6, force) * (1 + rng.normal(0, 0.01, len(u)))
    bottom = force * np.clip((u - 11) / 34, 0, 1)
    work = np.concatenate([[0], np.cumsum((force[1:] + force[:-1]) / 2 * np.diff(u) * 1e-6)])
    columns = {name: np.zeros(len(u)) for name in CURVE_COLUMNS} | {
        "time_us": np.arange(len(u)) * 0.6,
        "displacement_um": u,
        "thickness_um": diameter - u,
        "force_top_N": force,
        "force_bottom_N": bottom,
        "pressure_MPa": force / (500 * diameter) * 1e6,
        "work_J": work,
        "stored_J": work * np.where(phase == 2, 0.6 * np.clip(u / 28, 0, 1), 0.72),
        "kinetic_J": 0.004 * work,
    }
    return Curve(columns=columns, phase=phase, width_um=np.full(len(u), diameter))


@pytest.fixture(scope="module")
def states():
    before = rings(6)
    size = np.ptp(before[:, 1]) + D
    return [before, pressed(before, 0.75 * size), pressed(before, 0.5 * size)]


def sections_of(states):
    out = []
    for c, name in zip(states, ("before", "during", "after"), strict=True):
        half = ds.bundle_size(c, D)[1] / 2
        out.append(plot_section.Section(c, D, -half, half, ds.local_volume_fraction(c, D, reach=D), name))
    return out


def ink(fig) -> float:
    """Share of the pixels that are not white."""
    fig.canvas.draw()
    return float((np.asarray(fig.canvas.buffer_rgba())[..., :3] < 250).any(axis=2).mean())


def test_curve_shows_both_platens_both_ways():
    ax = plot.plot_curve(plot.new_axes(), synthetic_curve(), plot.CurveView(speed_error=0.04))
    assert ax.get_xlabel() == "Platen displacement (µm)" and ax.get_ylabel() == "Force on the platen (mN)"
    texts = [t.get_text() for t in ax.get_legend().get_texts()]
    assert texts == ["top platen", "bottom platen", "±4 % (halving the platen speed)", "unloading"]
    loading = ax.lines[0]
    assert loading.get_ydata().max() == pytest.approx(60, rel=0.05)  # 6e-2 N in mN
    # the unloading branch starts at the last sample before it
    assert ax.lines[1].get_xdata()[0] == 28.0 and len(ax.lines[1].get_xdata()) == 61


def test_curve_of_pressure_against_thickness_compacts_to_the_right():
    ax = plot.plot_curve(
        plot.new_axes(), synthetic_curve(), plot.CurveView(x="thickness", y="pressure", log=True), "37"
    )
    assert ax.xaxis_inverted() and ax.get_yscale() == "log"
    assert ax.get_ylabel() == "Pressure (MPa)" and ax.get_xlabel() == "Thickness (µm)"
    plot.plot_curve(ax, synthetic_curve(diameter=60), plot.CurveView(x="thickness", y="pressure", log=True), "other")
    assert ax.xaxis_inverted()
    assert ink(ax.figure) > 0.01


def test_curve_refuses_an_unknown_axis():
    with pytest.raises(InputError, match="view"):
        plot.plot_curve(plot.new_axes(), synthetic_curve(), plot.CurveView(x="strain"))  # type: ignore[arg-type]


def test_section_draws_discs_at_true_scale(states):
    ax = plot.new_axes(5, 4)
    plot_section.plot_section(ax, sections_of(states)[2])
    assert len(ax.collections[0].get_offsets()) == 127
    # one disc alone: it covers pi D^2/4 of the page's scale
    ax = plot_section.plot_section(plot.new_axes(5, 4), plot_section.Section(np.zeros((1, 2)), D))
    ax.figure.canvas.draw()
    colour = np.asarray(ax.figure.canvas.buffer_rgba())[..., :3].astype(int)
    covered = (np.abs(colour - [0x9A, 0xA5, 0xB1]).sum(axis=2) < 60).sum()
    corner = ax.transData.transform([[0, 0], [D, 0], [0, D]])
    wide, high = corner[1, 0] - corner[0, 0], corner[2, 1] - corner[0, 1]
    assert wide == pytest.approx(high)
    assert covered == pytest.approx(np.pi / 4 * wide * high, rel=0.02)


def test_section_leaves_out_filaments_that_are_not_there():
    c = np.array([[0, 0], [np.nan, np.nan], [D, 0]])
    ax = plot_section.plot_section(plot.new_axes(), plot_section.Section(c, D, values=np.array([1.0, 2.0, 3.0])))
    assert len(ax.collections[0].get_offsets()) == 2
    with pytest.raises(InputError, match="centres"):
        plot_section.plot_section(plot.new_axes(), plot_section.Section(c * np.nan, D))


def test_three_sections_share_scale_and_colour_bar(states):
    fig = plot_section.figure_sections(sections_of(states), plot.Colours("Local fibre volume fraction (1)", 0.4, 0.9))
    panels, bar = fig.axes[:3], fig.axes[3:]
    assert len(bar) == 1 and bar[0].get_ylabel() == "Local fibre volume fraction (1)"
    assert len({(*a.get_xlim(), *a.get_ylim()) for a in panels}) == 1
    fig.canvas.draw()
    widths = [a.transData.transform([[0, 0], [D, 0]]) for a in panels]
    assert np.ptp([w[1, 0] - w[0, 0] for w in widths]) < 1e-6
    assert [a.get_title() for a in panels] == ["before", "during", "after"]
    with pytest.raises(InputError, match="sections"):
        plot_section.figure_sections([])


def test_wide_sections_stand_one_above_the_other():
    c = np.stack(np.meshgrid(np.arange(40) * D, np.arange(3) * D), axis=-1).reshape(-1, 2)
    fig = plot_section.figure_sections(
        [plot_section.Section(c, D, -D / 2, 2.5 * D), plot_section.Section(c, D, -D / 2, 2.5 * D)]
    )
    assert len(fig.axes) == 2 and fig.axes[0].get_subplotspec().get_geometry()[:2] == (2, 1)


def test_voids_fill_the_room_between_the_discs():
    c = np.stack(np.meshgrid(np.arange(6) * 2 * D, np.arange(6) * 2 * D), axis=-1).reshape(-1, 2)
    found = find_voids(c, D, probe=D)
    picture = plot_section.VoidPicture(found.corners, found.radius[found.void])
    ax = plot.new_axes(5, 5)
    scale = plot.Colours("r", 0.0, 2 * float(found.radius.max()), "Reds")
    plot_section.plot_voids(ax, plot_section.Section(c, D), picture, scale)
    fig = ax.figure
    fig.canvas.draw()
    seen = np.asarray(fig.canvas.buffer_rgba())[..., :3].astype(int)
    colour = np.array(scale.mappable().to_rgba(float(found.radius[0]))[:3]) * 255
    corner = ax.transData.transform([[0, 0], [D, D]])
    pixels = np.sum(np.abs(seen - colour).sum(axis=2) < 12) / np.prod(corner[1] - corner[0]) * D**2
    assert pixels == pytest.approx(found.area.sum(), rel=0.05)  # outlines of discs cover some


def test_fraction_map_is_drawn_at_its_place(states):
    m = fraction_map(states[0], D, 2.0, 20.0)
    ax = plot_section.plot_fraction_map(plot.new_axes(), m.y, m.z, m.fraction, plot.Colours("Vf", 0, 1))
    (mesh,) = ax.collections
    assert mesh.get_array().shape == m.fraction.shape and ax.get_aspect() == 1
    assert ax.get_xlim() == pytest.approx((m.y[0], m.y[-1]))


def test_counts_show_bands_and_single_samples():
    n = np.array([127.0, 547, 11719])
    series = plot_section.CountSeries("y", n, np.array([0.6, 0.5, 0.5]), np.array([0.01, 0.01, np.nan]))
    ax = plot_section.plot_against_count(plot.new_axes(), [series], "S.d. (1)")
    assert ax.get_xscale() == "log" and len(ax.containers) == 1
    assert ax.lines[-1].get_xdata().tolist() == [11719]


def test_energy_stacks_to_the_work():
    curve = synthetic_curve()
    ax = plot.plot_energy(plot.new_axes(), curve)
    assert ax.get_ylabel() == "Energy (nJ)" and ax.get_xlabel() == "Time (µs)"
    top = max(p.vertices[:, 1].max() for c in ax.collections for p in c.get_paths())
    assert top == pytest.approx(curve["work_J"].max() * 1e9)


def test_distribution_histograms_are_densities(states):
    n = ds.normalisation(states[0], D)
    fits = [ds.fit_distribution(c, n) for c in (states[0], states[2])]
    fig = plot_section.figure_distribution(*fits)
    for axis, ax in enumerate(fig.axes):
        bars = [sum(b.get_width() * b.get_height() for b in group) for group in ax.containers]
        assert bars == pytest.approx([1, 1])
        assert ax.lines[1].get_ydata().max() == pytest.approx(fits[1].density(axis, fits[1].mean[axis]), rel=1e-3)


def test_bundle_picture_hides_what_is_behind():
    # seen along y: the near filament, at lower y, covers the far one
    s = straight([(0, 0), (5 * D, 0)], n=12)
    view = plot_bundle.BundleView(
        values=np.array([0.0, 1.0]), colours=plot.Colours("v", 0, 1, cmap="bwr"), azimuth=-90, elevation=0
    )
    image = plot_bundle.figure_bundle_3d(s, s.positions, view).axes[0].images[0].get_array()
    colour = image[image[..., 3] > 0][:, :3].mean(axis=0)
    assert colour[2] > 2 * colour[0]  # blue, value 0
    swapped = plot_bundle.figure_bundle_3d(s, s.positions * [1, -1, 1], view).axes[0].images[0].get_array()
    colour = swapped[swapped[..., 3] > 0][:, :3].mean(axis=0)
    assert colour[0] > 2 * colour[2]


def test_bundle_picture_is_to_scale_and_says_when_it_is_not():
    s = straight([(0, 0)], n=30)
    for exaggeration in (1.0, 4.0):
        fig = plot_bundle.figure_bundle_3d(
            s, s.positions, plot_bundle.BundleView(exaggeration=exaggeration, azimuth=-90, elevation=0)
        )
        image = fig.axes[0].images[0]
        rows = np.flatnonzero((image.get_array()[..., 3] > 0).any(axis=1))
        z0, z1 = image.get_extent()[2:]
        pixel = (z1 - z0) / image.get_array().shape[0]
        assert (rows[-1] - rows[0] + 1) * pixel == pytest.approx(exaggeration * D, abs=2 * pixel)
        said = any("times larger" in t.get_text() for t in fig.axes[0].texts)
        assert said == (exaggeration != 1)


def test_bundle_picture_colours_beads_and_refuses_what_it_cannot_draw():
    s = straight([(0, 0), (0, D)], n=12)
    fig = plot_bundle.figure_bundle_3d(s, s.positions, plot_bundle.BundleView(values=s.positions[:, 0]))
    assert len(fig.axes) == 2
    with pytest.raises(InputError, match=r"view\.values"):
        plot_bundle.figure_bundle_3d(s, s.positions, plot_bundle.BundleView(values=np.zeros(5)))
    with pytest.raises(InputError, match="positions"):
        plot_bundle.figure_bundle_3d(s, s.positions[1:])
    discs = system_of([np.zeros((1, 3)), np.full((1, 3), 9.0)])
    with pytest.raises(InputError, match="system"):
        plot_bundle.figure_bundle_3d(discs, discs.positions)


def test_matplotlib_is_imported_only_to_draw_and_never_pyplot():
    code = (
        "import sys, cgfibre.plot as p; assert 'matplotlib' not in sys.modules; p.new_axes().figure.canvas.draw();"
        "assert 'matplotlib.pyplot' not in sys.modules"
    )
    subprocess.run([sys.executable, "-c", code], check=True)


def test_prefixes():
    assert plot._prefix(np.array([0.0]), "N") == (1.0, "N")
    assert plot._prefix(np.array([3e-8, np.nan]), "J") == (pytest.approx(1e9), "nJ")
    assert plot._prefix(np.array([-2e6]), "Pa") == (pytest.approx(1e-6), "MPa")


def test_the_five_figures_of_a_run_are_quick_and_leave_the_settings_alone(states, tmp_path):
    before = dict(matplotlib.rcParams)
    s = bundle_between(states[0], states[2])
    half = ds.bundle_size(states[2], D)[1] / 2
    faces = (plot_bundle.PlatenFace(half, True, (100, 600)), plot_bundle.PlatenFace(-half, False))
    n = ds.normalisation(states[0], D)
    curve, sections = synthetic_curve(), sections_of(states)
    colours = plot.Colours.spanning("Local fibre volume fraction (1)", *[x.values for x in sections])
    fits = [ds.fit_distribution(c, n) for c in (states[0], states[2])]
    began = time.perf_counter()
    figures = {
        "curve": plot.plot_curve(plot.new_axes(), curve, plot.CurveView(speed_error=0.04)).figure,
        "sections": plot_section.figure_sections(sections, colours),
        "bundle": plot_bundle.figure_bundle_3d(
            s, s.positions, plot_bundle.BundleView(values=sections[2].values, colours=colours, platens=faces)
        ),
        "energy": plot.plot_energy(plot.new_axes(), curve).figure,
        "distribution": plot_section.figure_distribution(*fits),
    }
    for name, fig in figures.items():
        fig.savefig(tmp_path / f"{name}.png")
        assert (tmp_path / f"{name}.png").stat().st_size > 10_000
    # 4 s is the promise; the margin is for a machine shared with other jobs
    assert time.perf_counter() - began < 15
    assert dict(matplotlib.rcParams) == before
