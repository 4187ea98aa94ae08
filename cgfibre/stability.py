"""Maps of where each method fails, measured by small runs beside closed forms: the verb ``stability``."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Sequence
from dataclasses import astuple, dataclass, fields
from pathlib import Path

import numpy as np

from cgfibre import plot, plot_chart, store
from cgfibre.cases import limits, pitfalls, touching
from cgfibre.cases.limits import Bench, LimitMap, Point
from cgfibre.errors import InputError

CSV_NAME, H5_NAME = "stability.csv", "stability.h5"
#: progress: (map, number of the map, maps, points so far)
Progress = Callable[[LimitMap, int, int, int], None]

STEP = "time step limit"
MAPS: tuple[LimitMap, ...] = (
    LimitMap(
        "step-spacing",
        "Time step against bead spacing",
        "spacing s/D",
        "1",
        STEP,
        "us",
        "Beyond 2/omega the highest mode of the beads grows without bound within a few steps.",
        "2/omega; chain omega^2 = max(4 EA/(s m), 16 EI/(s^3 m)), rod max(4 kr/m, 4 kt/I, bending)",
        "Default: 0.65 of the limit. Refusal: model.timestep at or above the limit. A run that bursts all the same "
        "ends "
        "with exit code 3 and says to halve the step.",
        limits.step_against_spacing,
    ),
    LimitMap(
        "step-softening",
        "Time step against softened EA",
        "axial softening",
        "1",
        STEP,
        "us",
        "Softening EA lengthens the step only until bending is the stiffer.",
        "2/omega as above, EA over the softening; chains gain up to EA s^2/(4 EI) = 4 (s/D)^2",
        "Default: model.axial_softening = EA s^2/(4 EI) for chains (at most 30, and no more than 0.2 % strain by "
        "the end "
        "load), 1 for rods.",
        limits.step_against_softening,
    ),
    LimitMap(
        "step-contact",
        "Time step against contact stiffness",
        "contact softening",
        "1",
        STEP,
        "us",
        "Close-packed filaments whose contacts all stick vibrate in their contacts; spinning beads and discs fastest.",
        "2/omega; 9/2 (kn + kt)/m in the section, 3 kt/(J m) where beads spin alike (J = I/(m D^2)), with the "
        "filament's "
        "own stiffness added",
        "Default: the plan bounds the contacts' frequency (contact_stiffness_bound) for the step. Refusal: "
        "contact.softening below 1. Undamped contacts; see the next map for damped ones.",
        limits.step_against_contact,
    ),
    LimitMap(
        "step-damping",
        "Time step against contact damping",
        "contact damping ratio",
        "1",
        STEP,
        "us",
        "Velocity-Verlet takes damping half a step late, so damping shortens the step. A disc in six sticking "
        "contacts is "
        "overdamped long before a pair of them is.",
        "4/(c + sqrt(c^2 + 4 omega^2)), c = 3 x gamma/(J m) for beads that spin alike, 9 (1 + x)/2 gamma/m across, "
        "x = 0.3",
        "Default: the plan's step is 0.9 of a bound that adds six damped contacts, one of them a platen's, to bending "
        "(ContactPlan.bounds, mechanics.rod.limiting_time_step); tangential damping is 0.3 of the normal one, so that "
        "spinning discs are not overdamped.",
        limits.step_against_damping,
        (False, True),
    ),
    LimitMap(
        "step-rod-damping",
        "Time step against the damping of rods",
        "damping of bonds over critical",
        "1",
        STEP,
        "us",
        "Damping of bpm bonds shortens the step as that of contacts does. The engine multiplies the coefficient of "
        "rolling by half the bond's length, so it must be divided by that: thick rods burst otherwise.",
        "4/(c + sqrt(c^2 + 4 omega^2)) = (2/omega) (sqrt(1 + zeta^2) - zeta), least over the modes",
        "Default: 0.05 of critical in every mode (the deck's rod_damping), which takes 5 % of the limit.",
        pitfalls.step_against_rod_damping,
    ),
    LimitMap(
        "step-dihedral",
        "Dihedrals on nearly straight chains",
        "bend a bead",
        "rad",
        STEP,
        "us",
        "A dihedral turns about a lever s theta: the straighter the chain, the stiffer, singular when straight.",
        "omega^2 = 64 GJ/(s^3 theta^2 m), with the chain's own",
        "Refusal: model.torsion = dihedral on filaments bent by less than 0.01 rad a bead, and a time step above "
        "0.99 of "
        "this limit.",
        pitfalls.dihedral_against_bend,
    ),
    LimitMap(
        "step-materials",
        "Time step of soft and stiff materials",
        "EI/GJ",
        "1",
        STEP,
        "us",
        "Materials whose shear is very stiff or very soft beside their tension shift the limit to other modes.",
        "2/omega as for the spacing",
        "Default: 0.65 of the limit, for every material alike.",
        pitfalls.steps_of_materials,
    ),
    LimitMap(
        "deflection-materials",
        "Static error of soft and stiff materials",
        "EI/GJ",
        "1",
        "mid-span deflection over exact",
        "1",
        "A wrong stiffness of a mode, or a run that never comes to rest, would show here.",
        "simply supported, L = 20 D, Timoshenko for rods; chains 1 + 2 (s/L)^2, rods 1",
        "Nothing needed: errors as stated for the spacing, whatever the material.",
        pitfalls.deflections_of_materials,
        (True, False),
    ),
    LimitMap(
        "force-speed",
        "Force error against platen speed",
        "platen speed",
        "m/s",
        "force change on halving the speed",
        "1",
        "Inertia adds to the platen's force; energy ratios do not show it.",
        "the plan's bound: v k/(omega F) of filaments, v sqrt(kn m)/F of beads",
        "Default: platens.speed by this bound. Guard: the speed check of every run beside half its speed, 'platen "
        "speed' "
        "and 'quasi-static'.",
        pitfalls.force_against_speed,
    ),
    LimitMap(
        "passing-spacing",
        "Force that pushes crossing filaments through each other",
        "spacing s/D",
        "1",
        "barrier",
        "N",
        "Beads of one filament slip between the beads of another, in silence.",
        "4 kn (D^(2/3) - (s^2/2)^(1/3))^(3/2); 0 from s = 1.41 D on",
        "Refusal: model.spacing above D where there are neighbours. Guards: 'filaments through each other' (winding "
        "numbers), 'overlap of filaments'.",
        touching.passing_against_spacing,
        (False, False),
    ),
    LimitMap(
        "passing-softening",
        "The same against contact softening",
        "contact softening",
        "1",
        "barrier",
        "N",
        "The barrier falls with the contact stiffness.",
        "as above, proportional to kn",
        "Guards: 'overlap of filaments' (0.02 D beyond the real approach comes long before a passage at 0.29 D), "
        "'filaments through each other'.",
        touching.passing_against_softening,
    ),
    LimitMap(
        "overlap-softening",
        "Overlap of softened contacts",
        "contact softening",
        "1",
        "overlap over D",
        "1",
        "A soft contact lets surfaces overlap, and the assembly becomes too thin.",
        "F/(kn D)",
        "Guards: 'overlap of filaments', 'overlap with a platen' (0.02 D beyond the real approach), 'platen passed'.",
        touching.overlap_against_softening,
    ),
    LimitMap(
        "thickness-load",
        "Thickness error a contact",
        "line load",
        "N/mm",
        "overlap beyond the real approach, over D",
        "1",
        "One stiffness stands for a contact whose stiffness grows with the load, softened or not.",
        "(softening f/k' - delta(f))/D, delta of the plane-strain line contact, k' its secant at contact.line_load",
        "Refusal: none. Guards: 'overlap of filaments' (what softening adds; approach beyond 0.25 D). "
        "contact.line_load "
        "sets where the error is 0.",
        touching.thickness_error_against_load,
        (True, False),
    ),
    LimitMap(
        "friction-spacing",
        "Friction ripple over beads",
        "spacing s/D",
        "1",
        "peak of F/N",
        "1",
        "A chain of beads climbs the beads of its neighbour: friction along a filament ripples.",
        "tan(asin(s/2D) + atan mu)",
        "Stated in every plan under what is left out ('smoothness of the filament's surface'); model.spacing = D/4 "
        "halves "
        "it twice. No guard: the mean is right.",
        touching.ripple_against_spacing,
        (True, False),
    ),
    LimitMap(
        "hinge-bend",
        "Angle styles near 180 degrees",
        "bend a bead",
        "rad",
        "stiffness over EI/s",
        "1",
        "angle harmonic divides by the sine of the bend, the engine by 0.001 at least: a straight chain has no bending "
        "stiffness.",
        "cosine sin(x)/x; harmonic min(1, sin(x)/0.001)",
        "Default: angle cosine. angle harmonic only with dihedrals, which are refused below 0.01 rad a bead.",
        pitfalls.hinge_against_bend,
    ),
    LimitMap(
        "torsion-tilt",
        "Torsion of a rod along z",
        "tilt from z",
        "rad",
        "torsional stiffness over GJ/s",
        "1",
        "A bpm bond exactly along +z with tags rising has no torsion.",
        "1",
        "Refusal (assembler): a bond exactly along +z at level rod; any tilt above 1e-12 rad, or tags that fall "
        "along z, "
        "cures it. Bundles run along x.",
        pitfalls.torsion_against_tilt,
        (True, False),
    ),
    LimitMap(
        "torque-turn",
        "Turns of a bond",
        "turn",
        "rad",
        "torque over stiffness",
        "rad",
        "Bending beyond pi a bond changes its sign, twist beyond 2 pi jumps by 4 pi.",
        "linear",
        "Stays far off: a bundle that twists by 2 pi a bond (7 um) would need 1400 turns/cm; built twist is "
        "stress-free or refused by strain.",
        pitfalls.torsion_against_turn,
        (False, False),
    ),
    LimitMap(
        "energy-damping",
        "Twist and bending of an undamped rod",
        "damping of bonds over critical",
        "1",
        "kinetic energy at the end over the start",
        "1",
        "Undamped, torsional waves feed bending until bonds are lost.",
        "must not grow: at most 1 (a burst run is drawn at 1e6)",
        "Default: the deck's rod_damping = 0.05, five times what is needed. A burst ends with exit code 3.",
        pitfalls.energy_against_damping,
    ),
    LimitMap(
        "axial-contact",
        "Contacts within a filament",
        "4 s kn/EA",
        "1",
        "stiffness in compression over EA",
        "1",
        "With s = D/2 a bead touches the next but one: special_bonds 0 1 1 alone lets them push.",
        "1 + 4 s kn/EA",
        "Default: neigh_modify exclude molecule/intra in every deck.",
        pitfalls.axial_against_contact,
        (True, False),
    ),
    LimitMap(
        "start-tension",
        "Sudden tension",
        "tension",
        "cN",
        "kinetic energy over P^2 L/EA",
        "1",
        "A load switched on at once becomes a wave whose kinetic energy is half of its work.",
        "1/2 (bar under a step load)",
        "Default: natural lengths r0 = s/(1 + P/EA), so that the filament starts in equilibrium.",
        pitfalls.kinetic_against_tension,
    ),
    LimitMap(
        "ghosts-spacing",
        "Reach of ghosts on two ranks",
        "spacing s/D",
        "1",
        "least reach",
        "um",
        "Bonds across the border of two ranks need the beads beyond it, else 'Bond atoms missing'.",
        "s for chains, 2 s for rods where the border meets a bead; half a bond less at mid-bond",
        "Default: 2.5 s + D + 2 um; with a far field ranks never share a filament out along x. A bond that is "
        "missed ends "
        "the run with exit code 3.",
        pitfalls.ghosts_against_spacing,
        (False, False),
    ),
)


@dataclass(frozen=True)
class Finding:
    """A finished map: its declaration and its points."""

    map: LimitMap
    points: tuple[Point, ...]

    @property
    def cpu(self) -> float:
        """Processor seconds of the engine."""
        return sum(p.cpu for p in self.points)

    @property
    def worst(self) -> float:
        """Largest |measured/predicted - 1| over the points that have a prediction that is not 0; nan without one."""
        ratios = [
            abs(p.measured / p.predicted - 1)
            for p in self.points
            if np.isfinite(p.predicted) and abs(p.predicted) > 1e-12
        ]
        return max(ratios, default=float("nan"))

    @property
    def step_used(self) -> float:
        """Largest step that the package uses over the limit measured; nan for maps of other things."""
        if self.map.quantity != STEP:
            return float("nan")
        return max((p.used / p.measured for p in self.points if np.isfinite(p.used)), default=float("nan"))


def find_maps(names: Sequence[str] = ()) -> tuple[LimitMap, ...]:
    """The maps of these names, all of them for none; InputError for an unknown name."""
    known = {m.name: m for m in MAPS}
    for name in names:
        if name not in known:
            raise InputError("--map", name, "one of " + ", ".join(known))
    return tuple(m for m in MAPS if not names or m.name in names)


def find_limits(
    out: Path, names: Sequence[str] = (), force: bool = False, progress: Progress | None = None
) -> list[Finding]:
    """Measure the maps (all, or those named) into ``out``; those found there already are kept unless ``force``.

    Each map is written when it is done: stability.csv and stability.h5 (a row a point), stability-NAME.png. Raises
    InputError for an unknown name or a folder that cannot be written, EngineError when there is no engine.
    """
    chosen = find_maps(names)
    if out.exists() and not out.is_dir():
        raise InputError("--out", str(out), "a folder, not a file")
    try:
        out.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError("--out", str(out), f"a folder that can be written ({error.strerror})") from error
    done = _read(out)
    found = []
    for number, chart in enumerate(chosen, start=1):
        points = done.get(chart.name, ())
        if force or not points:
            points = _measure(chart, number, len(chosen), progress)
            done[chart.name] = points
            _write(out, done)
        finding = Finding(chart, points)
        draw(finding, out / picture_name(chart))
        found.append(finding)
    return found


def _measure(chart: LimitMap, number: int, of: int, progress: Progress | None) -> tuple[Point, ...]:
    points: list[Point] = []
    with tempfile.TemporaryDirectory(prefix="cgfibre-") as folder:
        if progress is not None:
            progress(chart, number, of, 0)
        for point in chart.points(Bench(Path(folder))):
            points.append(point)
            if progress is not None:
                progress(chart, number, of, len(points))
    return tuple(points)


def _columns(chart: LimitMap) -> dict[str, str]:
    """Names of a map's columns in the tables, with their units."""
    units = {"parameter": chart.parameter_unit, "cpu": "s", "series": "text"}
    return {f.name: units.get(f.name, chart.unit) for f in fields(Point)}


def _write(out: Path, done: dict[str, tuple[Point, ...]]) -> None:
    """All maps there are, in the order of :data:`MAPS`; the HDF5 file last, since a later call goes on from it."""
    present = [m for m in MAPS if m.name in done]
    header = ["map", "parameter_name", "parameter_unit", "quantity", "unit", *_columns(MAPS[0])]
    rows = [
        [m.name, m.parameter, m.parameter_unit, m.quantity, m.unit, *astuple(p)] for m in present for p in done[m.name]
    ]
    store.write_rows(out / CSV_NAME, header, rows)
    tables = [
        store.Table(
            m.name,
            {"title": m.title, "parameter": m.parameter, "quantity": m.quantity, "formula": m.formula},
            {
                name: (
                    np.array([getattr(p, name) for p in done[m.name]], dtype=None if name != "series" else "O"),
                    unit,
                )
                for name, unit in _columns(m).items()
            },
        )
        for m in present
    ]
    store.write_tables(out / H5_NAME, tables)


def _read(out: Path) -> dict[str, tuple[Point, ...]]:
    """Maps that a folder holds; StoreError for a damaged file."""
    path = out / H5_NAME
    if not path.exists():
        return {}
    names = [f.name for f in fields(Point)]
    return {
        table.name: tuple(
            Point(str(row[0]), *map(float, row[1:]))
            for row in zip(*(table.columns[name][0] for name in names), strict=True)
        )
        for table in store.read_tables(path)
    }


def picture_name(chart: LimitMap) -> str:
    """File name of a map's picture."""
    return f"stability-{chart.name}.png"


def draw(finding: Finding, path: Path) -> None:
    """The map's picture: measured limits as points on the lines of their closed forms."""
    m = finding.map
    view = plot_chart.LimitView(
        m.title,
        _label(m.parameter, m.parameter_unit),
        _label(m.quantity, m.unit),
        m.logarithmic,
    )
    figure = plot.new_figure(9.5, 4.6)
    with plot.style():
        names = dict.fromkeys(p.series for p in finding.points)
        plot_chart.plot_limits(figure.add_subplot(), view, [_series(finding, name) for name in names])
        figure.savefig(path)


def _label(name: str, unit: str) -> str:
    return name if unit == "1" else f"{name} [{unit}]"


def _series(finding: Finding, name: str) -> plot_chart.LimitSeries:
    points = [p for p in finding.points if p.series == name]
    columns = {f: np.array([getattr(p, f) for p in points]) for f in ("parameter", "measured", "predicted", "used")}
    return plot_chart.LimitSeries(name, **columns)
