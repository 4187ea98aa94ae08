"""Test signals of friction: files in, coefficients, spectra, tables and pictures out (the verb ``signal``)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cgfibre import plot_friction, store
from cgfibre.errors import InputError
from cgfibre.measure.signal import (
    Branch,
    Mean,
    TestRig,
    TrialFriction,
    WrapRegression,
    mean_interval,
    travel_branches,
    trial_friction,
    wrap_regression,
)
from cgfibre.measure.spectrum import LEAST, Spectra, all_spectra, peak_frequency
from cgfibre.mechanics.belt import loop_friction
from cgfibre.plot_friction import SignalView
from cgfibre.readers import Wanted, read_record
from cgfibre.tow_friction import TowFriction, tow_friction
from cgfibre.units import describe, parse

FloatArray = npt.NDArray[np.float64]

TIME = Wanted("time", "s", ("time", "zeit", "temps", "elapsed"), ("t",))
DISPLACEMENT = Wanted(
    "displacement",
    "mm",
    ("displacement", "extension", "crosshead", "cross-head", "position", "stroke", "travel", "displ", "weg"),
    ("x", "d", "s"),
    required=False,
)
FORCE = Wanted("force", "N", ("force", "load", "tension", "kraft", "last"), ("f", "t2"))
COEFFICIENTS = ("mu", "mu_s0", "mu_s", "mu_k", "amplitude", "frequency")


@dataclass(frozen=True)
class SignalOptions:
    """How to read and analyse signals; one ``input_tension`` (N) and ``wrap`` (rad) for all files, or one a file.

    ``window`` (s) the steady part, else found; ``columns`` of time, displacement and force (names or numbers) and their
    ``units``; ``speed`` (mm/s) makes times of displacements where the file has none; ``band`` (Hz) in which lines are
    looked for; ``angle`` (rad) and ``filaments``: the tows' angle and size, to compare with Table 3-1.
    """

    input_tension: tuple[float, ...]
    wrap: tuple[float, ...]
    window: tuple[float, float] | None = None
    columns: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    speed: float | None = None
    band: tuple[float, float] | None = None
    angle: float | None = None
    filaments: float = 12000
    out: Path | None = None
    force: bool = False


def options_from_text(
    texts: Mapping[str, str | Sequence[str] | None], columns: tuple[str, ...], units: tuple[str, ...], filaments: float
) -> SignalOptions:
    """Options of the command line: quantities as text with units, spans as "FROM:TO"; InputError names the option."""

    def quantity(key: str, unit: str) -> float | None:
        text = texts.get(key)
        return None if text is None else parse(text, unit, key)

    def span(key: str, unit: str) -> tuple[float, float] | None:
        text = texts.get(key)
        if text is None:
            return None
        ends = str(text).split(":")
        if len(ends) != 2:
            raise InputError(key, text, f"FROM:TO, each {describe(unit)}")
        lo, hi = (parse(end.strip(), unit, key) for end in ends)
        if not lo < hi:
            raise InputError(key, text, "FROM below TO")
        return lo, hi

    window = span("--window", "us")
    band = span("--band", "MHz")
    speed = quantity("--speed", "um/us")
    if speed is not None and not speed > 0:
        raise InputError("--speed", texts["--speed"], "a speed above 0")
    return SignalOptions(
        tuple(_above_zero("--input-tension", text, "nN") * 1e-9 for text in texts["--input-tension"] or ()),
        tuple(_above_zero("--wrap", text, "rad") for text in texts["--wrap"] or ()),
        (window[0] * 1e-6, window[1] * 1e-6) if window else None,
        columns,
        units,
        speed * 1e3 if speed is not None else None,  # um/us is m/s
        (band[0] * 1e6, band[1] * 1e6) if band else None,
        quantity("--angle", "rad"),
        filaments,
    )


def _above_zero(key: str, text: str, unit: str) -> float:
    value = parse(text, unit, key)
    if not value > 0:
        raise InputError(key, text, f"{describe(unit)}, above 0")
    return value


def default_out(files: Sequence[Path]) -> Path:
    """results/signal-NAME, after the first file."""
    return Path("results") / f"signal-{files[0].stem}"


@dataclass(frozen=True)
class Trial:
    """One pull of one file: what was read (``time`` s, ``tension`` N of the pull), its friction and spectra."""

    name: str
    rig: TestRig
    time: FloatArray
    tension: FloatArray
    friction: TrialFriction
    spectra: Spectra
    peaks: Mapping[str, float]
    notes: tuple[str, ...]


@dataclass(frozen=True)
class SignalResult:
    """All pulls; means over those of one wrap and direction; the belt law where wraps differ."""

    out: Path | None
    trials: tuple[Trial, ...]
    means: Mapping[tuple[float, int], Mapping[str, Mean]]
    regression: Mapping[int, WrapRegression]
    loops: tuple[float, ...]
    table: TowFriction | None
    notes: tuple[str, ...]


def analyse_signals(files: Sequence[Path], options: SignalOptions) -> SignalResult:
    """Friction and spectra of test signals; writes tables and pictures where ``options.out`` says.

    A file whose displacement turns holds a pull up and one down, each a trial of its direction. Raises InputError, and
    writes nothing, for whatever is wrong with a file or an option.
    """
    if not files:
        raise InputError("FILE", "(none)", "one signal or more")
    tensions = _one_each("--input-tension", options.input_tension, len(files))
    wraps = _one_each("--wrap", options.wrap, len(files))
    if options.out is not None:
        store.check_folder(options.out, ("summary.json",), options.force)
    table = tow_friction(options.angle, options.filaments) if options.angle is not None else None
    trials: list[Trial] = []
    loops: list[float] = []
    for path, tension, wrap in zip(files, tensions, wraps, strict=True):
        made = _read_trials(path, TestRig(tension, wrap), options, len(files) > 1)
        trials += made
        loops += _loop(made)
    groups: dict[tuple[float, int], list[Trial]] = {}
    for t in trials:
        groups.setdefault((t.rig.wrap, t.friction.direction), []).append(t)
    means = {
        key: {name: mean_interval([float(getattr(t.friction, name)) for t in group]) for name in COEFFICIENTS}
        for key, group in sorted(groups.items())
    }
    regression = {}
    for direction in sorted({d for _, d in groups}, reverse=True):
        points = [(t.rig.wrap, t.friction.mu * t.rig.wrap) for t in trials if t.friction.direction == direction]
        if len({w for w, _ in points}) > 1:
            regression[direction] = wrap_regression(*np.array(points).T)
    notes = tuple(dict.fromkeys(f"{t.name}: {note}" for t in trials for note in t.notes))
    result = SignalResult(options.out, tuple(trials), means, regression, tuple(loops), table, notes)
    if options.out is not None:
        _write(options.out, result)
    return result


def _one_each(key: str, values: tuple[float, ...], n: int) -> tuple[float, ...]:
    if len(values) == 1:
        return values * n
    if len(values) != n:
        raise InputError(key, len(values), f"given once, or once for each of the {n} files")
    return values


def _read_trials(path: Path, rig: TestRig, options: SignalOptions, several: bool) -> list[Trial]:
    if options.speed is not None:
        wanted = (replace(DISPLACEMENT, required=True), FORCE)
        record = read_record(path, wanted, options.columns, options.units)
        # the crosshead may run either way, and back
        travelled = np.concatenate([[0.0], np.cumsum(np.abs(np.diff(record.columns["displacement"])))])
        time = travelled / options.speed
    else:
        record = read_record(path, (TIME, DISPLACEMENT, FORCE), options.columns, options.units, rising="time")
        time = record.columns["time"]
    force = record.columns["force"]
    if len(time) < LEAST:
        raise InputError(str(path), f"{len(time)} sample(s)", f"at least {LEAST} samples")
    displacement = record.columns.get("displacement")
    branches = [Branch(0, len(time), 0)]
    if displacement is not None and np.ptp(displacement) > 0:
        branches = travel_branches(displacement)
    trials = []
    for k, b in enumerate(branches):
        name = path.stem if len(branches) == 1 else f"{path.stem}-{'up' if b.direction > 0 else 'down'}{k + 1}"
        window = options.window if len(branches) == 1 else None
        try:
            pull = slice(b.start, b.stop)
            trials.append(_trial(name, rig, time[pull], force[pull], window, options, record.notes))
        except InputError as error:
            where = f" ({path})" if several else ""
            raise InputError(error.key, error.value, error.expected + where) from None
    if options.window is not None and len(branches) > 1:
        raise InputError("--window", str(path), "no window for a record that turns: each pull has its own")
    return trials


def _trial(
    name: str,
    rig: TestRig,
    time: FloatArray,
    force: FloatArray,
    window: tuple[float, float] | None,
    options: SignalOptions,
    notes: tuple[str, ...],
) -> Trial:
    friction = trial_friction(time, force, rig, window, options.band)
    lo, hi = friction.window
    inside = (time >= lo) & (time <= hi)
    more = []
    ratio = friction.mean_force / rig.input_tension
    if not 0.02 < ratio < 50:
        more.append(f"T/T1 is {ratio:.3g}: check the units of the force and of --input-tension")
    if abs(friction.drift) > 0.05:
        more.append(f"the force drifts by {friction.drift:.0%} over the window")
    found = all_spectra(time[inside], force[inside])
    return Trial(name, rig, time, force, friction, found, _peaks(found, friction), (*notes, *more))


def _peaks(s: Spectra, friction: TrialFriction) -> dict[str, float]:
    """Each estimator's own peak about the line that was found; without one, anywhere above five cycles."""
    lo, hi = friction.window
    band = (5 / (hi - lo), float(s.frequency[-1]))
    if friction.lines:
        f = friction.frequency
        band = (max(band[0], 0.5 * f), min(band[1], 1.5 * f))
    estimates = {"lomb_scargle": s.lomb_scargle, "dft": s.dft, "expansion": s.expansion}
    return {name: peak_frequency(s.frequency, values, band) for name, values in estimates.items()}


def _loop(trials: Sequence[Trial]) -> list[float]:
    """ln(T_up/T_down)/(2 theta) of neighbouring pulls up and down of one record: the dead load drops out."""
    found = []
    for a, b in pairwise(trials):
        if a.friction.direction != b.friction.direction:
            up, down = sorted((a.friction.mean_force, b.friction.mean_force), reverse=True)
            found.append(float(loop_friction(up, down, a.rig.wrap)))
    return found


# --- what is left behind ---------------------------------------------------------------------------------------------


def summary_of(result: SignalResult) -> dict[str, Any]:
    """summary.json: every pull, means with their intervals, belt law, lines, notes."""
    trials = []
    for t in result.trials:
        values = asdict(t.friction)
        values["lines"] = [
            {
                "frequency_Hz": line.frequency,
                "error_Hz": line.error,
                "amplitude": line.amplitude,
                "false_alarm_probability": line.probability,
                "harmonic_of": line.harmonic_of,
            }
            for line in t.friction.lines
        ]
        values["window_s"] = values.pop("window")
        values["mean_force_N"] = values.pop("mean_force")
        trials.append(
            {
                "name": t.name,
                "input_tension_N": t.rig.input_tension,
                "wrap_rad": t.rig.wrap,
                "frequency_Hz": t.friction.frequency,
                **values,
                "peaks_Hz": dict(t.peaks),
            }
        )
    means = [
        {"wrap_rad": wrap, "direction": direction, **{k: asdict(m) for k, m in group.items()}}
        for (wrap, direction), group in result.means.items()
    ]
    return {
        "trials": trials,
        "means": means,
        "belt_law": [{"direction": d, **asdict(r)} for d, r in result.regression.items()],
        "loop_mu": list(result.loops),
        "table_3_1": asdict(result.table) if result.table else None,
        "warnings": list(result.notes),
    }


def _write(out: Path, result: SignalResult) -> None:
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("--out", str(out), f"a folder that can be written ({error.strerror})") from error
    names = _unlike([t.name for t in result.trials])
    tables = []
    for name, t in zip(names, result.trials, strict=True):
        s = t.spectra
        columns = {
            "frequency_Hz": (s.frequency, "Hz"),
            "lomb_scargle_power": (s.lomb_scargle, "1"),
            "nonuniform_dft_N": (s.dft, "N"),
            "fourier_expansion_N": (s.expansion, "N"),
        }
        rows = zip(*(v.tolist() for v, _ in columns.values()), strict=True)
        store.write_rows(out / f"spectrum-{name}.csv", list(columns), rows)
        tables.append(store.Table(f"spectrum-{name}", {}, columns))
        tables.append(store.Table(f"signal-{name}", {}, {"time_s": (t.time, "s"), "force_N": (t.tension, "N")}))
        view = SignalView(t.time, t.tension, t.rig, t.friction, name)
        plot_friction.figure_signal(view).savefig(out / f"signal-{name}.png")
        plot_friction.figure_spectra(s, t.friction.lines, name).savefig(out / f"spectrum-{name}.png")
    store.write_tables(out / "signal.h5", tables)
    header = ["trial", "wrap_rad", "input_tension_N", "direction", *COEFFICIENTS]
    found = []
    for name, t in zip(names, result.trials, strict=True):
        coefficients = [float(getattr(t.friction, c)) for c in COEFFICIENTS]
        found.append([name, t.rig.wrap, t.rig.input_tension, t.friction.direction, *coefficients])
    store.write_rows(out / "trials.csv", header, found)
    if result.regression:
        points = np.array([(t.rig.wrap, t.friction.mu * t.rig.wrap, t.friction.direction) for t in result.trials])
        plot_friction.figure_belt_law(points, result.regression).savefig(out / "belt-law.png")
    if len(result.trials) > 1:
        plot_friction.figure_trials([t.friction for t in result.trials], names, result.means).savefig(
            out / "trials.png"
        )
    store.write_json(out / "summary.json", summary_of(result))


def _unlike(names: Sequence[str]) -> list[str]:
    """Names that differ: files of one name in several folders get a number."""
    made: list[str] = []
    for name in names:
        k, tried = 1, name
        while tried in made:
            k += 1
            tried = f"{name}-{k}"
        made.append(tried)
    return made


def report_lines(result: SignalResult) -> list[str]:
    """What the command line prints."""
    lines = []
    for t in result.trials:
        lines += _trial_lines(t)
    for (wrap, direction), group in result.means.items():
        n = group["mu"].n
        if n > 1:
            way = "up" if direction > 0 else "down"
            lines.append(f"mean of {n} pulls {way}, wrap {wrap:.4g} rad (95 %, 1.96 s/sqrt n):")
            lines += [f"  {name:9s} {_interval(group[name])}" for name in COEFFICIENTS]
    for direction, r in result.regression.items():
        lines.append(
            f"belt law, {r.n} pulls {'up' if direction > 0 else 'down'}: ln(T2/T1) = mu theta with mu = {r.mu:.4f} +- "
            f"{r.interval:.4f} (95 %), R2 {r.r_squared:.4f}; with a constant: slope {r.slope:.4f}, constant "
            f"{r.intercept:.4f} +- {r.intercept_interval:.4f}"
            + ("" if r.belt_law_holds else ": not zero, so the wrap or T1 is off, or friction depends on tension")
        )
    for mu in result.loops:
        lines.append(f"up and down together: mu = ln(T_up/T_down)/(2 theta) = {mu:.4f}, whatever T1 is")
    if result.table is not None:
        lines.append(f"thesis, Table 3-1: {result.table.mu:.3f} +- {result.table.interval:.3f} between such tows")
    lines += [f"note: {note}" for note in result.notes]
    if result.out is not None:
        lines.append(f"pictures {result.out / 'signal-*.png'}, {result.out / 'spectrum-*.png'}")
        lines.append(f"tables   {result.out / 'trials.csv'}, {result.out / 'summary.json'}, {result.out / 'signal.h5'}")
    return lines


def _trial_lines(t: Trial) -> list[str]:
    f = t.friction
    way = "pulled up" if f.direction > 0 else "let down"
    first = f"{f.mu_s0:.4f}" if math.isfinite(f.mu_s0) else "not seen (no peak above the stick-slip before the window)"
    how = "the waveform that repeats" if f.coherent else "mean turning points, which noise widens"
    lines = [
        f"{t.name}: T1 {t.rig.input_tension:.4g} N, wrap {t.rig.wrap:.4g} rad, {way}, window {f.window[0]:.4g} to "
        f"{f.window[1]:.4g} s ({f.samples} samples), mean T {f.mean_force:.4g} N",
        f"  mu        {f.mu:.4f}, mean of ln(T/T1)/theta in the window (s.d. {f.deviation:.4f})",
        f"  mu_s0     {first}",
        f"  mu_s      {f.mu_s:.4f}, mu_k {f.mu_k:.4f}; relative amplitude {f.amplitude:.1%} ({how})",
    ]
    for line in f.lines:
        of = ""
        if line.harmonic_of is not None:
            of = f", {line.harmonic_of[1]} x {f.lines[line.harmonic_of[0]].frequency:.4f} Hz"
        lines.append(
            f"  line      {line.frequency:.4f} +- {line.error:.4f} Hz, amplitude {line.amplitude:.4f} in mu{of} "
            f"(by chance: {line.probability:.1g})"
        )
    if not f.lines:
        lines.append("  line      none stands out of the noise")
    return lines


def _interval(m: Mean) -> str:
    """ "0.2301 +- 0.0023", or the value alone where one trial has no interval."""
    if not math.isfinite(m.mean):
        return "not seen"
    text = f"{m.mean:.4f} +- {m.interval:.4f}" if math.isfinite(m.interval) else f"{m.mean:.4f}"
    return text
