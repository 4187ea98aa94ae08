"""The verb ``capstan``: pull a column over a pulley, check it in LAMMPS, say what a test of it can tell; files and
pictures."""

from __future__ import annotations

import math
import shutil
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from cgfibre import plot_friction, store
from cgfibre.capstan.column import Column, ColumnResult, pull
from cgfibre.capstan.features import COEFFICIENTS, Features, changed, features, rigid_ratio, sensitivities
from cgfibre.capstan.identify import (
    TOLERANCE,
    ColumnVerdict,
    Identifiability,
    Identification,
    column_identifiability,
    identify,
)
from cgfibre.capstan.scene import CapstanScene, load_capstan
from cgfibre.engine.capstan import Rig, run_belt
from cgfibre.engine.capstan_dynamic import DynamicRun, Pull, run_dynamic
from cgfibre.engine.lammps import find_engine
from cgfibre.errors import InputError
from cgfibre.measure.signal import TestRig
from cgfibre.measure.spectrum import LEAST, dominant_lines
from cgfibre.mechanics.belt import polygon_ratio, tension_ratio
from cgfibre.mechanics.rod import circle_area
from cgfibre.mechanics.stick_slip import Slider
from cgfibre.plot_friction import CapstanView, WrapView
from cgfibre.readers import read_record
from cgfibre.scene_values import NOT_GIVEN
from cgfibre.signals import DISPLACEMENT, FORCE, TIME

FloatArray = npt.NDArray[np.float64]

FILES = ("scene.toml", "summary.json", "capstan.csv", "wrap.csv", "capstan.h5")
PICTURES = ("signal.png", "filaments.png", "wrap.png", "sensitivity.png", "fit.png")
#: error of the belt law in LAMMPS beyond that of its polygon that is distrusted
BELT_ERROR = 1e-3
#: of a test whose coefficients are asked for: relative noise, samples a us (20 Hz is what the thesis' rig had at most)
NOISE, RATE = 0.02, 1e-3


@dataclass(frozen=True)
class CapstanOptions:
    """Folder and what to do beside the pull: ``belt`` the belt law in LAMMPS, ``dynamic`` the stick-slip law in LAMMPS,
    ``identifiability`` what a test can tell, ``signal`` a test's file to fit the coefficients to (``input_tension`` N,
    ``wrap`` rad, ``columns`` and ``units`` as in :class:`cgfibre.signals.SignalOptions`; ``free`` what to fit beside).
    """

    out: Path
    force: bool = False
    belt: bool = True
    dynamic: bool = False
    identifiability: bool = True
    signal: Path | None = None
    input_tension: float | None = None
    wrap: float | None = None
    columns: tuple[str, ...] = ()
    units: tuple[str, ...] = ()
    free: tuple[str, ...] = ()
    engine: str | None = None


@dataclass(frozen=True)
class BeltCheck:
    """Sum of T2 over the load in LAMMPS with Coulomb friction mu_s0: against exp(mu theta) and the polygon's ratio."""

    ratio: float
    error: float
    polygon_error: float
    spread: tuple[float, float]
    wall_s: float


@dataclass(frozen=True)
class DynamicCheck:
    """The stick-slip law in LAMMPS beside the quasi-static model: relative difference of the first peak, root mean
    square difference of T2/T1 over the pull, mass scaling, steps, seconds."""

    run: DynamicRun
    peak_error: float
    rms: float
    mass_scaling: float


@dataclass(frozen=True)
class Fit:
    """A measured signal (``time`` s, ``tension`` N, its rig) and what was found from it."""

    time: FloatArray
    tension: FloatArray
    rig: TestRig
    found: Identification


@dataclass(frozen=True)
class CapstanResult:
    """All that the verb found."""

    out: Path
    scene: CapstanScene
    column: Column
    pulled: ColumnResult
    seen: Features
    law: Features
    wall_s: float
    cpu_s: float
    belt: BeltCheck | None
    dynamic: DynamicCheck | None
    verdict: ColumnVerdict | None
    fit: Fit | None
    summary: Mapping[str, Any]


Note = Callable[[str], None]


def run_capstan(
    source: str | Path, options: CapstanOptions, overrides: Sequence[str] = (), note: Note | None = None
) -> CapstanResult:
    """Pull the column of a scene, check and store it. InputError before anything is written, EngineError where the
    engine or the model fails."""
    scene = load_capstan(source, overrides)
    say = note or (lambda text: None)
    measured = _read_signal(options.signal, options, scene) if options.signal is not None else None
    _claim(options.out, options.force)
    (options.out / "scene.toml").write_text(scene.to_toml())
    c, column = scene.capstan, scene.column()
    say(f"pulling {column.filaments} filament(s), {c.nodes} nodes, {c.duration * 1e-6:g} s")
    begin, cpu = time.perf_counter(), time.process_time()
    peak_at = column.pulley.critical_slip / column.speed
    pulled = pull(column, c.duration, c.step, [peak_at])
    wall, cpu = time.perf_counter() - begin, time.process_time() - cpu
    belt = dynamic = verdict = fit = None
    if options.belt:
        say("belt law in LAMMPS")
        belt = _belt(scene, options)
    if options.dynamic:
        say(f"stick-slip in LAMMPS, masses x {c.dynamic.mass_scaling:g}")
        dynamic = _dynamic(scene, options)
    if options.identifiability:
        say("what a test can tell")
        verdict = column_identifiability(column, c.step, c.duration, NOISE, RATE)
    if measured is not None:
        say("fitting the signal")
        t, f, rig = measured
        fit = Fit(t, f, rig, identify(t * 1e6, f, rig, column.pulley, options.free))
    seen = _seen(column, pulled)
    law = features(column.pulley, column.wrap)
    result = CapstanResult(options.out, scene, column, pulled, seen, law, wall, cpu, belt, dynamic, verdict, fit, {})
    result = replace(result, summary=_summary(result))
    _write(result)
    return result


def _claim(out: Path, force: bool) -> None:
    store.check_folder(out, FILES, force)
    for name in (*FILES, *PICTURES):
        (out / name).unlink(missing_ok=True)
    for name in ("belt", "dynamic"):
        shutil.rmtree(out / name, ignore_errors=True)
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("--out", str(out), f"a folder that can be written ({error.strerror})") from error


def _read_signal(path: Path, options: CapstanOptions, scene: CapstanScene) -> tuple[FloatArray, FloatArray, TestRig]:
    if options.input_tension is None:
        raise InputError("--input-tension", NOT_GIVEN, "the tension of the signal's slack side, such as '0.52 N'")
    rig = TestRig(options.input_tension, options.wrap if options.wrap is not None else scene.capstan.wrap)
    record = read_record(path, (TIME, DISPLACEMENT, FORCE), options.columns, options.units, rising="time", limit=2**14)
    if len(record) < LEAST:
        raise InputError(str(path), f"{len(record)} sample(s)", f"at least {LEAST} samples")
    return record.columns["time"], record.columns["force"], rig


def _rig(scene: CapstanScene) -> Rig:
    f, c = scene.filament, scene.capstan
    single = c.model == "bundle"
    mass = f.density * float(circle_area(f.diameter))
    n = c.filaments
    return Rig(
        1 if single else n,
        f.diameter,
        f.EA * (n if single else 1),
        mass * (n if single else 1),
        c.nodes,
        c.pulley_radius,
        c.wrap,
        c.tension,
    )


def _belt(scene: CapstanScene, options: CapstanOptions) -> BeltCheck:
    c = scene.capstan
    mu = c.pulley.mu_s0
    run = run_belt(find_engine(options.engine), options.out / "belt", _rig(scene), mu, c.between.mu_s0)
    each = run.tension[:, 0] / run.tension[:, -1]
    return BeltCheck(
        run.ratio,
        run.ratio / float(tension_ratio(mu, c.wrap)) - 1,
        float(polygon_ratio(mu, c.wrap, c.nodes) / tension_ratio(mu, c.wrap)) - 1,
        (float(each.min()), float(each.max())),
        run.spent.wall,
    )


def _dynamic(scene: CapstanScene, options: CapstanOptions) -> DynamicCheck:
    c, column, rig = scene.capstan, scene.column(), _rig(scene)
    job = Pull(c.speed, c.dynamic.duration, c.dynamic.mass_scaling, column.pulley, column.between)
    run = run_dynamic(options.out / "dynamic", rig, job)
    # the strand from the last node to the held end is one spacing long there
    short = replace(column, free_length=float(rig.spacings.mean()))
    quasi = pull(short, c.dynamic.duration, min(c.step, c.dynamic.duration / 100))
    total = run.force.sum(axis=1) / c.tension
    expected = np.interp(run.time, quasi.time, quasi.total / c.tension)
    return DynamicCheck(
        run,
        float(total.max() / expected.max()) - 1,
        float(np.sqrt(np.mean((total - expected) ** 2))),
        c.dynamic.mass_scaling,
    )


def _seen(column: Column, pulled: ColumnResult) -> Features:
    """The same features as :func:`cgfibre.capstan.features.features`, off the pulled signal; nan: it is too short."""
    ratio = pulled.total / column.load
    first = column.pulley.critical_slip / column.speed
    after = first + 2 * column.pulley.drop_slip / column.speed
    early, late = pulled.time <= after, pulled.time > after
    peak = int(np.argmax(ratio[early]))
    high = low = frequency = math.nan
    if np.any(late):
        high, low = float(ratio[late].max()), float(ratio[late].min())
    if np.sum(late) >= LEAST:
        t, y = pulled.time[late], ratio[late]
        span = float(t[-1] - t[0])
        lines = dominant_lines(t, y - y.mean(), (1.5 / span, 0.5 / float(t[1] - t[0])), most=1)
        frequency = lines[0].frequency if lines and span > 3 / lines[0].frequency else math.nan
    amplitude = 2 * (high - low) / (high + low)
    friction = (high - low) / (low - 1) if low > 1 else math.nan
    return Features(float(pulled.time[peak]), float(ratio[peak]), high, low, amplitude, friction, frequency)


def _slider(scene: CapstanScene) -> Slider | None:
    """The column as a mass on the spring of its free length, with the Coulomb friction of a whole wrap (Fig 4-2)."""
    column = scene.column()
    law = column.pulley
    force = [column.load * (float(tension_ratio(mu, column.wrap)) - 1) for mu in (law.mu_s, law.mu_k)]
    if force[1] >= force[0]:
        return None
    n, f = scene.capstan.filaments, scene.filament
    mass = n * f.density * float(circle_area(f.diameter)) * column.radius * column.wrap
    return Slider(mass, n * f.EA / column.free_length, column.speed, force[0], force[1])


# --- what is left behind ---------------------------------------------------------------------------------------------


def _per_second(values: Features) -> dict[str, float]:
    return {
        "stick_time_s": values.stick_time * 1e-6,
        "peak": values.peak,
        "high": values.high,
        "low": values.low,
        "amplitude": values.amplitude,
        "friction_amplitude": values.friction_amplitude,
        "frequency_Hz": values.frequency * 1e6,
    }


def _summary(r: CapstanResult) -> dict[str, Any]:
    table = [
        {"coefficient": name, "fixed": fixed, **values}
        for (name, fixed), values in sensitivities(r.column.pulley, r.column.wrap).items()
    ]
    warnings = []
    if r.belt is not None and abs(r.belt.error - r.belt.polygon_error) > BELT_ERROR:
        warnings.append(f"LAMMPS misses the belt law of its polygon by {r.belt.error - r.belt.polygon_error:.2%}")
    if r.belt is not None and abs(r.belt.error) > BELT_ERROR:
        warnings.append(f"the belt law is off by {r.belt.error:.2%}: more nodes")
    summary: dict[str, Any] = {
        "scene": r.scene.name,
        "model": r.scene.capstan.model,
        "filaments": r.column.filaments,
        "nodes": r.column.nodes,
        "wall_s": r.wall_s,
        "cpu_s": r.cpu_s,
        "iterations_a_step": r.pulled.iterations,
        "seen": _per_second(r.seen),
        "law": _per_second(r.law),
        "strain": r.scene.strain,
        "end_ratio_of_filament": (r.pulled.force[-1] * r.column.filaments / r.column.load).tolist(),
        "sensitivity_of_0.01": table,
        "belt": asdict(r.belt) if r.belt else None,
        "dynamic": None,
        "identifiability": None,
        "identified": None,
        "trusted": not warnings,
        "warnings": warnings,
    }
    if r.dynamic is not None:
        summary["dynamic"] = {
            "peak_error": r.dynamic.peak_error,
            "rms": r.dynamic.rms,
            "mass_scaling": r.dynamic.mass_scaling,
            "steps": r.dynamic.run.steps,
            "timestep_us": r.dynamic.run.timestep,
            "wall_s": r.dynamic.run.wall,
        }
    if r.verdict is not None:
        v = r.verdict
        summary["identifiability"] = {
            "noise": v.noise,
            "samples": v.samples,
            "total_force": _verdict(v.total),
            "each_filament": _verdict(v.each),
        }
    if r.fit is not None:
        i = r.fit.found
        summary["identified"] = {
            "estimates": [{**asdict(e), "interval": e.interval} for e in i.estimates],
            "noise": i.noise,
            "samples": i.n,
            "singular_values": i.verdict.singular_values,
            "weakest": i.verdict.weakest_text,
            "between": "not identifiable: the total force does not depend on it",
        }
    return summary


def _verdict(v: Identifiability) -> dict[str, Any]:
    errors = dict(zip(v.names, v.errors.tolist(), strict=True))
    return {"errors": errors, "singular_values": v.singular_values, "weakest": v.weakest_text}


def _write(r: CapstanResult) -> None:
    out, c = r.out, r.column
    seconds = r.pulled.time * 1e-6
    rigid = rigid_ratio(c.pulley, c.wrap, r.pulled.time)
    columns: dict[str, tuple[Any, str]] = {
        "time_s": (seconds, "s"),
        "displacement_um": (r.pulled.time * c.speed, "um"),
        "force_N": (r.pulled.total * 1e-9, "N"),
        "ratio": (r.pulled.total / c.load, "1"),
        "rigid_belt_ratio": (rigid, "1"),
        **{f"force_{j + 1}_N": (r.pulled.force[:, j] * 1e-9, "N") for j in range(c.filaments)},
    }
    rows = zip(*(v.tolist() for v, _ in columns.values()), strict=True)
    store.write_rows(out / "capstan.csv", list(columns), rows)
    angle = np.asarray(np.arange(c.nodes + 1) * c.turn)
    logs = np.log(r.pulled.tension / r.pulled.tension[:, :, :1])
    wrap: dict[str, tuple[Any, str]] = {"angle_rad": (angle, "rad")}
    for k, t in enumerate(r.pulled.kept.tolist()):
        for j in range(c.filaments):
            wrap[f"log_ratio_{j + 1}_at_{t * 1e-6:.4g}_s"] = (logs[k, j], "1")
    store.write_rows(out / "wrap.csv", list(wrap), zip(*(v.tolist() for v, _ in wrap.values()), strict=True))
    tables = [store.Table("pull", {"scene": r.scene.name}, columns), store.Table("wrap", {}, wrap)]
    if r.dynamic is not None:
        run = r.dynamic.run
        tables.append(
            store.Table(
                "dynamic",
                {"mass_scaling": f"{r.dynamic.mass_scaling:g}"},
                {"time_s": (run.time * 1e-6, "s"), "force_N": (run.force.sum(axis=1) * 1e-9, "N")},
            )
        )
    store.write_tables(out / "capstan.h5", tables)
    store.write_json(out / "summary.json", r.summary)
    _draw(r, seconds, rigid, WrapView(angle, logs[-1], c.pulley.mu_s, c.pulley.mu_k, float(r.pulled.kept[-1]) * 1e-6))


def _draw(r: CapstanResult, seconds: FloatArray, rigid: FloatArray, wrap: WrapView) -> None:
    out, c = r.out, r.column
    others = {}
    if r.dynamic is not None:
        run = r.dynamic.run
        name = f"LAMMPS, masses x {r.dynamic.mass_scaling:g}"
        others[name] = (run.time * 1e-6, run.force.sum(axis=1) / c.load)
    levels = {name: float(tension_ratio(getattr(c.pulley, name), c.wrap)) for name in COEFFICIENTS}
    view = CapstanView(seconds, r.pulled.total / c.load, rigid, levels, others, r.scene.name)
    plot_friction.figure_capstan(view).savefig(out / "signal.png")
    share = r.pulled.force * c.filaments / c.load
    plot_friction.figure_filaments(seconds, share).savefig(out / "filaments.png")
    plot_friction.figure_wrap(wrap).savefig(out / "wrap.png")
    studies = {}
    for name in COEFFICIENTS:
        traces = []
        for change in (-0.01, 0.0, 0.01):
            try:
                law = changed(c.pulley, name, change)
            except InputError:  # the coefficients would not fall
                continue
            traces.append((getattr(law, name), rigid_ratio(law, c.wrap, r.pulled.time)))
        studies[name] = traces
    plot_friction.figure_sensitivity(seconds, studies).savefig(out / "sensitivity.png")
    if r.fit is not None:
        fit = r.fit
        model = rigid_ratio(fit.found.law, fit.rig.wrap, fit.time * 1e6 - fit.found.start)
        plot_friction.figure_fit(fit.time, fit.tension / fit.rig.input_tension, model).savefig(out / "fit.png")


def default_out(source: str | Path) -> Path:
    """results/<name of the scene>."""
    return Path("results") / Path(str(source)).stem


def report_lines(r: CapstanResult) -> list[str]:
    """What the command line prints."""
    c, s = r.column, r.seen
    lines = [
        f"{r.scene.name or 'capstan'}: {c.filaments} filament(s), {c.nodes} nodes on {c.wrap:.4g} rad, "
        f"{r.scene.capstan.duration * 1e-6:g} s of test in {r.wall_s:.2g} s",
        f"  first peak T2/T1 {s.peak:.4f} at {s.stick_time * 1e-6:.4f} s (exp(mu_s0 theta) {r.law.peak:.4f})",
    ]
    if math.isfinite(s.high):
        lines.append(
            f"  stick-slip {s.low:.4f} to {s.high:.4f} (exp(mu_k theta) {r.law.low:.4f}, exp(mu_s theta) "
            f"{r.law.high:.4f}), amplitude {s.amplitude:.1%}"
        )
    if math.isfinite(s.frequency):
        lines.append(f"  frequency {s.frequency * 1e6:.3f} Hz (of the law itself {r.law.frequency * 1e6:.3f} Hz)")
    if c.filaments > 1:
        share = r.pulled.force[-1] * c.filaments / c.load
        lines.append("  T2/T1 of each filament at the end, from the pulley out: " + " ".join(f"{x:.3f}" for x in share))
    slider = _slider(r.scene)
    if slider is not None:
        lines.append(
            f"  a mass on the free length's spring would stick and slip at {1e3 / slider.period:.3g} kHz: "
            "the frequency is the law's, not a resonance"
        )
    if r.belt is not None:
        lines.append(
            f"belt law in LAMMPS, Coulomb {c.pulley.mu_s0:g}: T2/T1 {r.belt.ratio:.5f}, error {r.belt.error:+.4%} "
            f"(the polygon's own {r.belt.polygon_error:+.4%}), {r.belt.wall_s:.2g} s"
        )
    if r.dynamic is not None:
        d = r.dynamic
        lines.append(
            f"stick-slip in LAMMPS (fix external), masses x {d.mass_scaling:g}: first peak {d.peak_error:+.2%}, rms "
            f"{d.rms:.4f} of T2/T1, {d.run.steps} steps in {d.run.wall:.3g} s"
        )
    lines += _sensitivity_lines(r)
    if r.verdict is not None:
        lines += _verdict_lines(r.verdict)
    if r.fit is not None:
        lines += _identified_lines(r.fit.found)
    lines += [f"WARNING  {w}" for w in r.summary["warnings"]]
    lines += [f"picture  {r.out / name}" for name in PICTURES if (r.out / name).exists()]
    lines.append(f"tables   {r.out / 'capstan.csv'}, {r.out / 'wrap.csv'}, {r.out / 'capstan.h5'}")
    return lines


def _sensitivity_lines(r: CapstanResult) -> list[str]:
    lines = ["+0.01 in        first sticking   first peak   amplitude of T2   of T2 - T1   frequency"]
    for row in r.summary["sensitivity_of_0.01"]:
        name = row["coefficient"] + (", stiffness" if row["fixed"] == "stiffness" else "")
        lines.append(
            f"  {name:16s}{row['stick_time']:+9.1%}{row['peak']:+14.1%}{row['amplitude']:+16.0%}"
            f"{row['friction_amplitude']:+14.0%}{row['frequency']:+12.0%}"
        )
    return lines


def _verdict_lines(v: ColumnVerdict) -> list[str]:
    lines = [f"what a test can tell ({v.samples} samples, {v.noise:.0%} noise): 95 % interval of a coefficient"]
    for name, total, each in zip(v.total.names, v.total.errors, v.each.errors, strict=True):
        lines.append(f"  {name:14s} from the total force {_width(total)}, from each filament's force {_width(each)}")
    return lines


def _width(error: float) -> str:
    half = 1.96 * error
    if not half <= TOLERANCE:
        return f"not identifiable ({'+- ' + format(half, '.2g') if half < 10 else 'nothing known'})"
    return f"+- {half:.4f}"


def _identified_lines(i: Identification) -> list[str]:
    lines = [f"fitted to {i.n} samples, scatter {i.noise:.4f} of ln(T2/T1)/theta:"]
    for e in i.estimates:
        value = e.value * (1e-6 if e.name == "start" else 1e6 if e.name == "frequency" else 1)
        width = e.interval * (1e-6 if e.name == "start" else 1e6 if e.name == "frequency" else 1)
        unit = {"start": " s", "frequency": " Hz", "critical_slip": " um", "drop_slip": " um"}.get(e.name, "")
        verdict = f"+- {width:.4g}{unit} (95 %)"
        if not e.identifiable:
            verdict += ": not identifiable from this signal"
        lines.append(f"  {e.name:14s} {value:.4f}{unit} {verdict}")
    lines.append(f"  known worst: {i.verdict.weakest_text}")
    lines.append("  between the filaments: not identifiable, the total force does not depend on it")
    return lines
