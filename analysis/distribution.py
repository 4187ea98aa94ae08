"""docs/figures/distribution*.png and results/distribution/table.md: where filaments are before and after compaction.

Sections of 127 to 547 filaments in several starts and one of 11 719, pressed between platens; s.d. and mean of the
normalised coordinates against count at equal thickness reduction and at equal pressure, fits, volume fraction, voids.
Runs that are in the folder already are found again; all of them take 15 minutes on two cores.

python analysis/distribution.py [--out DIR] [--jobs N] [--starts N] [--without-tow]
"""

from __future__ import annotations

import argparse
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cgfibre import plot, plot_section
from cgfibre.build.packing import pitch_from_void_fraction
from cgfibre.measure import distribution
from cgfibre.measure.ensemble import Difference, difference, mean_of
from cgfibre.measure.voids import Voids, find_voids, fraction_map
from cgfibre.store import Results, read_results
from cgfibre.sweep import SweepOptions, SweepRun, run_all

ROOT = Path(__file__).resolve().parent.parent
FIGURES = ROOT / "docs" / "figures"
D = 7.0
PITCH = pitch_from_void_fraction(D, 0.31)
COUNTS, TOW = (127, 169, 331, 547), 11719
STARTS = {127: 5, 169: 5, 331: 5, 547: 4, TOW: 1}
#: a span of 2 mm: springs so soft that not even those of the whole tow press its filaments into each other
SPAN, SHORT = "2 mm", "0.7 mm"
COMMON = ("assembly.jitter=0.3 um", "platens.unload=false", "model.accuracy=0.1")
STEPS = {127: 200_000, 169: 200_000, 331: 200_000, 547: 200_000, TOW: 201_000}
#: states compared, all of loading: shares of the initial thickness, pressures in MPa
REDUCTIONS, PRESSURES = (0.2, 0.3, 0.5), (0.1,)


@dataclass(frozen=True)
class State:
    """One section at one moment: centres (n, 2) um, its Gaussian description, voids, local volume fractions."""

    centres: np.ndarray
    fit: distribution.Distribution
    voids: Voids
    local: np.ndarray


def planned(out: Path, count: int, start: int, span: str = SPAN) -> SweepRun:
    """The run of one start to half the height (the whole tow: to a fifth of it)."""
    height = 2 * PITCH * round((np.sqrt(12 * count - 3) - 3) / 6) + D
    depth = 201.0 if count == TOW else 0.51 * height
    scene = "carbon-12k-section" if count == TOW else "carbon-547-section"
    own = () if count == TOW else (f"assembly.count={count}", f"assembly.seed={start}", "output.frames=120")
    asked = (f"assembly.length={span}", f"platens.stop.displacement={depth:.6g} um", f"model.most_steps={STEPS[count]}")
    name = f"{count}-{start}" if span == SPAN else f"{count}-{start}-short"
    return SweepRun.planned(out / name, scene, (*asked, *COMMON, *own))


def state(results: Results, reference: distribution.Normalisation, displacement: float) -> State | None:
    """The section at the frame nearest to a displacement; None where the run did not get there."""
    frames = results.frames
    k = int(np.argmin(np.abs(frames.displacement_um - displacement)))
    if displacement > frames.displacement_um[-1] * 1.005 + 0.5:
        return None
    c = frames.positions[k][:, 1:]
    local = distribution.local_volume_fraction(c, D, reach=D)
    return State(c, distribution.fit_distribution(c, reference), find_voids(c, D), local)


def states(folder: Path) -> dict[str, State]:
    """The states of one run that are compared, by name."""
    results = read_results(folder / "results.h5")
    curve = results.curve
    reference = distribution.normalisation(results.frames.positions[0][:, 1:], D)
    height = 2 * float(reference.half_size[1])
    at = {"before": 0.0} | {f"-{r:.0%}": r * height for r in REDUCTIONS}
    for p in PRESSURES:
        there = np.flatnonzero(curve.loading & (curve["pressure_MPa"] >= p))
        if len(there):
            at[f"{p:g} MPa"] = float(curve["displacement_um"][there[0]])
    found = {name: state(results, reference, d) for name, d in at.items()}
    return {name: s for name, s in found.items() if s is not None}


Quantity = Callable[[State], float]
QUANTITIES: dict[str, Quantity] = {
    "sd y": lambda s: float(s.fit.sd[0]),
    "sd z": lambda s: float(s.fit.sd[1]),
    "mean y": lambda s: float(s.fit.mean[0]),
    "mean z": lambda s: float(s.fit.mean[1]),
    "KS y": lambda s: float(s.fit.ks_distance[0]),
    "KS z": lambda s: float(s.fit.ks_distance[1]),
    "r2 y": lambda s: float(s.fit.r_squared[0]),
    "r2 z": lambda s: float(s.fit.r_squared[1]),
    "local Vf": lambda s: float(np.mean(s.local)),
    "s.d. of local Vf": lambda s: float(np.std(s.local)),
    "void area, um2": lambda s: float(np.mean(s.voids.area)),
    "largest void radius, um": lambda s: float(np.max(s.voids.radius)),
    "hydraulic radius, um": lambda s: s.voids.hydraulic_radius,
}


def table(found: dict[int, list[dict[str, State]]]) -> str:
    """Mean and half width of the 95 % interval of every quantity, one row a count and state."""
    lines = ["| filaments | starts | state | " + " | ".join(QUANTITIES) + " |", "|" + "---|" * (len(QUANTITIES) + 3)]
    for name in ("before", *(f"-{r:.0%}" for r in REDUCTIONS), *(f"{p:g} MPa" for p in PRESSURES)):
        for count, samples in found.items():
            have = [s[name] for s in samples if name in s]
            if not have:
                continue
            cells = []
            for of in QUANTITIES.values():
                mean, ci, _ = mean_of([of(s) for s in have])
                cells.append(f"{mean:.3f}" + (f" ± {ci:.3f}" if np.isfinite(ci) else ""))
            lines.append(f"| {count} | {len(have)} | {name} | " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def spans(out: Path, found: dict[int, list[dict[str, State]]], jobs: int) -> list[str]:
    """The section of 127 on springs 24 times as stiff: rigid discs would move alike, whatever their springs."""
    runs = [planned(out, 127, s + 1, SHORT) for s in range(len(found[127]))]
    failed = run_all(runs, SweepOptions(jobs, resume=True, trim=True))
    both = {127: found[127], -127: [states(r.folder) for r in runs if r.folder not in failed]}
    lines = []
    for name in ("-20%", "-50%"):
        for quantity in ("sd y", "sd z", "local Vf"):
            d = change(both, name, quantity, -127, 127)
            lines.append(f"{quantity} at {name}: span {SHORT} less {SPAN}: {d.value:+.4f} ± {d.ci:.4f}")
    return lines


def change(found: dict[int, list[dict[str, State]]], name: str, quantity: str, first: int, second: int) -> Difference:
    """Difference of two counts' ensembles in one quantity (Welch)."""
    of = QUANTITIES[quantity]
    values = [[of(s[name]) for s in found[count] if name in s] for count in (first, second)]
    return difference(*values)


def against_count(found: dict[int, list[dict[str, State]]]) -> None:
    """docs/figures/distribution-count.png: mean, s.d. and quality of the fit against count, before and after."""
    fig = plot.new_figure(10.5, 7.0)
    with plot.style():
        axes = fig.subplots(2, 3, sharex=True)
    rows = (("sd {}", "S.d. of the normalised {} (1)"), ("mean {}", "Mean of the normalised {} (1)"))
    shown = (("before", plot.GREY), ("-20%", plot.BLUE), ("-50%", plot.VERMILION), ("0.1 MPa", plot.GREEN))
    panels = [(axes[i, k], q.format(x), t.format(x)) for i, (q, t) in enumerate(rows) for k, x in enumerate("yz")]
    panels += [
        (axes[0, 2], "KS y", "KS distance of y from a Gaussian (1)"),
        (axes[1, 2], "KS z", "KS distance of z (1)"),
    ]
    for ax, quantity, label in panels:
        series = []
        for name, colour in shown:
            of = QUANTITIES[quantity]
            rest = {n: [of(s[name]) for s in samples if name in s] for n, samples in found.items()}
            values = {n: mean_of(v) for n, v in rest.items() if v}
            means = np.array([v[0] for v in values.values()])
            half = np.array([v[1] for v in values.values()])
            series.append(
                plot_section.CountSeries(
                    name.replace("-20%", "pressed by 20 %").replace("-50%", "pressed by 50 %"),
                    np.array(list(values), float),
                    means,
                    half,
                    colour,
                    name.endswith("MPa"),
                )
            )
        plot_section.plot_against_count(ax, series, label)
    axes[0, 0].legend(fontsize=9, frameon=False)
    fig.savefig(FIGURES / "distribution-count.png")


def voids_map(pairs: Sequence[tuple[str, State]], name: str, window: float, cell: float) -> None:
    """docs/figures/NAME: averaged volume fraction above, voids by their largest circle below, one column a state."""
    panels = len(pairs)
    low = np.min([s.centres.min(axis=0) for _, s in pairs], axis=0) - D
    high = np.max([s.centres.max(axis=0) for _, s in pairs], axis=0) + D
    width = 4.3
    fig = plot.new_figure(width * panels + 1.6, 2 * (width * float((high[1] - low[1]) / (high[0] - low[0])) + 0.5))
    with plot.style():
        axes = fig.subplots(2, panels, sharex=True, sharey=True, squeeze=False)
    maps = [fraction_map(s.centres, D, cell, window, box=np.stack([low, high], axis=1)) for _, s in pairs]
    dense = plot.Colours("fibre volume fraction", 0.0, max(float(m.fraction.max()) for m in maps))
    top = float(np.quantile(np.concatenate([s.voids.radius for _, s in pairs]), 0.995))
    open_ = plot.Colours("radius of the void's largest circle (µm)", 0.0, top, "inferno_r")
    for k, ((title, s), m) in enumerate(zip(pairs, maps, strict=True)):
        plot_section.plot_fraction_map(axes[0, k], m.y, m.z, m.fraction, dense)
        axes[0, k].set_title(title)
        axes[1, k].set_xlim(low[0], high[0])
        axes[1, k].set_ylim(low[1], high[1])
        picture = plot_section.VoidPicture(s.voids.corners, s.voids.radius[s.voids.void])
        plot_section.plot_voids(axes[1, k], plot_section.Section(s.centres, D), picture, open_)
        axes[0, k].label_outer()
        axes[1, k].label_outer()
    for row, scale in ((0, dense), (1, open_)):
        bar = fig.colorbar(scale.mappable(), ax=list(axes[row]), shrink=0.9, pad=0.015, aspect=22)
        bar.set_label(scale.label)
    fig.savefig(FIGURES / name, dpi=90)


def main() -> None:
    """Run what is missing, write the table, draw the figures, print the differences that the thesis speaks of."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "distribution")
    parser.add_argument("--jobs", type=int, default=1)
    parser.add_argument("--starts", type=int, default=None, help="of the small sections [4 or 5]")
    parser.add_argument("--without-tow", action="store_true", help="leave the 11 719 filaments out")
    arguments = parser.parse_args()
    counts = COUNTS if arguments.without_tow else (*COUNTS, TOW)
    runs = {
        n: [planned(arguments.out, n, s + 1) for s in range(STARTS[n] if n == TOW else arguments.starts or STARTS[n])]
        for n in counts
    }
    failed = run_all([r for of in runs.values() for r in of], SweepOptions(arguments.jobs, resume=True, trim=True))
    for folder, reason in failed.items():
        print(f"{folder.name}: {reason}")
    found = {n: [states(r.folder) for r in of if r.folder not in failed] for n, of in runs.items()}
    text = table(found)
    (arguments.out / "table.md").write_text(text)
    print(text)
    for name in ("-20%", "-50%"):
        for quantity in ("sd y", "sd z"):
            for one, other in ((127, 169), (127, 331), (331, 547), (127, 547)):
                d = change(found, name, quantity, one, other)
                print(f"{quantity} at {name}: {one} less {other}: {d.value:+.4f} ± {d.ci:.4f}, {d.significant=}")
    print("\n".join(spans(arguments.out, found, arguments.jobs)))
    against_count(found)
    small = found[127][0]
    pairs = [("127 filaments, as built", small["before"]), ("pressed by 50 %", small["-50%"])]
    voids_map(pairs, "distribution-127.png", 3 * D, D / 8)
    if not arguments.without_tow:
        tow = found[TOW][0]
        pairs = [("11 719 filaments, as built", tow["before"]), ("pressed by 20 %", tow["-20%"])]
        voids_map(pairs, "distribution-12k.png", 5 * D, D / 2)


if __name__ == "__main__":
    main()
