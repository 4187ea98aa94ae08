"""Verb ``towtest``: from files of tow compaction tests to moduli, Poisson's ratios, laws and predicted thickness."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np

from cgfibre import plot_towtest, store, units
from cgfibre.build.system import FloatArray
from cgfibre.errors import InputError
from cgfibre.measure import compaction
from cgfibre.measure.compaction import PowerLaw
from cgfibre.measure.towtest import (
    PARAMETERS,
    TOUCHES,
    BedFit,
    Geometry,
    LawFit,
    MeanCurve,
    TowTest,
    Zones,
    find_zones,
    first_touch,
    fit_empirical_law,
    fit_fibre_beds,
    mean_curve,
    reduce_test,
)
from cgfibre.mechanics.compaction_laws import Conditions
from cgfibre.readers import Table, read_table

#: what the verb leaves in its folder
FILES = ("summary.json", "tests.csv", "curves.csv", "mean.csv", "towtest.png", "laws.png")
GAP = ("thickness", "gap", "height")
DISPLACEMENT = ("displacement", "travel", "stroke", "extension", "crosshead", "position")
FORCE = ("force", "load")
WIDTH = ("width",)
#: longer records are folded to means of consecutive rows
MOST_SAMPLES = 20_000
#: um along the tow, of the thesis' anvil
ANVIL = 500.0
#: names of header lines, and the units of bare numbers in them
NOTES = {
    "tow": (("tow size", "tow", "filaments"), ""),
    "twist": (("twist",), "turn/cm"),
    "preload": (("pre-load", "preload", "pre-tension", "pretension"), "cN"),
    "thickness": (("initial thickness", "thickness"), "mm"),
    "width": (("initial width", "tow width", "width"), "mm"),
    "anvil": (("anvil",), "mm"),
}


@dataclass(frozen=True)
class TowOptions:
    """How to read tests, in engine units; what is None is taken from each file's header lines.

    ``anvil`` um along the tow; ``thickness`` um initial; ``width`` um of the tow, one for all samples, or ``widths``
    files of width against displacement or thickness (one for all tests or one each); ``tow`` thousands of filaments,
    ``twist`` turns/cm, ``preload`` cN (one for all tests or one each); ``columns`` names or numbers of displacement (or
    thickness), force and, if there is one, width; ``window`` MPa of pressures to fit; ``diameter`` um of a filament;
    ``at`` MPa, pressures at which to predict the thickness; ``touch`` as in
    :class:`~cgfibre.measure.towtest.Geometry`, or "auto": "record" where a thickness is recorded and its initial value
    known, else "fit"; ``out``, ``force`` as elsewhere.
    """

    out: Path
    anvil: float | None = None
    thickness: float | None = None
    width: float | None = None
    widths: tuple[Path, ...] = ()
    tow: tuple[float, ...] = ()
    twist: tuple[float, ...] = ()
    preload: tuple[float, ...] = ()
    columns: tuple[str, ...] = ()
    window: tuple[float, float] | None = None
    diameter: float = 7.0
    at: tuple[float, ...] = ()
    touch: float | str = "auto"
    force: bool = False


@dataclass(frozen=True)
class Specimen:
    """One test of a file, reduced: ``law`` is eps = a p^b of it; ``conditions`` None where the file states none.

    ``noise_law`` is what ``law`` would be with the touch taken out of the noise, where it was fitted.
    """

    name: str
    test: TowTest
    law: PowerLaw
    conditions: Conditions | None
    width_varies: bool
    noise_law: PowerLaw | None = None


@dataclass(frozen=True)
class Group:
    """Trials under the same conditions: their mean, its power law and zones (None where there are too few samples)."""

    name: str
    conditions: Conditions | None
    specimens: tuple[Specimen, ...]
    mean: MeanCurve
    law: PowerLaw
    zones: Zones | None
    beds: tuple[BedFit, ...]
    volume_fraction: FloatArray | None


@dataclass(frozen=True)
class TowResult:
    """All tests by conditions, the empirical law of the set (None without conditions), the summary and its folder."""

    out: Path
    groups: tuple[Group, ...]
    law: LawFit | None
    summary: dict[str, Any]


def analyse_tests(files: Sequence[Path], options: TowOptions) -> TowResult:
    """Reduce, average and fit the tests of ``files``, and write :data:`FILES` into ``options.out``.

    Files of the same tow size, twist and pre-load are trials of one condition. Raises InputError, in one line and
    before anything is written, for a file that is no test record or lacks what an option could give.
    """
    if not files:
        raise InputError("FILES", (), "one test record or more")
    store.check_folder(options.out, FILES, options.force)
    specimens = [_specimen(path, k, len(files), options) for k, path in enumerate(files)]
    groups = _grouped(specimens, options)
    law = None
    stated = [s for s in specimens if s.conditions is not None]
    if len(stated) == len(specimens):
        law = fit_empirical_law(
            [s.test for s in stated], [s.conditions for s in stated if s.conditions is not None], options.window
        )
    summary = _summary(groups, law, options)
    options.out.mkdir(parents=True, exist_ok=True)
    _write(groups, law, summary, options)
    return TowResult(options.out, groups, law, summary)


# --- reading -----------------------------------------------------------------------------------------------------


def _specimen(path: Path, k: int, n: int, options: TowOptions) -> Specimen:
    table = read_table(path, MOST_SAMPLES)
    names = options.columns
    if names and len(names) not in (2, 3):
        raise InputError("--columns", ",".join(names), "displacement (or thickness), force and, if any, width")
    gap, along = _displacement(table, names)
    column = table.index(names[1], "--columns") if names else table.find(FORCE)
    if column is None:
        raise InputError(str(path), table.listed, "a column of the force; name it with --columns")
    force = table.quantity(column, "nN", "N")
    thickness = _length(table, "thickness", options.thickness)
    touch: float | str = options.touch
    if touch == "auto":
        touch = "record" if gap and thickness is not None else "fit"
    if thickness is None and gap:
        level = None if isinstance(touch, str) else touch
        thickness = float(along[first_touch(force, level).index])
    if thickness is None:
        raise InputError("--thickness", None, f"the initial thickness, which {table.source} does not state")
    displacement = thickness - along if gap else along
    width, varies = _width(table, k, n, options, displacement, thickness)
    anvil = _length(table, "anvil", options.anvil) or ANVIL
    try:
        test = reduce_test(displacement, force, width, Geometry(anvil, thickness, touch))
        law = test.power_law(options.window)
        other = None
        if touch == "fit":
            other = reduce_test(displacement, force, width, Geometry(anvil, thickness, "noise")).power_law(
                options.window
            )
    except InputError as error:
        raise InputError(f"{table.source}: {error.key}", error.value, error.expected) from None
    return Specimen(path.stem, test, law, _conditions(table, k, n, options), varies, other)


def _displacement(table: Table, names: tuple[str, ...]) -> tuple[bool, FloatArray]:
    """(whether it is a gap that closes, values um)."""
    column = table.index(names[0], "--columns") if names else table.find(DISPLACEMENT)
    if column is None:
        column = table.find(GAP)
    if column is None:
        raise InputError(table.source, table.listed, "a column of displacement or thickness; name it with --columns")
    name = table.names[column].lower()
    return any(word in name for word in GAP), table.quantity(column, "um", "mm")


def _width(
    table: Table, k: int, n: int, options: TowOptions, displacement: FloatArray, thickness: float
) -> tuple[FloatArray | float, bool]:
    """(width um at each sample or one for all, whether it was measured along the test)."""
    names = options.columns
    column = table.index(names[2], "--columns") if len(names) == 3 else None if names else table.find(WIDTH)
    if column is not None:
        return table.quantity(column, "um", "mm"), True
    if options.widths:
        measured = read_table(_one_of(options.widths, k, n, "--widths"))
        at, along = measured.find(WIDTH), measured.find(DISPLACEMENT)
        by = displacement
        if along is None:
            along, by = measured.find(GAP), thickness - displacement
        if at is None or along is None:
            expected = "columns of width and of displacement or thickness"
            raise InputError(measured.source, measured.listed, expected)
        x, w = measured.quantity(along, "um", "mm"), measured.quantity(at, "um", "mm")
        order = np.argsort(x, kind="stable")
        return np.interp(by, x[order], w[order]), len(x) > 1
    width = _length(table, "width", options.width)
    if width is None:
        raise InputError("--width", None, f"the tow's width (or --widths FILE), which {table.source} does not state")
    return width, False


def _one_of(values: Sequence[Any], k: int, n: int, key: str) -> Any:
    if len(values) not in (1, n):
        raise InputError(key, len(values), f"given once, or once for each of the {n} files")
    return values[k] if len(values) == n else values[0]


def _note(table: Table, key: str) -> tuple[str, str] | None:
    """(text, unit in the name) of a header line such as "Twist (turn/cm): 0,26"."""
    words, default = NOTES[key]
    for word in words:
        for name, text in table.notes.items():
            bare = re.sub(r"\s*[(\[].*", "", name)
            if bare == word or bare.startswith(word + " ") or bare.endswith(" " + word):
                unit = re.search(r"[(\[]\s*([^)\]]+)", name)
                return re.sub(r"(\d),(\d)", r"\1.\2", text), unit[1].strip() if unit else default
    return None


def _length(table: Table, key: str, given: float | None) -> float | None:
    if given is not None:
        return given
    note = _note(table, key)
    if note is None:
        return None
    return _quantity(note, "um", f"{table.source}: {key}")


def _quantity(note: tuple[str, str], unit: str, key: str) -> float:
    text, default = note
    bare = re.fullmatch(r"[+-]?[\d.]+(?:[eE][+-]?\d+)?", text)
    return units.parse(f"{text} {default}" if bare else text, unit, key)


def tow_size(text: str, key: str) -> float:
    """Thousands of filaments of "12k", "12 k", "12000", or "1.5k". Raises InputError for anything else."""
    match = re.fullmatch(r"\s*(\d+(?:\.\d+)?)\s*(k?)\s*(?:filaments)?\s*", text, re.IGNORECASE)
    value = 0.0 if match is None else float(match[1]) * (1 if match[2] else 1e-3)
    if not value > 0:
        raise InputError(key, text, "a tow size such as '12k' or '12000'")
    return value


def _conditions(table: Table, k: int, n: int, options: TowOptions) -> Conditions | None:
    found: dict[str, float] = {}
    for key, given in (("tow", options.tow), ("twist", options.twist), ("preload", options.preload)):
        if given:
            found[key] = float(_one_of(given, k, n, f"--{key}"))
            continue
        note = _note(table, key)
        if note is None:
            continue
        where = f"{table.source}: {key}"
        if key == "tow":
            found[key] = tow_size(note[0], where)
        elif key == "twist":
            found[key] = _quantity(note, "turn/um", where) * 1e4
        else:
            found[key] = _quantity(note, "nN", where) * 1e-7
    if not found:
        return None
    missing = [key for key in ("tow", "twist", "preload") if key not in found]
    if missing:
        option = {"tow": "--tow", "twist": "--twist", "preload": "--pre-load"}[missing[0]]
        raise InputError(option, None, f"given, as {' and '.join(found)} of {table.source} are (or none of the three)")
    return Conditions(**found)


# --- groups and what is said of them -----------------------------------------------------------------------------


def _grouped(specimens: Sequence[Specimen], options: TowOptions) -> tuple[Group, ...]:
    by: dict[Conditions | None, list[Specimen]] = {}
    for s in specimens:
        by.setdefault(s.conditions, []).append(s)
    order = sorted(by, key=lambda c: (0.0, 0.0, 0.0) if c is None else (c.tow, c.twist, c.preload))
    return tuple(_group(c, tuple(by[c]), options) for c in order)


def _group(conditions: Conditions | None, specimens: tuple[Specimen, ...], options: TowOptions) -> Group:
    name = "tests" if conditions is None else name_of(conditions)
    mean = mean_curve([s.test for s in specimens])
    zones = None
    if len(mean.pressure) >= 12 and np.all(mean.strain > 0):
        zones = find_zones(mean.pressure, mean.strain)
    beds: tuple[BedFit, ...] = ()
    fraction = None
    if conditions is not None:
        parts = []
        for s in specimens:
            t = s.test
            count = round(1000 * conditions.tow)
            v = compaction.fibre_volume_fraction(count, options.diameter, t.width, t.thickness)[t.loading]
            p = t.pressure[t.loading]
            parts.append(compaction.thickness_at_pressure(v, p, mean.pressure))
        fraction = np.mean(parts, axis=0)
        known = np.isfinite(fraction)
        if np.all(fraction[known] < 1):
            beds = tuple(fit_fibre_beds(mean.pressure[known], fraction[known]))
    law = compaction.fit_power_law(mean.pressure, mean.strain, options.window)
    return Group(name, conditions, specimens, mean, law, zones, beds, fraction)


def name_of(c: Conditions) -> str:
    """Conditions in words: "12k, 0.26 turn/cm, 10 cN"."""
    return f"{c.tow:g}k, {c.twist:g} turn/cm, {c.preload:g} cN"


def _summary(groups: tuple[Group, ...], law: LawFit | None, options: TowOptions) -> dict[str, Any]:
    warnings = []
    for g in groups:
        if g.volume_fraction is not None and not g.beds:
            top = float(np.nanmax(g.volume_fraction))
            warnings.append(
                f"{g.name}: fibre volume fraction {top:.2f}, above 1: width, thickness or tow size is wrong"
            )
    moved = [s for g in groups for s in g.specimens if s.noise_law and abs(s.noise_law.b / s.law.b - 1) > 0.1]
    if moved:
        first = moved[0]
        warnings.append(
            f"where the anvil touches matters: b of {first.name} is {first.law.b:.3g} fitted, "
            f"{first.noise_law.b if first.noise_law else 0:.3g} out of the noise; record the gap, and --thickness"
        )
    if law is not None and law.held:
        warnings.append(f"the tests cannot tell {', '.join(law.held)}: kept at the thesis' values")
    return {
        "conditions": [_group_summary(g, law, options) for g in groups],
        "empirical_law": None if law is None else _law_summary(law),
        "warnings": warnings,
    }


def _group_summary(g: Group, law: LawFit | None, options: TowOptions) -> dict[str, Any]:
    tests = [s.test for s in g.specimens]
    peak = [float(t.pressure[t.turn - 1]) for t in tests]
    losses = [t.hysteresis().fraction for t in tests if len(t.force) > t.turn]
    poisson = [t.poisson_ratio()[t.turn - 1] for t, s in zip(tests, g.specimens, strict=True) if s.width_varies]
    initial = float(np.mean([t.thickness[0] for t in tests]))
    strains = [e for e in (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8) if g.mean.strain[0] <= e <= g.mean.strain[-1]]
    pressures = options.at or tuple(np.geomspace(g.mean.pressure[0], g.mean.pressure[-1], 4)[1:])
    return {
        "name": g.name,
        **({} if g.conditions is None else asdict(g.conditions)),
        "n_tests": len(tests),
        "initial_thickness_um": initial,
        "peak_pressure_MPa": float(np.mean(peak)),
        "power_law": _power(g.law),
        "modulus_MPa": {f"{e:g}": float(g.law.modulus(e)) for e in strains},
        "poisson_ratio_at_peak": _mean_sd(poisson),
        "hysteresis_loss": _mean_sd(losses),
        "zones": None
        if g.zones is None
        else {
            "breaks_MPa": g.zones.breaks,
            "strain_at_breaks": g.zones.strains,
            "exponents": g.zones.slopes,
            "exponent_errors": g.zones.slope_errors,
            "bic": g.zones.bic,
        },
        "fibre_beds": [
            {"name": b.name, **asdict(b.law), "rms": b.rms, "aic": b.aic, "at_bound": b.at_bound} for b in g.beds
        ],
        "thickness": [_thickness(g, law, p, initial) for p in pressures],
    }


def _power(law: PowerLaw) -> dict[str, Any]:
    return asdict(law)


def _mean_sd(values: Sequence[float]) -> dict[str, Any] | None:
    if not values:
        return None
    return {"mean": float(np.mean(values)), "sd": float(np.std(values, ddof=1)) if len(values) > 1 else None}


def _thickness(g: Group, law: LawFit | None, pressure: float, initial: float) -> dict[str, Any]:
    """Thickness at a pressure: measured (mean of the trials, none beyond their range) and of the set's law."""
    inside = g.mean.pressure[0] <= pressure <= g.mean.pressure[-1]
    strain = float(np.interp(np.log(pressure), np.log(g.mean.pressure), g.mean.strain)) if inside else None
    row: dict[str, Any] = {
        "pressure_MPa": float(pressure),
        "measured_um": None if strain is None else initial * (1 - strain),
    }
    if law is not None and g.conditions is not None:
        predicted = float(law.law.strain(pressure, g.conditions))
        row["predicted_um"] = initial * (1 - predicted) if predicted < 1 else None
        row["predicted_error_um"] = initial * predicted * float(law.strain_error(pressure, g.conditions)[0])
    return row


def _law_summary(law: LawFit) -> dict[str, Any]:
    errors = law.errors
    return {
        **asdict(law.law),
        "a0_error": law.law.a0 * float(errors[0]),
        **{f"{name}_error": float(e) for name, e in zip(PARAMETERS[1:], errors[1:], strict=True)},
        "parameters": PARAMETERS,
        "covariance": law.covariance,
        "correlation": law.correlation,
        "held": law.held,
        "rms_deviation": law.rms,
        "worst_deviation": law.worst,
        "n_tests": law.n_tests,
        "n_samples": law.n_samples,
    }


def _write(groups: tuple[Group, ...], law: LawFit | None, summary: dict[str, Any], options: TowOptions) -> None:
    out = options.out
    store.write_json(out / "summary.json", summary)
    nan = float("nan")
    rows: list[dict[str, Any]] = []
    curves: dict[str, list[Any]] = {name: [] for name in CURVES}
    mean: dict[str, list[Any]] = {name: [] for name in MEANS}
    for g in groups:
        c = g.conditions
        stated = {"tow_k": nan, "twist_per_cm": nan, "preload_cN": nan}
        if c is not None:
            stated = {"tow_k": c.tow, "twist_per_cm": c.twist, "preload_cN": c.preload}
        for s in g.specimens:
            t = s.test
            poisson = t.poisson_ratio() if s.width_varies else np.full(len(t.force), nan)
            rows.append(
                {
                    "file": s.name,
                    **stated,
                    "a": s.law.a,
                    "a_error": s.law.a_error,
                    "b": s.law.b,
                    "b_error": s.law.b_error,
                    "r_squared": s.law.r_squared,
                    "b_touch_of_noise": nan if s.noise_law is None else s.noise_law.b,
                    "initial_thickness_um": t.thickness[0],
                    "peak_pressure_MPa": t.pressure[t.turn - 1],
                    "strain_at_peak": t.strain[t.turn - 1],
                    "poisson_ratio_at_peak": poisson[t.turn - 1],
                    "hysteresis_loss": t.hysteresis().fraction if len(t.force) > t.turn else nan,
                }
            )
            unloading = np.arange(len(t.force)) >= t.turn
            modulus = np.append(t.modulus(), np.full(len(t.force) - t.turn, nan))
            fitted = np.where(t.strain > 0, s.law.modulus(np.maximum(t.strain, 1e-12)), nan)
            columns: tuple[Sequence[Any] | FloatArray, ...] = (
                [s.name] * len(t.force),
                unloading.astype(int),
                t.displacement,
                t.force * 1e-9,
                t.width,
                t.thickness,
                t.strain,
                t.pressure,
                poisson,
                modulus,
                fitted,
            )
            for name, values in zip(CURVES, columns, strict=True):
                curves[name].extend(values)
        m = g.mean
        band = m.strain - m.half_width, m.strain + m.half_width
        averages: tuple[Sequence[Any] | FloatArray, ...] = (
            [g.name] * len(m.pressure), m.pressure, m.strain, m.sd, *band
        )  # fmt: skip
        for name, values in zip(MEANS, averages, strict=True):
            mean[name].extend(values)
    store.write_columns(out / "tests.csv", {name: [row[name] for row in rows] for name in rows[0]})
    store.write_columns(out / "curves.csv", curves)
    store.write_columns(out / "mean.csv", mean)
    shown = [_shown(g, law) for g in groups]
    plot_towtest.figure_tests(shown).savefig(out / "towtest.png")
    plot_towtest.figure_laws(shown).savefig(out / "laws.png")


CURVES = (
    "file",
    "unloading",
    "displacement_um",
    "force_N",
    "width_um",
    "thickness_um",
    "strain",
    "pressure_MPa",
    "poisson_ratio",
    "modulus_MPa",
    "modulus_of_the_power_law_MPa",
)
MEANS = ("conditions", "pressure_MPa", "strain", "sd", "band_low", "band_high")


def _shown(g: Group, law: LawFit | None) -> plot_towtest.ShownTests:
    tests = tuple(s.test for s in g.specimens)
    m = g.mean
    inside = [np.flatnonzero(t.pressure[t.loading] >= t.window[0]) for t in tests]
    return plot_towtest.ShownTests(
        name=g.name,
        loading=tuple((t.pressure[t.loading], t.strain[t.loading]) for t in tests),
        unloading=tuple((t.pressure[t.turn - 1 :], t.strain[t.turn - 1 :]) for t in tests),
        poisson=tuple(
            (t.strain[t.loading], t.poisson_ratio()[t.loading])
            for t, s in zip(tests, g.specimens, strict=True)
            if s.width_varies
        ),
        modulus=tuple((t.strain[use], t.modulus()[use]) for t, use in zip(tests, inside, strict=True)),
        fitted_modulus=(m.strain, g.law.modulus(m.strain)),
        mean=(m.pressure, m.strain, m.half_width),
        zones=None if g.zones is None else (g.zones.breaks, g.zones.strains, g.zones.slopes),
        power_law=(g.law.a, g.law.b),
        law_strain=None if law is None or g.conditions is None else law.law.strain(m.pressure, g.conditions),
        volume_fraction=g.volume_fraction,
        beds=tuple((b.name, b.law.volume_fraction(m.pressure), b.rms) for b in g.beds),
    )


# --- command line ------------------------------------------------------------------------------------------------


def default_out(files: Sequence[Path]) -> Path:
    """results/towtest-<name of the first file>, where the verb writes when no folder is given."""
    return Path("results") / f"towtest-{files[0].stem}"


def options_from_text(out: Path, texts: dict[str, Any]) -> TowOptions:
    """Options from text, by the names of the command line (``anvil``, ``pre-load`` ...); None where not given."""

    def one(key: str, unit: str) -> float | None:
        return None if texts.get(key) is None else units.parse(texts[key], unit, f"--{key}")

    def several(key: str, unit: str, factor: float) -> tuple[float, ...]:
        return tuple(factor * units.parse(t, unit, f"--{key}") for t in texts.get(key) or ())

    window = None
    if texts.get("window") is not None:
        low, colon, high = str(texts["window"]).partition(":")
        if not colon:
            raise InputError("--window", texts["window"], "two pressures, such as '0.1 MPa:20 MPa'")
        window = tuple(1e-3 * units.parse(t, "kPa", "--window") for t in (low, high))
        if not 0 <= window[0] < window[1]:
            raise InputError("--window", texts["window"], "a lower pressure, then a higher one")
    columns = texts.get("columns")
    touch: float | str = texts.get("touch") or "auto"
    if touch not in ("auto", *TOUCHES):
        touch = units.parse(touch, "nN", "--touch")
    diameter = one("filament-diameter", "um")
    return TowOptions(
        out=out,
        anvil=one("anvil", "um"),
        thickness=one("thickness", "um"),
        width=one("width", "um"),
        widths=tuple(texts.get("widths") or ()),
        tow=tuple(tow_size(t, "--tow") for t in texts.get("tow") or ()),
        twist=several("twist", "turn/um", 1e4),
        preload=several("pre-load", "nN", 1e-7),
        columns=tuple(c.strip() for c in columns.split(",")) if columns else (),
        window=None if window is None else (window[0], window[1]),
        diameter=7.0 if diameter is None else diameter,
        at=several("at", "kPa", 1e-3),
        touch=touch,
        force=bool(texts.get("force")),
    )


def report_lines(result: TowResult) -> list[str]:
    """What the command line prints."""
    lines = []
    for g, s in zip(result.groups, result.summary["conditions"], strict=True):
        law = g.law
        line = f"{g.name} ({s['n_tests']} tests): eps = {law.a:.3g} p^{law.b:.3g} to {s['peak_pressure_MPa']:.3g} MPa"
        if s["modulus_MPa"]:
            strain, modulus = list(s["modulus_MPa"].items())[-1]
            line += f"; modulus {modulus:.3g} MPa at a strain of {strain}"
        if s["poisson_ratio_at_peak"]:
            line += f"; Poisson's ratio {s['poisson_ratio_at_peak']['mean']:.2g} at the peak"
        if s["hysteresis_loss"]:
            line += f"; {s['hysteresis_loss']['mean']:.0%} of the work lost"
        lines.append(line)
        if g.zones is not None and len(g.zones.breaks):
            at = ", ".join(f"{p:.3g} MPa" for p in g.zones.breaks)
            slopes = ", ".join(f"{b:.3g}" for b in g.zones.slopes)
            lines.append(f"  zones part at {at}: exponents {slopes}")
        if g.beds:
            lines.append("  volume fraction: " + ", ".join(f"{b.name} within {b.rms:.1%}" for b in g.beds))
        for t in s["thickness"]:
            measured = "not measured" if t["measured_um"] is None else f"{t['measured_um']:.4g} um"
            line = f"  thickness at {t['pressure_MPa']:.3g} MPa: {measured}"
            if t.get("predicted_um") is not None:
                line += f", by the law {t['predicted_um']:.4g} +- {t['predicted_error_um']:.2g} um"
            lines.append(line)
    if result.law is not None:
        fit, errors = result.law.law, result.law.errors
        e = dict(zip(PARAMETERS, errors, strict=True))
        lines.append(
            f"law of all: a0 = {fit.a0:.3g} +- {fit.a0 * e['ln a0']:.2g}, "
            + ", ".join(f"{k} = {getattr(fit, k):.3g} +- {e[k]:.2g}" for k in ("a1", "a2", "a3", "b"))
            + f"; strains within {result.law.rms:.1%} (worst {result.law.worst:.0%})"
        )
    lines += [f"warning: {w}" for w in result.summary["warnings"]]
    lines += [f"{name.partition('.')[0]:8s} {result.out / name}" for name in FILES]
    return lines
