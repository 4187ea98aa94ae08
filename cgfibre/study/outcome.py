"""What the runs of a study say: curves to loads and branches, cases to ensembles, differences and fits."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cgfibre import units
from cgfibre.build.system import FloatArray
from cgfibre.errors import InputError
from cgfibre.measure.ensemble import Difference, Ensemble, difference, ensemble, load_grid, load_on, thickness_on
from cgfibre.measure.friction_power import FrictionFit, fit_specimens
from cgfibre.plan.model import Plan
from cgfibre.record import Curve
from cgfibre.scene import Scene
from cgfibre.study.file import LOADS, Cell, Compare, Study

#: of the common peak: where a grid of loads begins if one load alone is compared
LOWEST_SHARE = 1e-3
POINTS = 120


@dataclass(frozen=True)
class Branch:
    """Loading or unloading, first or again, of one run: ``displacement`` um, ``thickness`` um, ``load``, in order."""

    displacement: FloatArray
    thickness: FloatArray
    load: FloatArray
    unloading: bool


@dataclass(frozen=True)
class Specimen:
    """One run: its seed, branches by name ("loading", "unloading", "loading 2", ...), thickness as built (um), guards
    that spoke, processor seconds."""

    seed: int
    branches: Mapping[str, Branch]
    initial: float
    spoke: tuple[str, ...]
    cpu: float


@dataclass(frozen=True)
class Metric:
    """A number compared between cases: the column's ``name``, its unit, one value a specimen (nan: not reached)."""

    name: str
    unit: str
    values: tuple[float, ...]


@dataclass(frozen=True)
class CaseFound:
    """One case: what was asked, its specimens, reasons of the runs that failed, metrics by name, and by branch the
    ensembles of the thickness (um) at loads and of the load at displacements (um)."""

    cell: Cell
    specimens: tuple[Specimen, ...]
    failed: tuple[str, ...]
    metrics: Mapping[str, Metric]
    thickness: Mapping[str, Ensemble]
    load: Mapping[str, Ensemble]

    @property
    def label(self) -> str:
        """The case's, with how many specimens stand behind it."""
        n = len(self.specimens)
        return f"{self.cell.label} ({'one sample' if n == 1 else f'{n} samples'})"

    @property
    def trusted(self) -> bool:
        """Whether no guard spoke in any run."""
        return not any(s.spoke for s in self.specimens)

    @property
    def initial(self) -> float:
        """Mean thickness as built, um."""
        return float(np.mean([s.initial for s in self.specimens])) if self.specimens else math.nan

    def guards(self) -> list[str]:
        """ "quasi-static (2 of 3)": which guards spoke, in how many runs."""
        names = list(dict.fromkeys(name for s in self.specimens for name in s.spoke))
        return [f"{n} ({sum(n in s.spoke for s in self.specimens)} of {len(self.specimens)})" for n in names]


def depth_of(scene: Scene, plan: Plan) -> float:
    """Length along the filaments over which a platen's force is spread, um: a section's depth, the platen's width."""
    if plan.depth > 0:
        return plan.depth
    if plan.woven is not None:
        return plan.woven.size[0]
    width = scene.platens.width
    return float(scene.bundle.length if width == "full" else width)


def load_of(curve: Curve, kind: str, depth: float) -> FloatArray:
    """Load of every sample: N/mm over ``depth`` um, MPa under the platen, or N on the top platen."""
    if kind == "pressure":
        return curve["pressure_MPa"]
    return curve["force_top_N"] / (depth * 1e-3) if kind == "line_force" else curve["force_top_N"]


def branches_of(curve: Curve, load: FloatArray) -> dict[str, Branch]:
    """The branches in their order, each from the turning point on: "loading", "unloading", "loading 2", ..."""
    phase = curve.phase  # of every cycle
    ends = np.flatnonzero(np.diff(phase)) + 1
    found: dict[str, Branch] = {}
    counts = {"loading": 0, "unloading": 0}
    for begin, end in zip([0, *ends], [*ends, len(curve)], strict=True):
        if phase[begin] == 1:
            continue
        kind = "unloading" if phase[begin] == 2 else "loading"
        counts[kind] += 1
        part = slice(max(int(begin) - 1, 0), int(end))
        name = kind if counts[kind] == 1 else f"{kind} {counts[kind]}"
        found[name] = Branch(
            curve["displacement_um"][part], curve["thickness_um"][part], load[part], kind == "unloading"
        )
    return found


# --- one case ---------------------------------------------------------------------------------------------------------


def _digits(value: float) -> str:
    return f"{value:.4g}"


def metrics_of(specimens: Sequence[Specimen], compare: Compare, branch: str) -> list[Metric]:
    """What [compare] asks of a branch; the columns of every other branch than "loading" begin with its name."""
    prefix = "" if branch == "loading" else branch.replace(" ", "_") + "_"
    unit = LOADS[compare.kind][1]
    slug = unit.replace("/", "_per_")
    own = [s.branches.get(branch) for s in specimens]
    found = []

    def add(name: str, of_unit: str, values: Sequence[float]) -> None:
        found.append(Metric(prefix + name, of_unit, tuple(float(v) for v in values)))

    for load in compare.values:
        at = [math.nan if b is None else float(thickness_on(b.thickness, b.load, load, b.unloading)) for b in own]
        add(f"thickness_um_at_{_digits(load)}_{slug}", "um", at)
    for text in compare.displacements:
        d = units.parse(text, "um", "compare.displacements")
        at = [math.nan if b is None else float(load_on(b.displacement, b.load, d)) for b in own]
        add(f"load_{slug}_at_{_digits(d)}_um", unit, at)
    for share in compare.reductions:
        ones = zip(own, specimens, strict=True)
        at = [math.nan if b is None else float(load_on(-b.thickness, b.load, (share - 1) * s.initial)) for b, s in ones]
        add(f"load_{slug}_at_{_digits(100 * share)}_percent", unit, at)
    return found


def _ensembles(branches: Sequence[Branch], compare: Compare) -> tuple[Ensemble, Ensemble] | None:
    """(thickness at loads, load at displacements) of one branch of every specimen; None where no load was met."""
    peak = min(float(np.max(b.load, initial=0.0)) for b in branches)
    lowest = compare.values[0] if len(compare.values) > 1 else LOWEST_SHARE * peak
    if not lowest < peak:
        return None
    loads = load_grid(lowest, peak, POINTS)
    low = max(float(np.min(b.displacement)) for b in branches)
    high = min(float(np.max(b.displacement)) for b in branches)
    d = np.linspace(low, high, POINTS)
    return (
        ensemble(loads, [thickness_on(b.thickness, b.load, loads, b.unloading) for b in branches]),
        ensemble(d, [load_on(b.displacement, b.load, d) for b in branches]),
    )


def find_case(cell: Cell, specimens: Sequence[Specimen], failed: Sequence[str], compare: Compare) -> CaseFound:
    """All that a case's runs say; a branch has ensembles where every specimen has it."""
    names = [n for n in specimens[0].branches if all(n in s.branches for s in specimens)] if specimens else []
    metrics = {m.name: m for name in names for m in metrics_of(specimens, compare, name)}
    thickness, load = {}, {}
    for name in names:
        both = _ensembles([s.branches[name] for s in specimens], compare)
        if both is not None:
            thickness[name], load[name] = both
    return CaseFound(cell, tuple(specimens), tuple(failed), metrics, thickness, load)


# --- all cases --------------------------------------------------------------------------------------------------------


def reached(values: Sequence[float]) -> list[float]:
    """Those values that are numbers."""
    return [v for v in values if math.isfinite(v)]


def differences(cases: Sequence[CaseFound]) -> dict[str, dict[str, Difference]]:
    """By case and metric: how far its mean is from the first case's, with Welch's interval."""
    if len(cases) < 2:
        return {}
    first = cases[0].metrics
    return {
        case.cell.slug: {
            name: difference(reached(m.values), reached(first[name].values))
            for name, m in case.metrics.items()
            if name in first
        }
        for case in cases[1:]
    }


def axis_of(study: Study, cases: Sequence[CaseFound]) -> tuple[str, list[float]] | None:
    """(label, numbers) of the axis of the only key that varies, where its values are numbers or of one unit."""
    if len(study.vary) != 1 or len(study.case) > 1:
        return None
    vary = study.vary[0]
    name = vary.name or vary.key.rpartition(".")[2]
    values = [case.cell.values[vary.key] for case in cases]
    if all(type(v) in (int, float) for v in values):
        return name, [float(v) for v in values]
    parts = [str(v).split(maxsplit=1) for v in values]
    try:
        numbers = [float(p[0]) for p in parts]
    except ValueError:
        return None
    kinds = {p[1] if len(p) > 1 else "" for p in parts}
    return (f"{name} ({kinds.pop()})", numbers) if len(kinds) == 1 else None


def fit_of(study: Study, cases: Sequence[CaseFound]) -> FrictionFit | None:
    """The fit that the study asks for; None where it asks for none or the runs do not tell it.

    Specimens are told apart by their number among the starts; one that is missing in a case is left out there.
    """
    if study.fit is None:
        return None
    compare = study.compare
    names = [f"thickness_um_at_{_digits(load)}_N_per_mm" for load in compare.values]
    full = [case for case in cases if case.specimens and all(n in case.metrics for n in names)]
    if not full:
        return None
    n = max(len(case.specimens) for case in full)
    t = np.full((n, len(full), len(names)), np.nan)
    for j, case in enumerate(full):
        for k, name in enumerate(names):
            t[: len(case.specimens), j, k] = case.metrics[name].values
    key = study.vary[0].key
    mu = [float(case.cell.values[key]) for case in full]
    try:
        return fit_specimens(compare.values, mu, t * 1e-3, study.fit.law == "friction-power")
    except InputError:
        return None


def plain_fit(fit: FrictionFit) -> dict[str, Any]:
    """A fit for summary.json."""
    return {
        "law": "t = c P^(a mu - b)",
        "c_mm": fit.law.c,
        "a": fit.law.a,
        "b": fit.law.b,
        "c_ci": fit.c_ci,
        "a_ci": fit.a_ci,
        "b_ci": fit.b_ci,
        "misfit": fit.misfit,
        "n_points": fit.n_points,
    }
