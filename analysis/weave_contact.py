"""Weaves filament by filament, by capsules and by beads: what each costs and gets wrong (docs/fabrics.md).

    python analysis/weave_contact.py [--cells 12 30] [--out results/weave_contact] [--table]

Presses 2 x 2 cells of nylon yarns of 12 and of 30 filaments to 0.2 MPa: the same specimens (packings) by every
variant. Runs that lie in the folder already are found again, one that was stopped goes on. Hours for all of it: the
finest beads take most. ``--table``: no runs, tables and the figure docs/figures/fabric_contact.png of what is there.

The error of a variant is the difference of its thickness to that of the reference (finer capsules under a slower
platen) at the same pressure and of the same specimen. Filaments that give way make a single pair of curves differ by
more than any variant's fault: a specimen moved by 1e-6 um shows by how much. So errors are the mean over specimens,
with its standard error, and what is compared is that mean curve.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from cgfibre import store
from cgfibre.build.system import FloatArray
from cgfibre.plot import new_figure
from cgfibre.sweep import SweepOptions, SweepRun, run_all

ROOT = Path(__file__).resolve().parents[1]
FIGURE = ROOT / "docs" / "figures" / "fabric_contact.png"
D = 300.0  # um, of a filament
SCENE = "nylon-weave-filaments"
#: MPa at which thickness is told, and over which curves are compared
TOLD = np.array([0.05, 0.1, 0.2])
PRESSURES = np.geomspace(0.01, 0.2, 60)
#: um by which a moved specimen differs
MOVED = 1e-6


@dataclass(frozen=True)
class Variant:
    """How filaments touch (``shape``), segments of ``share`` D (0: the planner's), ``pace`` times the platen speed."""

    shape: str
    share: float = 0.0
    pace: float = 1.0

    @property
    def name(self) -> str:
        """For folders and figures: capsules-auto-v1."""
        return f"{self.shape}-{f'{self.share:g}D' if self.share else 'auto'}-v{self.pace:g}"

    @property
    def overrides(self) -> tuple[str, ...]:
        """What makes it of the scene; the platen's speed is as the accuracy asked for."""
        own = [f"contact.shape={self.shape}", f"model.accuracy={0.05 * self.pace!r}"]
        if self.share:
            own.append(f"model.spacing={self.share * D!r} um")
        return tuple(own)


@dataclass(frozen=True)
class Cell:
    """A cell of yarns of ``filaments``, as thick and wide to their distance as those of the scene; its variants with
    the number of specimens, the reference first, and the specimens that are also run moved."""

    filaments: int
    variants: dict[Variant, int]
    moved: dict[Variant, int]

    @property
    def overrides(self) -> tuple[str, ...]:
        """What makes it of the scene, without the spacing of the yarns."""
        k = (self.filaments / 30) ** 0.5
        return (
            "assembly.tows=2",
            f"assembly.tow.filaments={self.filaments}",
            f"assembly.tow.width={4400 * k:.0f} um",
            f"assembly.tow.thickness={1200 * k:.0f} um",
            "output.frames=4",
        )

    @property
    def spacing(self) -> float:
        """Of the yarns, um."""
        return float(np.round(5000 * (self.filaments / 30) ** 0.5))

    @property
    def reference(self) -> Variant:
        """The variant that the others are compared with."""
        return next(iter(self.variants))

    def run(self, out: Path, variant: Variant, specimen: int, moved: bool = False) -> SweepRun:
        """One run, planned."""
        spacing = self.spacing + (MOVED if moved else 0.0)
        own = (f"assembly.seed={specimen}", f"assembly.spacing={spacing!r} um")
        return SweepRun.planned(
            self.folder(out, variant, specimen, moved), SCENE, (*self.overrides, *own, *variant.overrides)
        )

    def folder(self, out: Path, variant: Variant, specimen: int, moved: bool = False) -> Path:
        """Where a run lies."""
        return out / f"{self.filaments}" / f"{variant.name}-{specimen}{'-moved' * moved}"

    def runs(self, out: Path) -> list[SweepRun]:
        """All of them, cheap ones first."""
        found = [self.run(out, v, k) for v, n in self.variants.items() for k in range(1, n + 1)]
        found += [self.run(out, v, k, True) for v, n in self.moved.items() for k in range(1, n + 1)]
        return sorted(found, key=lambda r: r.plan.predicted_seconds)


CAPSULES, FINER = Variant("capsule"), Variant("capsule", 0.5)
CELLS = {
    "12": Cell(
        12,
        {
            Variant("capsule", 0.5, 0.25): 8,
            Variant("capsule", 0.25): 4,
            FINER: 8,
            Variant("capsule", 0, 0.25): 8,
            Variant("capsule", 0, 0.5): 8,
            CAPSULES: 8,
            Variant("capsule", 0, 2): 8,
            Variant("capsule", 0, 4): 8,
            Variant("capsule", 1.5): 8,
            Variant("capsule", 1.5, 2): 8,
            Variant("capsule", 2, 2): 8,
            Variant("beads", 1): 8,
            Variant("beads", 1, 2): 8,
            Variant("beads", 0.5): 8,
            Variant("beads", 0.5, 2): 8,
            Variant("beads", 0.25): 8,
            Variant("beads", 0.25, 2): 8,
            Variant("beads", 0.125): 3,
        },
        {CAPSULES: 8, FINER: 4, Variant("beads", 0.5): 4},
    ),
    "30": Cell(
        30,
        {
            Variant("capsule", 0.5, 0.5): 4,
            FINER: 4,
            Variant("capsule", 0, 0.5): 4,
            CAPSULES: 4,
            Variant("capsule", 0, 2): 4,
            Variant("capsule", 0, 4): 4,
            Variant("beads", 1): 4,
            Variant("beads", 0.5): 4,
            Variant("beads", 0.25): 2,
        },
        {CAPSULES: 4},
    ),
}


@dataclass(frozen=True)
class Pressed:
    """A run: thickness (um) at PRESSURES and at TOLD, as built, processor seconds and beads."""

    thickness: FloatArray
    told: FloatArray
    built: float
    cpu: float
    beads: int
    steps: int


def pressed(folder: Path) -> Pressed | None:
    """What a run left; None where it is not there."""
    if not (folder / "results.h5").exists():
        return None
    results = store.read_results(folder / "results.h5")
    curve, summary = results.curve, results.summary
    deepest = int(np.argmax(curve["displacement_um"])) + 1
    pressure = np.maximum.accumulate(curve["pressure_MPa"][:deepest])
    thickness = curve["thickness_um"][:deepest]

    def at(wanted: FloatArray) -> FloatArray:
        return np.asarray(np.interp(wanted, pressure, thickness, right=np.nan))

    return Pressed(
        at(PRESSURES),
        at(TOLD),
        float(thickness[0]),
        float(summary["engine_cpu_s"]),
        int(summary["n_beads"]),
        int(summary["n_steps"]),
    )


def rms(values: FloatArray) -> float:
    """Root mean square of what is there."""
    return float(np.sqrt(np.nanmean(np.asarray(values) ** 2)))


@dataclass(frozen=True)
class Row:
    """A variant against the reference: ``specimens``, processor seconds, beads and steps of one run; mean error (um) at
    TOLD and its standard error; ``bias``: r.m.s. over PRESSURES of the mean error, ``noise`` of its standard error,
    ``single`` of one specimen's error; ``share`` of the displacement that the bias is."""

    variant: Variant
    specimens: int
    cpu: float
    beads: int
    steps: int
    told: FloatArray
    told_error: FloatArray
    bias: float
    noise: float
    single: float
    share: float

    @property
    def error(self) -> float:
        """The bias without what scatter alone makes of it, um."""
        return float(np.sqrt(max(self.bias**2 - self.noise**2, 0.0)))


def row_of(cell: Cell, out: Path, variant: Variant, against: Variant, n: int) -> Row | None:
    """A variant against another over the specimens that both have; None where there are none."""
    pairs = []
    for k in range(1, n + 1):
        one, other = (pressed(cell.folder(out, v, k)) for v in (variant, against))
        if one and other:
            pairs.append((one, other))
    if not pairs:
        return None
    error = np.array([a.thickness - b.thickness for a, b in pairs])
    told = np.array([a.told - b.told for a, b in pairs])
    few = np.sqrt(len(pairs))
    spread = np.nanstd(error, axis=0, ddof=1) / few if len(pairs) > 1 else np.full(error.shape[1], np.nan)
    bias = rms(np.nanmean(error, axis=0))
    way = float(np.mean([b.built - np.nanmean(b.thickness) for _, b in pairs]))
    return Row(
        variant,
        len(pairs),
        float(np.mean([a.cpu for a, _ in pairs])),
        int(np.mean([a.beads for a, _ in pairs])),
        int(np.mean([a.steps for a, _ in pairs])),
        np.nanmean(told, axis=0),
        np.nanstd(told, axis=0, ddof=1) / few if len(pairs) > 1 else np.full(3, np.nan),
        bias,
        rms(spread),
        rms(error),
        bias / way,
    )


def scatter(cell: Cell, out: Path, variant: Variant) -> tuple[int, float, FloatArray] | None:
    """(specimens, r.m.s. over curves, r.m.s. at TOLD) of the difference that moving a specimen by 1e-6 um makes."""
    found = []
    for k in range(1, cell.moved[variant] + 1):
        one, other = pressed(cell.folder(out, variant, k)), pressed(cell.folder(out, variant, k, True))
        if one and other:
            found.append((one.thickness - other.thickness, one.told - other.told))
    if not found:
        return None
    return (
        len(found),
        rms(np.array([f for f, _ in found])),
        np.sqrt(np.nanmean(np.array([t for _, t in found]) ** 2, axis=0)),
    )


def rows_of(cell: Cell, out: Path) -> list[Row]:
    """Every variant against the cell's reference."""
    found = [row_of(cell, out, v, cell.reference, n) for v, n in cell.variants.items() if v != cell.reference]
    return sorted((r for r in found if r), key=lambda r: r.cpu)


def text_of(cell: Cell, out: Path) -> str:
    """Tables of a cell."""
    r = [pressed(cell.folder(out, cell.reference, k)) for k in range(1, cell.variants[cell.reference] + 1)]
    have = [x for x in r if x]
    lines = [f"cell of {cell.filaments} filaments a yarn"]
    if have:
        mean = np.mean([x.told for x in have], axis=0)
        spread = np.std([x.told for x in have], axis=0, ddof=1) if len(have) > 1 else np.full(3, np.nan)
        lines.append(
            f"reference {cell.reference.name}, {len(have)} specimens, {np.mean([x.cpu for x in have]):.0f} CPU s: "
            f"{' '.join(f'{t:.0f} +- {s:.0f}' for t, s in zip(mean, spread, strict=True))} um at {TOLD} MPa (s.d.)"
        )
    lines.append(
        "| variant | specimens | beads | steps | CPU s | error at 0.05, 0.1, 0.2 MPa, um | r.m.s. of the mean "
        "curve, um (of displacement) | without scatter | one specimen |"
    )
    lines.append("|" + "---|" * 9)
    for row in rows_of(cell, out):
        told = ", ".join(f"{e:+.1f} ± {s:.1f}" for e, s in zip(row.told, row.told_error, strict=True))
        lines.append(
            f"| {row.variant.name} | {row.specimens} | {row.beads} | {row.steps} | {row.cpu:.3g} | {told} | "
            f"{row.bias:.1f} ± {row.noise:.1f} ({row.share:.1%}) | {row.error:.1f} | {row.single:.1f} |"
        )
    for variant in cell.moved:
        found = scatter(cell, out, variant)
        if found:
            told = ", ".join(f"{x:.1f}" for x in found[2])
            lines.append(f"moved by 1e-6 um: {variant.name}, {found[0]} specimens: r.m.s. {found[1]:.1f} um; {told} um")
    return "\n".join(lines)


COLOURS = {"capsule": "C0", "beads": "C3"}


def draw(cells: Sequence[Cell], out: Path) -> None:
    """Error against processor time, one panel a cell."""
    figure = new_figure(4.6 * len(cells), 3.9)
    for place, cell in enumerate(cells):
        ax = figure.add_subplot(1, len(cells), place + 1)
        for row in rows_of(cell, out):
            own = COLOURS[row.variant.shape]
            high, low = row.bias + row.noise, max(row.bias - row.noise, 0.3)
            ax.plot([row.cpu, row.cpu], [low, high], color=own, lw=0.8)
            ax.plot(row.cpu, row.bias, "o" if row.variant.shape == "capsule" else "s", color=own, ms=4)
            name = f"{row.variant.share:g} D" if row.variant.share else "auto"
            if row.variant.pace != 1:
                name += f", v x {row.variant.pace:g}"
            ax.annotate(name, (row.cpu, row.bias), xytext=(4, 2), textcoords="offset points", fontsize=7, color=own)
        found = [scatter(cell, out, v) for v in cell.moved]
        known = [f[1] for f in found if f]
        if known:
            ax.axhline(known[0], color="0.6", ls=":", lw=1)
            ax.annotate(
                "one run's scatter",
                (0.99, known[0]),
                xycoords=("axes fraction", "data"),
                ha="right",
                va="bottom",
                fontsize=7,
                color="0.4",
            )
        ax.set(
            xscale="log",
            yscale="log",
            xlabel="engine, CPU s",
            ylabel="error of the mean curve, um",
            title=f"2 x 2 yarns of {cell.filaments} filaments",
        )
        for shape, own in COLOURS.items():
            ax.plot([], [], "o" if shape == "capsule" else "s", color=own, ms=4, label=f"{shape}s".replace("ss", "s"))
        ax.legend(fontsize=7, loc="upper right")
    figure.savefig(FIGURE, dpi=90)


def told(done: float, total: float, last: str) -> None:
    """Progress."""
    print(f"{done / total:4.0%} {last}", flush=True)


def main() -> None:
    """Run what is missing, tell and draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=ROOT / "results" / "weave_contact")
    parser.add_argument("--cells", nargs="+", choices=list(CELLS), default=list(CELLS))
    parser.add_argument("--table", action="store_true")
    parser.add_argument("--longest", type=float, default=np.inf, help="leave out runs predicted to take longer, s")
    a = parser.parse_args()
    cells = [CELLS[name] for name in a.cells]
    for cell in cells:
        if not a.table:
            runs = [r for r in cell.runs(a.out) if r.plan.predicted_seconds <= a.longest]
            failed = run_all(runs, SweepOptions(resume=True, trim=True), told)
            for folder, why in failed.items():
                print(f"{folder.name}: {why}")
        print(text_of(cell, a.out))
    draw(cells, a.out)


if __name__ == "__main__":
    main()
