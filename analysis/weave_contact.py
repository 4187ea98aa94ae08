"""Weaves filament by filament, by capsules and by beads: what each costs and gets wrong (docs/fabrics.md).

    python analysis/weave_contact.py [--cells 12 30] [--out results/weave_contact] [--table]

Presses 2 x 2 cells of nylon yarns of 12 and of 30 filaments to 0.2 MPa: the same specimens (packings) by every
variant. Runs that lie in the folder already are found again, one that was stopped goes on. Hours for all of it: the
finest beads take most. ``--table``: no runs, tables and the figure docs/figures/fabric_contact.png of what is there.

The error of a variant is the difference of its thickness to that of the reference (finer capsules under a slower
platen) at the same pressure and of the same specimen; that of its contacts alone the difference to the finer capsules
under a platen as fast. Filaments that give way make a single pair of curves differ by
more than any variant's fault: a specimen moved by 1e-6 um shows by how much. So errors are the mean over specimens,
with its standard error, and what is compared is that mean curve. Times at equal error: see :func:`equals`.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cgfibre import store
from cgfibre.build.system import FloatArray
from cgfibre.plot import new_figure
from cgfibre.sweep import SweepOptions, SweepRun, run_all

if TYPE_CHECKING:
    from matplotlib.axes import Axes

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

    def beside(self, variant: Variant) -> Variant | None:
        """The finer capsules under a platen as fast; None where they are not run."""
        finer = Variant("capsule", 0.5, variant.pace)
        return finer if finer in self.variants and variant != finer else None

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
            Variant("capsule", 0.5, 2): 8,
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
            Variant("beads", 0.5, 0.25): 8,
            Variant("beads", 0.5, 0.5): 8,
            Variant("beads", 0.5): 8,
            Variant("beads", 0.5, 2): 8,
            Variant("beads", 0.25): 8,
            Variant("beads", 0.25, 2): 8,
        },
        {CAPSULES: 8, FINER: 4, Variant("beads", 0.5): 4},
    ),
    "30": Cell(
        30,
        {
            Variant("capsule", 0.5, 0.5): 6,
            FINER: 6,
            Variant("capsule", 0.5, 2): 6,
            Variant("capsule", 0, 0.5): 6,
            CAPSULES: 6,
            Variant("capsule", 0, 2): 6,
            Variant("capsule", 0, 4): 6,
            Variant("beads", 1): 6,
            Variant("beads", 0.5): 6,
            Variant("beads", 0.5, 2): 6,
            Variant("beads", 0.25): 2,
        },
        {CAPSULES: 6},
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


@cache
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
    """Root mean square of what is there; nan of nothing."""
    found = np.asarray(values)[np.isfinite(values)]
    return float(np.sqrt(np.mean(found**2))) if len(found) else np.nan


@dataclass(frozen=True)
class Against:
    """Thickness of a variant less that of another: ``specimens`` that both pressed; mean error (um) at TOLD and its
    standard error; ``bias``: r.m.s. over PRESSURES of the mean error, ``noise``: that of its standard error, ``single``
    that of one specimen's error; ``share`` of the displacement that the bias is."""

    specimens: int
    told: FloatArray
    told_error: FloatArray
    bias: float
    noise: float
    single: float
    share: float


@dataclass(frozen=True)
class Row:
    """A variant: least processor seconds a step times steps, beads and steps of one run; all of its error, and that of
    its contacts."""

    variant: Variant
    cpu: float
    beads: int
    steps: int
    whole: Against
    contact: Against | None

    def error(self, contact: bool) -> Against | None:
        """Of the ``contact`` alone, None where that is not known, or all of it."""
        return self.contact if contact else self.whole


def against(cell: Cell, out: Path, variant: Variant, other: Variant) -> Against | None:
    """A variant against another; None where no specimen was pressed by both."""
    pairs = []
    for k in range(1, cell.variants[variant] + 1):
        one, two = (pressed(cell.folder(out, v, k)) for v in (variant, other))
        if one and two:
            pairs.append((one, two))
    if not pairs:
        return None
    error = np.array([a.thickness - b.thickness for a, b in pairs])
    told = np.array([a.told - b.told for a, b in pairs])
    bias = rms(np.nanmean(error, axis=0))
    way = float(np.mean([b.built - np.nanmean(b.thickness) for _, b in pairs]))
    return Against(
        len(pairs),
        np.nanmean(told, axis=0),
        standard_error(told),
        bias,
        rms(standard_error(error)),
        rms(error),
        bias / way,
    )


def standard_error(values: FloatArray) -> FloatArray:
    """Of the mean over the first axis; nan for one value."""
    few = len(values)
    return np.nanstd(values, axis=0, ddof=1) / few**0.5 if few > 1 else np.full(values.shape[1], np.nan)


def row_of(cell: Cell, out: Path, variant: Variant) -> Row | None:
    """A variant of a cell; None where it was not run."""
    runs = [pressed(cell.folder(out, variant, k)) for k in range(1, cell.variants[variant] + 1)]
    have = [run for run in runs if run]
    whole = against(cell, out, variant, cell.reference)
    if whole is None:
        return None
    beside = cell.beside(variant)
    return Row(
        variant,
        # what else the machine did meanwhile only adds
        float(min(run.cpu / run.steps for run in have) * np.mean([run.steps for run in have])),
        int(np.mean([run.beads for run in have])),
        int(np.mean([run.steps for run in have])),
        whole,
        against(cell, out, variant, beside) if beside else None,
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
    """Every variant but the reference, cheap ones first."""
    found = [row_of(cell, out, v) for v in cell.variants if v != cell.reference]
    return sorted((r for r in found if r), key=lambda r: r.cpu)


def fronts(rows: Sequence[Row], contact: bool) -> dict[str, list[tuple[float, Row]]]:
    """(error um, row) by shape, of ``rows``, cheap ones first, whose error nothing cheaper of their shape meets;
    ``contact``: of contacts alone.

    Without beads a diameter apart: their errors grow as the platen gets slower, what they meet at a speed is chance.
    """
    found: dict[str, list[tuple[float, Row]]] = {"capsule": [], "beads": []}
    for row in rows:
        error, front = row.error(contact), found[row.variant.shape]
        if (row.variant.shape, row.variant.share) == ("beads", 1) or error is None:
            continue
        if not front or error.bias < front[-1][0]:
            front.append((error.bias, row))
    return found


def equals(rows: Sequence[Row], contact: bool) -> list[tuple[float, Row, float]]:
    """(error um, capsules, CPU s of beads with the same error) for capsules within the errors that beads meet, by
    interpolation along their front (logarithms of both)."""
    found = fronts(rows, contact)
    if len(found["beads"]) < 2:
        return []
    errors, seconds = np.log([(error, row.cpu) for error, row in reversed(found["beads"])]).T
    return [
        (error, row, float(np.exp(np.interp(np.log(error), errors, seconds))))
        for error, row in found["capsule"]
        if errors[0] <= np.log(error) <= errors[-1]
    ]


def text_of(cell: Cell, out: Path) -> str:
    """Tables of a cell."""
    runs = [pressed(cell.folder(out, cell.reference, k)) for k in range(1, cell.variants[cell.reference] + 1)]
    have = [run for run in runs if run]
    lines = [f"Yarns of {cell.filaments} filaments"]
    if have:
        told = np.array([run.told for run in have])
        spread = told.std(axis=0, ddof=1) if len(have) > 1 else np.full(3, np.nan)
        each = ", ".join(f"{t:.0f} ± {s:.0f}" for t, s in zip(told.mean(axis=0), spread, strict=True))
        cpu = np.mean([run.cpu for run in have])
        lines.append(f"{cell.reference.name}: {each} um (± between {len(have)} specimens), {cpu:.0f} CPU s")
    head = "| variant | specimens | beads | steps | CPU s | "
    head += "its contacts, um: at 0.05, 0.1, 0.2 MPa; r.m.s. (of displacement) | all of it |"
    lines += [head, "|" + "---|" * 7]

    def words(a: Against | None) -> str:
        if a is None:
            return ""
        at = ", ".join(f"{e:+.1f} ± {s:.1f}" for e, s in zip(a.told, a.told_error, strict=True))
        return f"{at}; {a.bias:.1f} ± {a.noise:.1f} ({a.share:.1%}), one specimen {a.single:.1f}"

    rows = rows_of(cell, out)
    for r in rows:
        few = r.whole.specimens
        start = f"| {r.variant.name} | {few} | {r.beads} | {r.steps} | {r.cpu:.3g} | "
        lines.append(f"{start}{words(r.contact)} | {words(r.whole)} |")
    for contact, what in ((True, "contacts alone"), (False, "all of it")):
        for error, row, beads in equals(rows, contact):
            each = f"{row.variant.name} {row.cpu:.3g} s, beads {beads:.3g} s"
            lines.append(f"{what}, at {error:.1f} um: {each}: {beads / row.cpu:.1f} times")
    for variant in cell.moved:
        found = scatter(cell, out, variant)
        if found:
            each = ", ".join(f"{x:.1f}" for x in found[2])
            lines.append(f"moved by 1e-6 um: {variant.name}, {found[0]} specimens: r.m.s. {found[1]:.1f} um; {each} um")
    return "\n".join(lines)


COLOURS, MARKS = {"capsule": "C0", "beads": "C3"}, {"capsule": "o", "beads": "s"}
#: of the axes: CPU s and um
SECONDS, ERRORS = (1.0, 300.0), (0.2, 80.0)
SMALL: dict[str, Any] = {"fontsize": 7, "color": "0.4", "va": "bottom"}


def draw(cells: Sequence[Cell], out: Path) -> None:
    """Errors against processor time: of the contacts above, all of them below, a column a cell."""
    figure = new_figure(5.6 * len(cells), 8.0)
    for place, cell in enumerate(cells):
        known = [f[1] for f in (scatter(cell, out, v) for v in cell.moved) if f]
        rows = rows_of(cell, out)
        for contact, title in ((True, "contacts alone"), (False, "with the platen's speed")):
            ax = figure.add_subplot(2, len(cells), (not contact) * len(cells) + place + 1)
            for row in rows:
                if (error := row.error(contact)) is not None:
                    _mark(ax, row, error)
            if known:
                ax.axhline(known[0], color="0.6", ls=":", lw=1)
                ax.text(0.99, known[0], "scatter of one run", transform=ax.get_yaxis_transform(), ha="right", **SMALL)
            ax.set(xscale="log", yscale="log", ylabel="error of the mean curve, um", xlim=SECONDS, ylim=ERRORS)
            ax.set_title(f"{cell.filaments} filaments a yarn, {title}", fontsize=9)
            if not contact:
                ax.set_xlabel("engine, CPU s")
            for shape, own in COLOURS.items():
                name = "capsules" if shape == "capsule" else shape
                ax.plot([], [], MARKS[shape], color=own, ms=4, label=name)
            ax.legend(fontsize=7)
    figure.savefig(FIGURE, dpi=90)


def _mark(ax: Axes, row: Row, error: Against) -> None:
    own = COLOURS[row.variant.shape]
    ax.plot([row.cpu] * 2, [max(error.bias - error.noise, ERRORS[0]), error.bias + error.noise], color=own, lw=0.8)
    ax.plot(row.cpu, error.bias, MARKS[row.variant.shape], color=own, ms=4)
    name = f"{row.variant.share:g} D" if row.variant.share else "auto"
    name += f", v x {row.variant.pace:g}" if row.variant.pace != 1 else ""
    # capsules below their marks, beads above: cheap variants lie close
    up = 4 if row.variant.shape == "beads" else -9
    ax.annotate(name, (row.cpu, error.bias), xytext=(4, up), textcoords="offset points", color=own, fontsize=7)


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
