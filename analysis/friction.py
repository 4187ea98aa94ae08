"""docs/friction.md and docs/figures/friction-*.png: signals, spectra, stick-slip law, capstan model, from real runs.

python analysis/friction.py [FOLDER]     FOLDER for the runs [results/friction]
"""

from __future__ import annotations

import math
import shutil
import sys
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

from cgfibre import plot_friction
from cgfibre.capstan.column import pull
from cgfibre.capstan.features import COEFFICIENTS, changed, features, rigid_ratio, sensitivities
from cgfibre.capstan.identify import TOLERANCE, identify
from cgfibre.capstan.run import CapstanOptions, CapstanResult, run_capstan
from cgfibre.capstan.scene import load_capstan
from cgfibre.measure.signal import TestRig
from cgfibre.mechanics.belt import tension_ratio
from cgfibre.mechanics.stick_slip import Slider, StickSlipLaw
from cgfibre.signals import SignalOptions, SignalResult, analyse_signals
from cgfibre.store import write_rows
from cgfibre.tow_friction import ANGLES_DEG, PULLEY, TABLE_3_1, tow_friction

ROOT = Path(__file__).resolve().parent.parent
FIGURES = ROOT / "docs" / "figures"
T1, WRAP, NOISE = 0.52, 2.87, 0.02
RIG = TestRig(T1, WRAP)

TEXT = """# Friction: tests, spectra, the stick-slip law, the capstan

Written by `python analysis/friction.py` from runs of `cgfibre signal` and `cgfibre capstan`. Equation, table and
figure numbers are those of N. D. Chakladar's thesis (Manchester, 2014).

## Test signals: `cgfibre signal FILE`

    cgfibre signal test.csv --input-tension "0.52 N" --wrap "2.87 rad" --window "10 s:170 s"
    cgfibre signal test.csv --input-tension "0.52 N" --wrap "2.87 rad" --columns time,displacement,force
    cgfibre signal a.txt b.txt c.txt --input-tension "0.52 N" --wrap "2.87 rad" --wrap "3.57 rad" --wrap "4.92 rad"

Reads what instruments write: commas, semicolons, tabs or spaces, decimal commas, header lines, units in the header
or in a row of their own, UTF-8, UTF-16 or Latin-1, columns in any order and by any name (`--columns` by name or
number, `--units`). `--speed` makes times of displacements. Rows without numbers are left out and counted. Files of
any length take bounded memory: beyond 262 144 rows, 2, 4, 8, ... consecutive ones are averaged (10 million rows,
280 MB: 0.21 GB and 14 s on one core).

| printed | is |
|---|---|
| `mu` | mean of ln(T/T1)/theta over the steady window (App A.1); the window is found, or given |
| `mu_s0` | at the highest sample before the window, where it stands out of the stick-slip by three scatters |
| `mu_s`, `mu_k` | crest and trough of the waveform at the strongest line; if none repeats, mean turning points |
| relative amplitude | (T_s - T_k)/mean T |
| `line` | frequencies that noise shows with a probability below 0.001, with standard errors; harmonics are named |
| several FILEs | mean +- 1.96 s/sqrt(n) of each wrap and direction; several wraps: regression of ln(T2/T1) on theta |
| a crosshead that turns | pulls up and down, each a trial; together ln(T_up/T_down)/(2 theta), which needs no T1 |

Three estimators on one grid (Eq 3-4, five times finer), by a non-uniform fast Fourier transform: Lomb-Scargle with
a floating mean and Baluev's false-alarm probability, the non-uniform DFT (Eq 3-2), the finite Fourier expansion by
the trapezoidal rule (Eq 3-3).

![Three spectra of a synthetic signal](figures/friction-spectrum.png)

A synthetic test of the law below: 1293 uneven samples over 180 s, two gaps, {noise:.0%} noise. True line
{true_line:.4f} Hz. Over {n_signals} such signals the largest errors are:

| | largest error |
|---|---|
| Lomb-Scargle, DFT, Fourier expansion: peak | {peak_errors} Hz |
| strongest line, refined | {line_error} Hz (stated standard error {line_stated} Hz) |
| `mu_s`, `mu_k` | {mu_s_error}, {mu_k_error} |

## Friction of tows: Tables 3-1 and 3-6

![Friction of tows against their angle](figures/friction-tows.png)

`cgfibre.tow_friction.tow_friction(angle, filaments)` interpolates (monotone cubics in the angle, straight in the
logarithm of the size) and gives the scatter of a trial and the 95 % interval of the value; `write_angle_table`
writes rows `angle_deg mu interval` for a deck. `cgfibre signal --angle "45 deg" --tow 6000` prints the table's
value beside the measured one. No value outside the tests: 0 to 90 degrees, 1500 to 12 000 filaments. The bump at 35
degrees (12k and 3k) stands in the table with a large scatter; it is kept.

## The stick-slip law (Eqs 4-3)

`cgfibre.mechanics.stick_slip.StickSlipLaw`: coefficient against slip, (i) elastic to mu_s0 at the critical slip,
(ii) a fall to mu_k, (iii) stick with 5 % of the stiffness to mu_s, a quarter of a cosine down to mu_k, and again.
Errata of the printed form are in its docstring. The law fixes its own frequency:

    f = 1 / ((mu_s - mu_k) critical_slip/(0.05 mu_s0 V) + 1/(4 f_slip))

{law_table}

The classic slider (mass on a spring, Coulomb friction; `Slider`, exact between events) is no explanation for 4 Hz:
the column of ten filaments on the spring of its free length would stick and slip at {slider_kHz:.0f} kHz. A spring
{softer:.0f} times softer would be needed.

## The capstan model: `cgfibre capstan capstan-column`

![Ten filaments over a pulley](figures/friction-capstan.png)

Ten filaments, 30 nodes, 2 s of test in {wall:.1f} processor seconds ({iterations:.1f} Newton iterations a step;
bar: 10 s). First peak {peak:.4f}, exp(mu_s0 theta) = {peak_law:.4f}; stick-slip at {frequency:.2f} Hz, the law's
{frequency_law:.2f} Hz.

| check in LAMMPS | T2/T1 | error |
|---|---|---|
| ten chains, Coulomb {mu_belt:g}, 30 nodes: exp(mu theta) | {belt:.5f} | {belt_error:+.4%} |
| the same against the polygon, ((1 + mu tan(a/2))/(1 - mu tan(a/2)))^n | | {belt_off:+.4%} |
| stick-slip law by `fix external`, masses x {scaling:.0e}, real speed: first peak | | {dynamic_peak:+.2%} |
| the same, root mean square of T2/T1 over {dynamic_span:g} s | | {dynamic_rms:.4f} |

The last two are against the quasi-static model ({dynamic_steps} steps in {dynamic_wall:.0f} s). Heavy masses delay
the force: what is left is that delay on the steep fall.

### What filaments share, and what a test cannot see

All filaments share the crosshead's motion, so they hardly move against each other, and summed over the column what
they do to each other cancels: the total is T1 exp(mu_pulley theta) whatever the friction between filaments is.
Total force with other coefficients between the filaments (mu_s0, mu_s, mu_k):

{between_table}

The thesis finds the total 6 % lower at (0.15, 0.12, 0.11); with one motion for all ends no friction between
filaments can do that.

![Force of each filament](figures/friction-filaments.png)

With the thesis' critical slip of 20 um between filaments nothing passes on: the lowest filament carries the
friction (Fig 4-11), and ln(T2/T1) is not one line. With a rigid contact between them (0.1 nm, coefficients above
the pulley's) all ten have one belt law (Fig 4-13): ln(T2/T1) from {rigid_low:.3f} to {rigid_high:.3f}, mu_s0 theta
= {rigid_law:.3f}. The thesis' two figures belong to two different contacts.

![ln(T/T1) along the wrap, rigid contacts](figures/friction-wrap.png)

Rigid contacts part where the pulley asks for more than they hold: below the pulley's own coefficient (0.24). Slip
between the lowest two filaments at the first peak:

{slip_table}

The thesis sees none at 0.23 and some at 0.20 (its contacts give way by 20 um first).

### Identification: `cgfibre capstan SCENE --fit test.csv --input-tension ... --wrap ...`

Least squares on ln(T2/T1)/theta, from a grid of starts, the spectrum's line being a help; errors from the singular
values of the Jacobian; a coefficient is identified where its 95 % interval is within {tolerance}. Synthetic signals
with {noise:.0%} noise, {n_fits} of each kind:

{identification_table}

At 7 samples a second none falls on the first peak of 0.13 s: mu_s0 then follows from the period alone ((mu_s -
mu_k)/mu_s0) and is reported as not identifiable. The coefficients between filaments never are, from the total force
(what each filament's own force would tell is printed by `cgfibre capstan`):

{verdict_table}

### Sensitivities (Figs 4-7 to 4-9)

![Sensitivity to each coefficient](figures/friction-sensitivity.png)

Base (0.22, 0.18, 0.16), +0.01 in one coefficient, rigid belt:

{sensitivity_table}

- mu_s0: the thesis prints +5 % of first sticking time, amplitude unchanged. By Eqs 4-3 the stiffness follows mu_s0
  and the time does not change; with the stiffness kept (a test's own spring in series) it is +{stick_rise:.1%}.
- mu_s: printed +8 % relative amplitude. That of the friction force T2 - T1 over its least goes from
  {amplitude_base:.1%} to {amplitude_mu_s:.1%}, so 7 points.
- mu_k: printed +5 %, a rise. It falls, from {amplitude_base:.1%} to {amplitude_mu_k:.1%}; what rises by 7 % is the
  force T2 - T1 at its least.
- The frequency is called steady; by the law itself it is not: mu_s - mu_k sets it.

### Table 4-2

{table_4_2}

Fitted to (0.22, 0.18, 0.16) by trial and error, model (i) got a smaller mu_s - mu_k; model (ii) needs mu_s0 =
0.24 on the pulley for the same signal. The closed form does not bear that out: the total knows the pulley's
coefficient alone, so both models with the same triple give the same signal, and the fit of the experiment's
features is the experiment's triple. Fitted to model (ii)'s total force, noise-free, `identify` gives the pulley's
triple back: {back}. What made the finite element models differ (their increments at the peak, their contact)
cannot be told from the thesis.
"""


def _law(mu_s0: float, mu_s: float, mu_k: float) -> StickSlipLaw:
    return replace(load_capstan("capstan-column").column().pulley, mu_s0=mu_s0, mu_s=mu_s, mu_k=mu_k)


BASE = _law(0.22, 0.18, 0.16)


def _table(header: list[str], rows: list[list[str]]) -> str:
    return "\n".join("| " + " | ".join(r) + " |" for r in [header, ["---"] * len(header), *rows])


def _signal(seed: int, law: StickSlipLaw = BASE) -> tuple[np.ndarray, np.ndarray]:
    """1293 uneven samples over 180 s with two gaps and noise: (s, N)."""
    rng = np.random.default_rng(seed)
    t = np.sort(rng.uniform(0.0, 180.0, 2600))
    t = t[~(((t > 40) & (t < 47)) | ((t > 100) & (t < 103)))]
    t = np.sort(rng.choice(t, 1293, replace=False))
    return t, _noisy(law, t, rng)


def _noisy(law: StickSlipLaw, t: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    return T1 * rigid_ratio(law, WRAP, t * 1e6) * (1 + NOISE * rng.normal(size=len(t)))


def signals(out: Path, n: int = 20) -> dict[str, object]:
    """Signals analysed: errors of lines and coefficients."""
    true = BASE.cycle_frequency * 1e6
    results: list[SignalResult] = []
    for seed in range(n):
        path = out / f"synthetic-{seed}.csv"
        write_rows(path, ["time (s)", "force (N)"], np.column_stack(_signal(seed)).tolist())
        folder = out / "signal" if seed == 0 else None
        results.append(analyse_signals([path], SignalOptions((T1,), (WRAP,), out=folder, force=True)))
    shutil.copyfile(out / "signal" / "spectrum-synthetic-0.png", FIGURES / "friction-spectrum.png")
    trials = [r.trials[0] for r in results]
    peaks = {name: max(abs(t.peaks[name] - true) for t in trials) for name in ("lomb_scargle", "dft", "expansion")}
    lines = [t.friction.lines[0] for t in trials]
    return {
        "noise": NOISE,
        "true_line": true,
        "n_signals": n,
        "peak_errors": ", ".join(f"{v:.5f}" for v in peaks.values()),
        "line_error": f"{max(abs(line.frequency - true) for line in lines):.5f}",
        "line_stated": f"{np.mean([line.error for line in lines]):.5f}",
        "mu_s_error": f"{max(abs(t.friction.mu_s - 0.18) for t in trials):.4f}",
        "mu_k_error": f"{max(abs(t.friction.mu_k - 0.16) for t in trials):.4f}",
    }


def tows() -> None:
    """The figure of tow friction."""
    angle = np.linspace(0.0, 90.0, 361)
    views = []
    for n in sorted(TABLE_3_1, reverse=True):
        found = [tow_friction(math.radians(a), n) for a in angle.tolist()]
        points = np.column_stack([ANGLES_DEG, *TABLE_3_1[n]])
        values = np.array([[f.mu, f.interval] for f in found]).T
        views.append(plot_friction.TowFrictionView(f"{n / 1000:g}k", angle, *values, points))
    plot_friction.figure_tow_friction(views, PULLEY).savefig(FIGURES / "friction-tows.png")


def law() -> dict[str, object]:
    """Frequencies of the law, and the slider's."""
    rows = []
    for mu in ((0.22, 0.18, 0.16), (0.22, 0.16, 0.15), (0.24, 0.16, 0.15)):
        one = _law(*mu)
        rows.append([str(mu), f"{one.cycle_frequency * 1e6:.2f}", f"{one.stick_length:.1f}", f"{one.slip_length:.1f}"])
    scene = load_capstan("capstan-column")
    column = scene.column()
    high, low = (column.load * (float(tension_ratio(mu, column.wrap)) - 1) for mu in (0.18, 0.16))
    mass = 10 * scene.filament.density * math.pi / 4 * scene.filament.diameter**2 * column.radius * column.wrap
    spring = 10 * scene.filament.EA / column.free_length
    slider = Slider(mass, spring, column.speed, high, low)
    soft = (high - low) / (column.speed / (2 * 4e-6))  # a period of 2 A/V = 1/(4 Hz)
    return {
        "law_table": _table(["mu_s0, mu_s, mu_k", "f, Hz", "stick, um", "slip, um"], rows),
        "slider_kHz": 1e3 / slider.period,
        "softer": float(f"{spring / soft:.2g}"),
    }


def capstan(out: Path) -> tuple[dict[str, object], CapstanResult]:
    """The shipped scene with both checks in LAMMPS."""
    r = run_capstan("capstan-column", CapstanOptions(out / "capstan", force=True, dynamic=True))
    shutil.copyfile(out / "capstan" / "signal.png", FIGURES / "friction-capstan.png")
    shutil.copyfile(out / "capstan" / "filaments.png", FIGURES / "friction-filaments.png")
    if r.belt is None or r.dynamic is None or r.verdict is None:
        raise RuntimeError("the run lacks its checks")
    widths = [
        [name, *(f"+- {1.96 * e:.4f}" if 1.96 * e <= TOLERANCE else "not identifiable" for e in (a, b))]
        for name, a, b in zip(r.verdict.total.names, r.verdict.total.errors, r.verdict.each.errors, strict=True)
    ]
    return {
        "wall": r.cpu_s,
        "iterations": r.pulled.iterations,
        "peak": r.seen.peak,
        "peak_law": r.law.peak,
        "frequency": r.seen.frequency * 1e6,
        "frequency_law": r.law.frequency * 1e6,
        "mu_belt": r.column.pulley.mu_s0,
        "belt": r.belt.ratio,
        "belt_error": r.belt.error,
        "belt_off": r.belt.error - r.belt.polygon_error,
        "scaling": r.dynamic.mass_scaling,
        "dynamic_peak": r.dynamic.peak_error,
        "dynamic_rms": r.dynamic.rms,
        "dynamic_span": r.scene.capstan.dynamic.duration * 1e-6,
        "dynamic_steps": r.dynamic.run.steps,
        "dynamic_wall": r.dynamic.run.wall,
        "verdict_table": _table(["coefficient", "from the total force", "from each filament's force"], widths),
    }, r


def sharing(r: CapstanResult) -> dict[str, object]:
    """Other frictions between filaments: total force, what filaments share, where they slip."""
    column = r.column
    rows = []
    for mu in ((0.23, 0.17, 0.16), (0.20, 0.16, 0.14), (0.15, 0.12, 0.11), (0.45, 0.38, 0.36)):
        for slip in (20.0, 1e-3):
            between = replace(column.between, critical_slip=slip)
            between = replace(between, mu_s0=mu[0], mu_s=mu[1], mu_k=mu[2])
            p = pull(replace(column, between=between), 4e5, 1e3)
            y = p.total / column.load
            late = y[p.time > 2.5e5]
            rows.append([str(mu), f"{slip:g}", f"{y.max():.4f}", f"{late.max():.4f}", f"{late.min():.4f}"])
    strong = replace(column.between, mu_s0=0.45, mu_s=0.38, mu_k=0.36, critical_slip=1e-4)
    rigid = pull(replace(column, between=strong), 1.25e5, 1e3)
    logs = np.log(rigid.tension[-1] / rigid.tension[-1][:, :1])
    angle = np.asarray(np.arange(column.nodes + 1) * column.turn)
    view = plot_friction.WrapView(angle, logs, column.pulley.mu_s0, column.pulley.mu_s0 - 0.001, 0.125)
    plot_friction.figure_wrap(view, r"belt law, $\mu_{s0}$").savefig(FIGURES / "friction-wrap.png")
    slips = []
    for mu_s0 in (0.15, 0.20, 0.22, 0.23, 0.235, 0.245, 0.26):
        between = replace(column.between, mu_s0=mu_s0, mu_s=min(mu_s0, 0.16), mu_k=0.11, critical_slip=1e-3)
        p = pull(replace(column, between=between), 1.25e5, 1e3)
        slips.append([f"{mu_s0:g}", f"{np.abs(p.slip[-1][1]).max():.4f}", f"{(p.total[-1] / column.load):.4f}"])
    return {
        "between_table": _table(["between the filaments", "critical slip, um", "first peak", "high", "low"], rows),
        "rigid_low": float(logs[:, -1].min()),
        "rigid_high": float(logs[:, -1].max()),
        "rigid_law": column.pulley.mu_s0 * column.wrap,
        "slip_table": _table(["mu_s0 between", "slip, um", "total T2/T1"], slips),
    }


def identification(n: int = 20) -> dict[str, object]:
    """Fits of synthetic signals: errors of what is identified, and how often that is."""
    t = np.arange(1, 1001) * 2e-3
    kinds = {
        "2 s, 500 samples a second": lambda s, one: (t, _noisy(one, t, np.random.default_rng(s))),
        "the same without its first 0.4 s": lambda s, one: (
            t[t > 0.4],
            _noisy(one, t, np.random.default_rng(s))[t > 0.4],
        ),
        "180 s, 7 uneven samples a second": _signal,
    }
    rows = []
    for kind, make in kinds.items():
        for mu in ((0.22, 0.18, 0.16), (0.22, 0.16, 0.15), (0.45, 0.38, 0.36)):
            fits = []
            for seed in range(n):
                time_s, force = make(seed, _law(*mu))
                fits.append(identify(time_s * 1e6, force, RIG, BASE))
            cells = []
            for name, true in zip(COEFFICIENTS, mu, strict=True):
                good = [f[name] for f in fits if f[name].identifiable]
                worst = max((abs(e.value - true) for e in good), default=math.nan)
                cells.append("not identifiable" if not good else f"{worst:.4f} ({len(good)} of {n})")
            rows.append([kind, str(mu), *cells])
    header = ["signal", "true", *(f"{c}: largest error of those identified" for c in COEFFICIENTS)]
    return {"identification_table": _table(header, rows), "n_fits": n, "tolerance": TOLERANCE}


def sensitivity() -> dict[str, object]:
    """Figs 4-7 to 4-9."""
    wrap = load_capstan("capstan-column").capstan.wrap
    at = np.arange(0.0, 2.001, 0.002)
    studies = {
        name: [
            (getattr(one, name), rigid_ratio(one, wrap, at * 1e6))
            for one in (changed(BASE, name, change) for change in (-0.01, 0.0, 0.01))
        ]
        for name in COEFFICIENTS
    }
    plot_friction.figure_sensitivity(at, studies).savefig(FIGURES / "friction-sensitivity.png")
    table = sensitivities(BASE, wrap)
    rows = []
    for (name, fixed), v in table.items():
        label = name + (" (stiffness kept)" if fixed == "stiffness" else "")
        keys = ("stick_time", "peak", "amplitude", "friction_amplitude", "frequency")
        rows.append([label, *(f"{v[k]:+.1%}" for k in keys)])
    header = ["+0.01 in", "first sticking", "first peak", "amplitude of T2", "amplitude of T2 - T1", "frequency"]
    return {
        "sensitivity_table": _table(header, rows),
        "stick_rise": table["mu_s0", "stiffness"]["stick_time"],
        "amplitude_base": features(BASE, wrap).friction_amplitude,
        "amplitude_mu_s": features(changed(BASE, "mu_s", 0.01), wrap).friction_amplitude,
        "amplitude_mu_k": features(changed(BASE, "mu_k", 0.01), wrap).friction_amplitude,
    }


def table_4_2(r: CapstanResult) -> dict[str, object]:
    """The thesis' models beside the experiment."""
    wrap, column = r.column.wrap, r.column
    rows = []

    def row(name: str, mu: str, ratio: np.ndarray, at: np.ndarray, frequency: float) -> None:
        late = ratio[at > 2.5e5]
        amplitude = (late.max() - late.min()) / (late.min() - 1)
        rows.append([name, mu, *(f"{x:.3f}" for x in (ratio.max(), late.max(), late.min())), f"{amplitude:.1%}",
                     f"{frequency * 1e6:.2f}"])  # fmt: skip

    at = np.arange(0.0, 2e6, 500.0)
    row("experiment (its coefficients)", "0.22, 0.18, 0.16", rigid_ratio(BASE, wrap, at), at, BASE.cycle_frequency)
    one = _law(0.22, 0.16, 0.15)
    single = pull(replace(column, filaments=1, EA=10 * column.EA, pulley=one), 2e6, 1e3)
    row("model (i)", "0.22, 0.16, 0.15", single.total / column.load, single.time, one.cycle_frequency)
    two = r.pulled
    row("model (ii)", "pulley 0.24, 0.16, 0.15; between 0.23, 0.17, 0.16", two.total / column.load, two.time,
        column.pulley.cycle_frequency)  # fmt: skip
    found = identify(two.time[1:], two.total[1:], TestRig(column.load, wrap), BASE)
    header = ["", "mu_s0, mu_s, mu_k", "first peak", "high", "low", "amplitude of T2 - T1", "f, Hz"]
    back = ", ".join(f"{e.name} {e.value:.4f}" for e in found.estimates)
    return {"table_4_2": _table(header, rows), "back": back}


def main() -> None:
    """Run everything; write the document and its figures."""
    out = Path(sys.argv[1]) if len(sys.argv) > 1 else ROOT / "results" / "friction"
    out.mkdir(parents=True, exist_ok=True)
    FIGURES.mkdir(parents=True, exist_ok=True)
    begin = time.perf_counter()
    found: dict[str, object] = {}
    numbers, r = capstan(out)
    tows()
    for more in (numbers, signals(out), law(), sharing(r), identification(), sensitivity(), table_4_2(r)):
        found |= more
    (ROOT / "docs" / "friction.md").write_text(TEXT.format(**found))
    print(f"docs/friction.md in {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
