"""What is asked: the TOML scene, validated, every quantity a float in engine units.

A scene is a set of tables (``[filament]``, ``[assembly]``, ``[ends]``, ``[platens]``, ``[contact]``, ``[model]``,
``[output]``), each a frozen model below; its fields are the keys. Quantities are text with a unit in TOML and plain
floats here (um, us, nN, kPa, rad, turn/um). Whatever is wrong becomes one :class:`cgfibre.errors.InputError` that names
the dotted key, the value and what was expected.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import tomli_w
from pydantic import BaseModel, BeforeValidator, model_validator
from pydantic_core import PydanticCustomError

from cgfibre import units
from cgfibre.errors import InputError
from cgfibre.materials import find_material, isotropic_shear_modulus
from cgfibre.scene_assembly import LEAST_VOID_FRACTION, Bundle, Cell, Weave, full_rings
from cgfibre.scene_messages import field_value, one_of
from cgfibre.scene_values import (
    NOT_GIVEN,
    Abridged,
    AngleTable,
    AutoFactor,
    AutoLength,
    AutoSpeed,
    AutoSteps,
    AutoTime,
    Density,
    ForceOrZero,
    Friction,
    FullLength,
    LawRows,
    LawText,
    LineForce,
    Modulus,
    PoissonRatio,
    Table,
    TimeOrZero,
    Value,
    refusal,
)

#: levels of a cross-section, which have no length along the filaments
FLAT = ("section", "subbundle")

T = TypeVar("T", bound=BaseModel)


class Filament(Table):
    """``[filament]``: one fibre, transversely isotropic about its axis.

    A named material of the library fills what is not given; without one, all are required but ``nu12`` (0.3) and
    ``G23``, which is E2 / (2 (1 + nu23)) (also when a named material's ``E2`` or ``nu23`` is changed).
    """

    material: str | None = None
    diameter: Annotated[float, Value("um", least=0.01, most=1e4)]
    E1: Modulus
    E2: Modulus
    nu12: PoissonRatio = 0.3
    nu23: PoissonRatio
    G12: Modulus
    G23: Modulus
    density: Density

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        given = dict(data)
        derive = "G23" not in given and ("material" not in given or "E2" in given or "nu23" in given)
        if "material" in given:
            library = find_material(given["material"])
            for key in cls.model_fields:
                if key not in given and not (key == "G23" and derive):
                    given[key] = field_value(cls, key).write(getattr(library, key))
        if derive and "E2" in given and "nu23" in given:
            try:
                e2, nu23 = (field_value(cls, key).read(given[key]) for key in ("E2", "nu23"))
            except PydanticCustomError:
                return given  # named by its own field
            given["G23"] = units.format(isotropic_shear_modulus(float(e2), float(nu23)), "kPa")
        return given

    @property
    def EA(self) -> float:
        """Axial stiffness E1 pi D^2 / 4 in nN."""
        return self.E1 * math.pi * self.diameter**2 / 4.0


#: kind -> table
ASSEMBLIES: dict[str, type[Bundle] | type[Weave]] = {"bundle": Bundle, "weave": Weave}


#: laws of soft tows
TOW_LAWS = ("linear", "exponential", "table")


def _assembly(data: Any) -> Any:
    if not isinstance(data, dict):
        raise refusal("", data, "a table [assembly]")
    kind = data.get("kind", "bundle")
    if not isinstance(kind, str) or kind not in ASSEMBLIES:
        raise refusal("kind", kind, one_of(ASSEMBLIES))
    return ASSEMBLIES[kind].model_validate(data)


class Ends(Table):
    """``[ends]``: how filaments are held, and the tension on each."""

    support: Literal["simply-supported", "clamped", "symmetry"] = "simply-supported"
    tension: ForceOrZero = 4.0e5  # 0.04 cN


class Stop(Table):
    """``[platens.stop]``: where loading ends, by exactly one of five measures.

    ``line_force`` is the force on the platen over its length along the filaments (for a section: over its depth).
    """

    displacement: Annotated[float | None, Value("um", above=0.0, most=1e7)] = None
    thickness: Annotated[float | None, Value("um", above=0.0, most=1e7)] = None
    pressure: Annotated[float | None, Value("kPa", above=0.0, most=1e10)] = None
    force: Annotated[float | None, Value("nN", above=0.0)] = None
    line_force: Annotated[float | None, Value("nN/um", above=0.0)] = None

    @model_validator(mode="after")
    def _exactly_one(self) -> Stop:
        given = [key for key in Stop.model_fields if getattr(self, key) is not None]
        if len(given) != 1:
            expected = "exactly one of displacement, thickness, pressure, force or line_force"
            raise refusal("", Abridged("{" + ", ".join(given) + "}") if given else NOT_GIVEN, expected)
        return self

    @property
    def kind(self) -> str:
        """Which of the five measures is given."""
        return next(key for key in Stop.model_fields if getattr(self, key) is not None)

    @property
    def value(self) -> float:
        """Its value: um, kPa, nN or nN/um."""
        return float(getattr(self, self.kind))


class Cycle(Stop):
    """A row of ``platens.cycles``: an earlier stop, ``times`` over."""

    times: Annotated[int, Value(whole=True, least=1, most=1000)] = 1


def _rows(data: Any) -> Any:
    return tuple(data) if isinstance(data, list) else data


class Platens(Table):
    """``[platens]``: the tools above and below, their motion and where it ends.

    ``width`` is along the filaments; ``bottom_width`` is the top's where not given. ``friction`` is that between
    filament and platen. ``cycles`` are earlier stops: the assembly is loaded to each and unloaded, till the platen
    feels nothing, before it is loaded to ``stop``, held there and (``unload``) unloaded.

    A crimped platen is a cylinder whose surface leans by ``crimp_angle`` at its edges: along the filaments at those of
    its width; in a section, which has no length, across them at half of ``crimp_width`` (auto: of the assembly's width
    as built) from the middle.
    """

    shape: Literal["flat", "crimped"] = "flat"
    width: FullLength = "full"
    bottom_width: Annotated[float | Literal["full"] | None, Value("um", words=("full",), above=0.0, most=1e7)] = None
    crimp_angle: Annotated[float | None, Value("rad", above=0.0, below=math.pi / 4.0)] = None
    crimp_side: Literal["both", "top"] = "both"
    crimp_width: AutoLength = "auto"
    curvature: Literal["convex", "concave"] = "convex"
    friction: Friction = 0.3
    speed: AutoSpeed = "auto"
    cycles: Annotated[tuple[Cycle, ...], BeforeValidator(_rows)] = ()
    stop: Stop
    hold: TimeOrZero = 0.0
    unload: bool = False

    @model_validator(mode="after")
    def _consistent(self) -> Platens:
        if self.shape == "crimped":
            if self.crimp_angle is None:
                raise refusal("crimp_angle", NOT_GIVEN, field_value(Platens, "crimp_angle").expected)
            return self
        for key in ("crimp_angle", "crimp_side", "crimp_width", "curvature"):
            if getattr(self, key) != type(self).model_fields[key].default:
                raise refusal(key, self._shown(key), "no such key with shape = 'flat' (or shape = 'crimped')")
        return self


class Contact(Table):
    """``[contact]``: between filaments.

    ``shape``: filaments touch along their segments (capsule, needs the plugin) or bead by bead. ``line_load`` is where
    the secant stiffness of the line contact is taken; ``softening`` divides that stiffness; ``damping_ratio`` is that
    of two beads or stretches on their contact. ``kinetic_friction``: that of filaments that slip, where it is less than
    the static one; ``friction_by_angle``: the static one against the angle at which filaments cross, in place of
    ``friction`` (with ``kinetic_friction`` over ``friction`` as its ratio). Both for capsules.

    Tows of a weave are soft across: law "linear" is a force per length of ``stiffness`` times the tow's modulus (its EA
    over its fibres' area) times the overlap; "exponential" rises to that slope at the overlap ``rise``; "table" is that
    of a CSV file, with columns overlap and force_per_length, or overlap and pressure (which acts on the area in which
    tows cross); a third column "unloading" gives the way back.
    """

    shape: Literal["auto", "capsule", "beads"] = "auto"
    friction: Friction = 0.2
    kinetic_friction: Annotated[float | None, Value(least=0.0, most=2.0)] = None
    friction_by_angle: Annotated[tuple[tuple[float, float], ...] | None, AngleTable()] = None
    law: Literal["auto", "hooke", "hertz", "line", "linear", "exponential", "table"] = "auto"
    stiffness: Annotated[float | None, Value(above=0.0, most=10.0)] = None
    rise: Annotated[float | None, Value("um", above=0.0, most=1e6)] = None
    table: Annotated[LawRows | None, LawText()] = None
    line_load: LineForce = 1.0e6  # 1 N/mm
    softening: AutoFactor = "auto"
    damping_ratio: Annotated[float | Literal["auto"], Value(words=("auto",), above=0.0, most=1.0)] = "auto"


class Model(Table):
    """``[model]``: how it is computed. ``resolve``: tows of a weave, or all their filaments.

    ``depth``, ``spring`` and ``torsional_spring`` belong to the section level.

    ``most_steps`` of loading bound what an automatic platen speed may cost, whatever accuracy asks for.
    """

    level: Literal["auto", "chain", "rod", "section", "subbundle"] = "auto"
    resolve: Literal["auto", "tow", "filament"] = "auto"
    spacing: AutoLength = "auto"
    accuracy: Annotated[float, Value(least=0.001, most=0.5)] = 0.05
    far_field: Literal["auto", "none", "graded", "condensed"] = "auto"
    symmetry: Literal["auto", "none", "half"] = "auto"
    axial_softening: AutoFactor = "auto"
    torsion: Literal["none", "dihedral"] = "none"
    timestep: AutoTime = "auto"
    most_steps: AutoSteps = "auto"
    speed_check: bool = False
    depth: AutoLength = "auto"
    spring: Literal["auto", "exact", "thesis", "elastica"] = "auto"
    torsional_spring: Literal["exact", "thesis", "none"] = "exact"

    @model_validator(mode="after")
    def _consistent(self) -> Model:
        section = ("depth", "spring", "torsional_spring")
        along = ("spacing", "axial_softening", "torsion", "symmetry")
        flat = self.level in FLAT
        for key in along if flat else section:
            if getattr(self, key) == type(self).model_fields[key].default:
                continue
            if flat:
                expected = f"no such key with level = {self.level!r}: a section has no filament length"
            else:
                expected = f"no such key with level = {self.level!r}: it belongs to level = 'section'"
            raise refusal(key, self._shown(key), expected)
        return self


class Output(Table):
    """``[output]``: frames and samples over the whole run; ``dump`` adds a text trajectory for OVITO."""

    frames: Annotated[int, Value(whole=True, least=2, most=5000)] = 60
    samples: Annotated[int, Value(whole=True, least=10, most=100_000)] = 300
    dump: bool = False


class Scene(Table):
    """A compaction experiment: what is asked, in engine units."""

    name: str = ""
    description: str = ""
    filament: Filament
    assembly: Annotated[Bundle | Weave, BeforeValidator(_assembly)]
    ends: Ends = Ends()
    cell: Cell | None = None
    platens: Platens
    contact: Contact = Contact()
    model: Model = Model()
    output: Output = Output()

    #: combinations of tables of a bundle and of a weave, checked in this order: the place for new ones
    CHECKS: ClassVar[tuple[Callable[[Scene], None], ...]] = ()
    WEAVE_CHECKS: ClassVar[tuple[Callable[[Scene], None], ...]] = ()

    @model_validator(mode="after")
    def _combinations(self) -> Scene:
        for check in self.WEAVE_CHECKS if isinstance(self.assembly, Weave) else self.CHECKS:
            check(self)
        return self

    @property
    def bundle(self) -> Bundle:
        """The assembly as a bundle; raises :class:`InputError` for a weave."""
        if not isinstance(self.assembly, Bundle):
            raise InputError("assembly.kind", self.assembly.kind, "'bundle'")
        return self.assembly

    @property
    def weave(self) -> Weave:
        """The assembly as a weave; raises :class:`InputError` for a bundle."""
        if not isinstance(self.assembly, Weave):
            raise InputError("assembly.kind", self.assembly.kind, "'weave'")
        return self.assembly

    @property
    def in_plane(self) -> Cell:
        """What happens to a weave in its plane."""
        return self.cell or Cell()

    @property
    def is_weave(self) -> bool:
        """Whether the assembly is woven."""
        return isinstance(self.assembly, Weave)

    def to_toml(self) -> str:
        """The scene resolved, every key written out; :func:`scene_from_dict` of it is an equal scene."""
        return tomli_w.dumps(self.model_dump(exclude_none=True), multiline_strings=True)


# --- combinations ----------------------------------------------------------------------------------------------------


def _length_um(value: float) -> str:
    """A length for a message, to four figures."""
    return f"{value:.4g} um"


def _pitch(scene: Scene) -> float:
    """Centre distance in um: as given, or p = D sqrt(pi / (2 sqrt(3) (1 - void))); D for random packing."""
    bundle, diameter = scene.bundle, scene.filament.diameter
    if bundle.pitch is not None:
        return bundle.pitch
    if bundle.void_fraction is None:
        return diameter
    return diameter * math.sqrt((1.0 - LEAST_VOID_FRACTION) / (1.0 - bundle.void_fraction))


def _height(scene: Scene) -> float:
    """Height as built in um: exact for circular rings, an upper bound for the other arrangements."""
    bundle, diameter, p = scene.bundle, scene.filament.diameter, _pitch(scene)
    if bundle.arrangement == "circular":
        top = 0.0
        for ring in range(1, full_rings(bundle.count) + 1):
            step = math.pi / (3 * ring)
            off = (bundle.first_angle - math.pi / 2.0) % step
            top = max(top, ring * p * math.cos(min(off, step - off)))
        return 2.0 * top + diameter
    if bundle.arrangement == "virtual":  # open: at worst a third of the ring locations are taken
        return 2.0 * p * (math.ceil(math.sqrt(bundle.count)) + 1) + diameter
    if bundle.centres is not None:  # clearing overlaps moves them by less than a diameter
        z = [z for _, z in bundle.centres]
        return max(z) - min(z) + 2.0 * diameter
    area = bundle.count * p * p * math.sqrt(3.0) / 2.0
    if bundle.fibre_volume_fraction is not None:
        area = bundle.count * math.pi * diameter**2 / (4.0 * bundle.fibre_volume_fraction)
    bound = 2.0 * math.sqrt(area / math.pi / (bundle.aspect or 1.0)) + 3.0 * p + diameter
    return min(bound, (bundle.count - 1) * p + diameter)


def _check_kind(scene: Scene) -> None:
    """What belongs to weaves alone."""
    if scene.cell is not None:
        raise refusal("cell", Abridged("{...}"), "no such table with assembly.kind = 'bundle': it belongs to a weave")
    if scene.model.resolve != "auto":
        expected = "no such key with assembly.kind = 'bundle': it belongs to a weave"
        raise refusal("model.resolve", scene.model.resolve, expected)
    if scene.contact.law in TOW_LAWS:
        expected = "'auto', 'hooke', 'hertz' or 'line' with assembly.kind = 'bundle': soft tows belong to a weave"
        raise refusal("contact.law", scene.contact.law, expected)
    for key in ("stiffness", "rise", "table"):
        if getattr(scene.contact, key) is not None:
            raise refusal(f"contact.{key}", Abridged("(given)"), "no such key: it belongs to the tows of a weave")


def _check_sizes(scene: Scene) -> None:
    bundle, diameter = scene.bundle, scene.filament.diameter
    if bundle.pitch is not None and bundle.pitch < diameter:
        raise refusal("assembly.pitch", bundle._shown("pitch"), f"at least the diameter, {_length_um(diameter)}")
    if bundle.length <= 4.0 * diameter:
        expected = f"more than four diameters, {_length_um(4.0 * diameter)}"
        raise refusal("assembly.length", bundle._shown("length"), expected)
    if bundle.migration is not None and bundle.migration.period < 4.0 * diameter:
        expected = f"at least four diameters, {_length_um(4.0 * diameter)}"
        raise refusal("assembly.migration.period", bundle.migration._shown("period"), expected)
    # half the gap keeps any two apart; a hundredth of the diameter is shallow even where they touch
    most = max(0.5 * (_pitch(scene) - diameter), 0.01 * diameter)
    if bundle.jitter > most:
        expected = f"at most {_length_um(most)}, beyond which filaments overlap as built"
        raise refusal("assembly.jitter", bundle._shown("jitter"), expected)


def _check_twist(scene: Scene) -> None:
    """A twisted filament's section is an ellipse in the cross-section: the pitch must leave room for it."""
    bundle, diameter, p = scene.bundle, scene.filament.diameter, _pitch(scene)
    if bundle.twist == 0.0 or bundle.count == 1:
        return
    outer = full_rings(bundle.count) * p
    if bundle.arrangement != "circular":
        aspect = bundle.aspect or 1.0
        outer = p * math.sqrt(bundle.count * math.sqrt(3.0) / (2.0 * math.pi) * max(aspect, 1.0 / aspect))
    if bundle.centres is not None:
        y0, z0 = (sum(c[k] for c in bundle.centres) / bundle.count for k in (0, 1))
        outer = max(math.hypot(y - y0, z - z0) for y, z in bundle.centres)
    as_found = bundle.arrangement in ("random", "file")
    lean = math.atan(2.0 * math.pi * outer * bundle.twist)
    if lean > math.pi / 4.0 or (not as_found and p * math.cos(lean) < diameter * (1.0 - 1e-6)):
        limit = math.pi / 4.0 if as_found else min(math.acos(diameter / p), math.pi / 4.0)
        most = units.format(float(f"{math.tan(limit) / (2.0 * math.pi * outer):.3g}"), "turn/um")
        expected = f"at most about {most}: outer filaments lean by {math.degrees(lean):.0f} deg and overlap as built"
        raise refusal("assembly.twist", bundle._shown("twist"), expected)


def _check_cell(scene: Scene) -> None:
    """A periodic cell joins every filament's end to its own start: only whole turns do."""
    bundle = scene.bundle
    if scene.ends.support != "symmetry":
        return
    if bundle.migration is not None:
        expected = "no such table with ends.support = 'symmetry': wandering filaments do not end where they began"
        raise refusal("assembly.migration", Abridged("{...}"), expected)
    turns = bundle.twist * bundle.length
    if abs(turns - round(turns)) > 1e-4:
        fits = units.format(float(f"{max(1, round(turns)) / bundle.length:.10g}"), "turn/um")
        expected = f"whole turns over the length with ends.support = 'symmetry' (such as {fits}), here {turns:.4g}"
        raise refusal("assembly.twist", bundle._shown("twist"), expected)


def _check_tension(scene: Scene) -> None:
    if scene.ends.tension > 0.05 * scene.filament.EA:
        most = units.format(float(f"{0.05 * scene.filament.EA:.3g}"), "nN")
        raise refusal("ends.tension", scene.ends._shown("tension"), f"at most {most} a filament, a strain of 5 %")
    softening = scene.model.axial_softening
    if softening != "auto" and scene.ends.tension * float(softening) > 0.05 * scene.filament.EA:
        most = f"{0.05 * scene.filament.EA / scene.ends.tension:.3g}"
        expected = f"'auto' or at most {most}: softened filaments would stretch by more than 5 % under ends.tension"
        raise refusal("model.axial_softening", softening, expected)


def _check_stop(scene: Scene) -> None:
    for i, cycle in enumerate(scene.platens.cycles):
        _check_one_stop(scene, f"platens.cycles.{i}", cycle)
    _check_one_stop(scene, "platens.stop", scene.platens.stop)


def _check_one_stop(scene: Scene, key: str, stop: Stop) -> None:
    diameter, height = scene.filament.diameter, _height(scene)
    # filaments can spread until they lie side by side, one diameter thick; a single one only dents
    thinnest = diameter if scene.bundle.count > 1 else 0.5 * diameter
    if stop.displacement is not None and stop.displacement > height - thinnest:
        expected = (
            f"at most {_length_um(height - thinnest)}: the bundle is {_length_um(height)} high and no thinner than "
            f"{_length_um(thinnest)}"
        )
        raise refusal(f"{key}.displacement", stop._shown("displacement"), expected)
    if stop.thickness is not None and not thinnest <= stop.thickness < height:
        expected = f"from {_length_um(thinnest)} (solid filaments side by side) to below the {_length_um(height)} built"
        raise refusal(f"{key}.thickness", stop._shown("thickness"), expected)


def _check_widths(scene: Scene) -> None:
    length, diameter = scene.bundle.length, scene.filament.diameter
    for key in ("width", "bottom_width"):
        value = getattr(scene.platens, key)
        if isinstance(value, float) and not diameter <= value < length:
            expected = (
                f"'full' or a length from one diameter, {_length_um(diameter)}, to below assembly.length, "
                f"{_length_um(length)}"
            )
            raise refusal(f"platens.{key}", scene.platens._shown(key), expected)


def _check_crimp(scene: Scene) -> None:
    """A crimped platen is curved along the filaments, over its width; in a section across them."""
    platens = scene.platens
    if platens.shape != "crimped" or scene.model.level == "section":
        return
    if platens.width == "full":
        expected = "a length such as '0.5 mm': the arc of a crimped platen has an end"
        raise refusal("platens.width", "full", expected)
    if platens.crimp_side == "both" and platens.bottom_width == "full":
        raise refusal("platens.bottom_width", "full", "a length such as '0.5 mm', or crimp_side = 'top'")
    if platens.crimp_width != "auto":
        expected = "no such key but with level = 'section': elsewhere platens.width is what is curved"
        raise refusal("platens.crimp_width", platens._shown("crimp_width"), expected)


def _check_spacing(scene: Scene) -> None:
    spacing, diameter, length = scene.model.spacing, scene.filament.diameter, scene.bundle.length
    alone = scene.bundle.count == 1 or scene.contact.shape != "beads"
    most = length / 4 if alone else diameter
    if isinstance(spacing, float) and not diameter / 20.0 <= spacing <= most:
        why = "a quarter of the length" if alone else "the diameter: beads further apart miss each other"
        expected = f"'auto' or a length from {_length_um(diameter / 20.0)} to {_length_um(most)}, {why}"
        raise refusal("model.spacing", scene.model._shown("spacing"), expected)


def _check_shape(scene: Scene) -> None:
    """Which laws go with which shape of contact."""
    shape, law, level = scene.contact.shape, scene.contact.law, scene.model.level
    if law == "hertz" and shape == "capsule":
        expected = "'auto', 'line' or 'hooke' with contact.shape = 'capsule': hertz is for beads"
        raise refusal("contact.law", law, expected)
    if law == "line" and (shape == "beads" or level in FLAT):
        where = "contact.shape = 'beads'" if shape == "beads" else f"level = {level!r}"
        raise refusal("contact.law", law, f"'auto', 'hooke' or 'hertz' with {where}: the line law is for capsules")
    if scene.contact.kinetic_friction is not None and scene.contact.kinetic_friction > scene.contact.friction:
        expected = f"at most contact.friction, {scene.contact.friction:g}"
        raise refusal("contact.kinetic_friction", scene.contact.kinetic_friction, expected)
    for key in ("kinetic_friction", "friction_by_angle"):
        if getattr(scene.contact, key) is not None and (shape == "beads" or level in FLAT or law == "hertz"):
            expected = "no such key: it belongs to contact.shape = 'capsule' and the levels chain and rod"
            raise refusal(f"contact.{key}", Abridged("(given)"), expected)
    if shape == "capsule" and level in FLAT:
        raise refusal("contact.shape", shape, f"'auto' or 'beads' with level = {level!r}: it is made of discs")


def _check_torsion(scene: Scene) -> None:
    if scene.model.torsion != "dihedral":
        return
    if scene.bundle.straight:
        expected = (
            "'none' for straight filaments: a dihedral is singular on a straight chain and follows the torsion of the "
            "centre line, not the twist of the material; use level = 'rod'"
        )
        raise refusal("model.torsion", "dihedral", expected)
    if scene.model.level != "chain":
        expected = (
            f"'none' with level = {scene.model.level!r}: dihedrals belong to level = 'chain', a rod twists itself"
        )
        raise refusal("model.torsion", "dihedral", expected)


def _check_far_field(scene: Scene) -> None:
    model, far = scene.model, scene.model.far_field
    if far not in ("graded", "condensed"):
        return

    def refuse(reason: str) -> PydanticCustomError:
        return refusal("model.far_field", far, f"'auto' or 'none': {reason}")

    if scene.platens.width == "full":
        raise refuse("platens.width = 'full' leaves nothing beyond the platen")
    if far == "condensed":
        if model.level not in ("auto", "chain"):
            raise refuse(f"'condensed' belongs to level = 'chain', not {model.level!r}")
        if scene.ends.support == "symmetry":
            raise refuse("'condensed' is the stiffness of a held end, ends.support = 'symmetry' holds none")
        if not scene.bundle.straight:
            raise refuse("'condensed' is the stiffness of a straight filament, these are twisted or migrate")


def _check_section(scene: Scene) -> None:
    """What needs a length along the filaments has no meaning in a section."""
    level = scene.model.level
    if level != "subbundle" and scene.bundle.subbundle is not None:
        expected = "no such table, but with model.level = 'subbundle'"
        raise refusal("assembly.subbundle", Abridged("{...}"), expected)
    if level not in FLAT:
        return
    bundle, none_along = scene.bundle, "a section has no length along the filaments (or level = 'chain' or 'rod')"
    if bundle.twist != 0.0:
        raise refusal("assembly.twist", bundle._shown("twist"), f"0: {none_along}")
    if bundle.migration is not None:
        raise refusal("assembly.migration", Abridged("{...}"), f"no such table: {none_along}")
    if scene.model.far_field in ("graded", "condensed"):
        raise refusal("model.far_field", scene.model.far_field, f"'auto' or 'none': {none_along}")
    periodic = scene.ends.support == "symmetry" and scene.platens.width == "full"
    if level == "subbundle" and scene.platens.shape != "flat":
        expected = "'flat' with model.level = 'subbundle' (or 'section', whose platens may be curved)"
        raise refusal("platens.shape", scene.platens.shape, expected)
    if scene.ends.support != "simply-supported" and not periodic:
        expected = (
            f"'simply-supported' with level = {level!r} (its springs are those of such filaments), or 'symmetry' with "
            "platens.width = 'full'"
        )
        raise refusal("ends.support", scene.ends.support, expected)
    if scene.contact.law == "hertz":
        expected = (
            f"'auto' or 'hooke' with level = {level!r}: parallel filaments touch along lines, hertz is for points"
        )
        raise refusal("contact.law", "hertz", expected)


def _check_woven(scene: Scene) -> None:
    """What a weave does not have, and what its tows need."""
    p, model, contact = scene.platens, scene.model, scene.contact
    if scene.ends != Ends():
        expected = "no such table with assembly.kind = 'weave': a cell has no ends (tension of tows: cell.tension)"
        raise refusal("ends", Abridged("{...}"), expected)
    if p.shape != "flat" or p.width != "full" or p.bottom_width not in (None, "full"):
        raise refusal("platens", Abridged("{...}"), "shape = 'flat' and width = 'full': platens cover all of a weave")
    if model.level in FLAT:
        expected = "'auto', 'chain' or 'rod' with assembly.kind = 'weave': its tows run along x and along y"
        raise refusal("model.level", model.level, expected)
    for key, usual in (("far_field", "none"), ("symmetry", "none"), ("torsion", None)):
        if getattr(model, key) not in (type(model).model_fields[key].default, usual):
            raise refusal(f"model.{key}", getattr(model, key), "no such key with assembly.kind = 'weave'")
    if contact.shape == "beads":
        expected = "'auto' or 'capsule': beads of crossing tows miss each other or ripple"
        if model.resolve == "tow":
            raise refusal("contact.shape", "beads", expected)
    laws: tuple[str, ...] = ("auto", *TOW_LAWS)
    if model.resolve == "filament":
        laws = ("auto", "hooke", "hertz", "line")
    elif model.resolve == "auto":
        laws += ("line", "hooke", "hertz")
    if contact.law not in laws:
        raise refusal("contact.law", contact.law, f"{one_of(laws)} with model.resolve = {model.resolve!r}")
    if (contact.law == "table") != (contact.table is not None):
        key, value = ("table", NOT_GIVEN) if contact.table is None else ("law", contact.law)
        expected = LawText.expected if contact.table is None else "'table', beside contact.table"
        raise refusal(f"contact.{key}", value, expected)
    if contact.rise is not None and contact.law != "exponential":
        raise refusal("contact.rise", contact._shown("rise"), "no such key: it belongs to law = 'exponential'")
    if contact.stiffness is not None and contact.law not in ("auto", "linear", "exponential"):
        expected = "no such key: it belongs to the laws 'linear' and 'exponential'"
        raise refusal("contact.stiffness", contact.stiffness, expected)
    if model.resolve == "filament":
        for name, tow in (("tow", scene.weave.tow), ("weft", scene.weave.weft)):
            if tow.filaments is None:
                expected = "a number of filaments with model.resolve = 'filament'"
                raise refusal(f"assembly.{name}.filaments", NOT_GIVEN, expected)


def _check_woven_stop(scene: Scene) -> None:
    stop = scene.platens.stop
    height = scene.weave.tow.thickness + scene.weave.weft.thickness + scene.weave.gap
    if stop.displacement is not None and stop.displacement >= height:
        expected = f"less than the thickness, {_length_um(height)}"
        raise refusal("platens.stop.displacement", stop._shown("displacement"), expected)
    if stop.thickness is not None and stop.thickness >= height:
        expected = f"less than the thickness as built, {_length_um(height)}"
        raise refusal("platens.stop.thickness", stop._shown("thickness"), expected)


def _check_in_plane(scene: Scene) -> None:
    """Strain and tension of one direction exclude each other; what belongs to one order of cell and platens alone."""
    cell = scene.in_plane
    for axis, tow in (("x", "warp"), ("y", "weft")):
        if getattr(cell.strain, axis) != 0 and getattr(cell.tension, tow) != 0:
            expected = f"0 N where cell.strain.{axis} is given: one follows from the other"
            raise refusal(f"cell.tension.{tow}", cell.tension._shown(tow), expected)
        if cell.when == "after" and cell.edges == "held" and getattr(cell.tension, tow) != 0:
            expected = "0 N, or edges = 'free', with when = 'after': tension begins from free edges, not from held ones"
            raise refusal(f"cell.tension.{tow}", cell.tension._shown(tow), expected)
    if cell.over != "auto" and cell.when != "during":
        expected = f"no such key with when = {cell.when!r}: it belongs to 'during'"
        raise refusal("cell.over", cell._shown("over"), expected)


Scene.WEAVE_CHECKS = (_check_woven, _check_woven_stop, _check_in_plane)
Scene.CHECKS = (
    _check_kind,
    _check_section,
    _check_shape,
    _check_sizes,
    _check_twist,
    _check_cell,
    _check_tension,
    _check_stop,
    _check_widths,
    _check_crimp,
    _check_spacing,
    _check_torsion,
    _check_far_field,
)
