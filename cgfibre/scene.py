"""What is asked: the TOML scene, validated, every quantity a float in engine units.

A scene is a set of tables (``[filament]``, ``[assembly]``, ``[ends]``, ``[platens]``, ``[contact]``, ``[model]``,
``[output]``), each a frozen model below; its fields are the keys. Quantities are text with a unit in TOML and plain
floats here (um, us, nN, kPa, rad, turn/um). Whatever is wrong becomes one :class:`cgfibre.errors.InputError` that names
the dotted key, the value and what was expected.
"""

from __future__ import annotations

import difflib
import math
import os
import re
import tomllib
from collections.abc import Callable, Iterable, Mapping, Sequence
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import tomli_w
from pydantic import BaseModel, BeforeValidator, ValidationError, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError

from cgfibre import units
from cgfibre.errors import InputError
from cgfibre.materials import MATERIALS, find_material, isotropic_shear_modulus
from cgfibre.scene_assembly import LEAST_VOID_FRACTION, Bundle, Cell, Weave, full_rings
from cgfibre.scene_values import (
    NOT_GIVEN,
    Abridged,
    AngleTable,
    AutoFactor,
    AutoLength,
    AutoSpeed,
    AutoSteps,
    AutoTime,
    CentresText,
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
from cgfibre.subbundle_law import shipped_laws

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
                    given[key] = _field_value(cls, key).write(getattr(library, key))
        if derive and "E2" in given and "nu23" in given:
            try:
                e2, nu23 = (_field_value(cls, key).read(given[key]) for key in ("E2", "nu23"))
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
        raise refusal("kind", kind, _one_of(ASSEMBLIES))
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
                raise refusal("crimp_angle", NOT_GIVEN, _field_value(Platens, "crimp_angle").expected)
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
        raise refusal("contact.law", contact.law, f"{_one_of(laws)} with model.resolve = {model.resolve!r}")
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
    """Strain and tension of one direction exclude each other; a patch is held."""
    cell = scene.in_plane
    if scene.weave.cell == "patch" and not cell.at_rest:
        expected = "no such table with assembly.cell = 'patch': its ends are held (or cell = 'periodic')"
        raise refusal("cell", Abridged("{...}"), expected)
    if cell.edges == "free" and cell.shear != 0:
        raise refusal("cell.edges", "free", "'held' with cell.shear: the tows' lengths decide the edges then")
    for axis, tow in (("x", "warp"), ("y", "weft")):
        if getattr(cell.strain, axis) != 0 and getattr(cell.tension, tow) != 0:
            expected = f"0 N where cell.strain.{axis} is given: one follows from the other"
            raise refusal(f"cell.tension.{tow}", cell.tension._shown(tow), expected)


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


# --- reading ---------------------------------------------------------------------------------------------------------

#: known to the interface, refused here
_LATER: dict[tuple[str, str], str] = {}

_STOP = tuple(f"platens.stop.{key}" for key in Stop.model_fields)
_PACKING = ("assembly.pitch", "assembly.void_fraction", "assembly.fibre_volume_fraction")
#: an override of the first drops the others where they are not overridden too
_SUPERSEDES: dict[str, tuple[str, ...]] = {
    **{key: tuple(k for k in group if k != key) for group in (_STOP, _PACKING) for key in group},
    "assembly.centres": ("assembly.count", *_PACKING, "assembly.first_angle", "assembly.aspect"),
    "filament.material": tuple(f"filament.{key}" for key in Filament.model_fields if key != "material"),
}


def load_scene(source: str | Path, overrides: Sequence[str] = ()) -> Scene:
    """The scene of a TOML file or of a shipped name, with overrides.

    ``assembly.centres`` may name a CSV file beside the scene's (in an override: from here); its numbers become part of
    the scene.

    ``overrides`` are "table.key=value" (nested tables too: ``platens.stop.displacement="30 um"``), the value being TOML
    or else bare text. One of several alternatives (how to stop, how to pack, a material for its constants) takes the
    place of the one that the scene gives. A file without a name is named after itself.
    Raises :class:`InputError` for whatever is wrong with the file, the overrides or the scene.
    """
    data = read_tables(source, overrides)
    if "capstan" in data:
        raise InputError("scene", str(source), f"a compaction scene; this is a friction test: cgfibre capstan {source}")
    return scene_from_dict(data)


def read_tables(source: str | Path, overrides: Sequence[str] = ()) -> dict[str, Any]:
    """The tables of a TOML file or of a shipped scene, named and with overrides, not yet validated."""
    text, name = _source(source)
    data = read_toml(text, "scene", str(source))
    data.setdefault("name", name)
    _insert_files(data, Path(source).parent)
    _insert_law(data, Path(source).parent)
    _override(data, overrides)
    _insert_files(data, Path())
    _insert_law(data, Path())
    return data


def read_toml(text: str, key: str, source: str) -> dict[str, Any]:
    """Tables of TOML text; InputError with the line that is wrong, for ``key`` and the ``source`` of the text."""
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise InputError(key, source, _toml_expectation(text, error)) from None


def joined_overrides(*groups: Sequence[str]) -> tuple[str, ...]:
    """Overrides of several groups as one: a later group's take the place of the same keys, and of the alternatives that
    they replace, in earlier ones; InputError for a text that is no override."""
    joined: dict[str, str] = {}
    for group in groups:
        new = {_override_parts(text)[0]: text for text in group}
        for key in new:
            for other in (key, *_SUPERSEDES.get(key, ())):
                joined.pop(other, None)
        joined |= new
    return tuple(joined.values())


def scene_from_dict(data: Mapping[str, Any]) -> Scene:
    """The scene of nested tables, quantities as text with units; raises :class:`InputError` for the first thing wrong.

    Keys whose value is ``None`` count as not given.
    """
    return validated(Scene, data)


def validated(kind: type[T], data: Mapping[str, Any]) -> T:
    """A scene of the ``kind`` from nested tables; raises :class:`InputError` for the first thing wrong."""
    try:
        return kind.model_validate(_without_none(data))
    except ValidationError as error:
        raise _translated(error, kind) from None


def shipped_scenes() -> list[str]:
    """Names of the scenes that come with the package, in natural order."""
    files = resources.files("cgfibre").joinpath("scenes").iterdir()
    names = [f.name.removesuffix(".toml") for f in files if f.name.endswith(".toml")]
    return sorted(names, key=_natural)


def scene_description(name: str) -> str:
    """What a shipped scene says of itself, whatever test it is of."""
    return str(tomllib.loads(scene_text(name)).get("description", ""))


def scene_text(name: str) -> str:
    """The TOML of a shipped scene, comments and all; raises :class:`InputError` for an unknown name."""
    if name not in shipped_scenes():
        raise InputError("scene", name, "the name of a shipped scene" + meant(name, shipped_scenes()))
    return resources.files("cgfibre").joinpath("scenes", f"{name}.toml").read_text(encoding="utf-8")


def _natural(name: str) -> list[tuple[int, str]]:
    """Numbers in a name by their value, 12k being 12000."""
    parts = re.findall(r"(\d+)(k?)|(\D+?(?=\d|$))", name)
    return [(int(number) * (1000 if thousand else 1) if number else 0, text) for number, thousand, text in parts]


def _source(source: str | Path) -> tuple[str, str]:
    """Text of a scene and the name that it goes by."""
    if isinstance(source, str) and source in shipped_scenes():
        return scene_text(source), source
    path = Path(source)
    try:
        return path.read_text(encoding="utf-8-sig"), path.stem
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "not a text file"
    expected = f"a TOML file that can be read ({reason.lower()})"
    if isinstance(source, str) and path.suffix != ".toml" and os.sep not in source:
        expected = f"a TOML file or a shipped scene{meant(source, shipped_scenes()) or ' (cgfibre scenes lists them)'}"
    raise InputError("scene", str(source), expected)


#: keys whose text may stand in a file beside the scene's, and what is expected of it
_FILES = {
    ("assembly", "centres"): CentresText.expected,
    ("assembly", "texgen"): "a .tg3 file of TexGen",
    ("contact", "table"): LawText.expected,
}


def _insert_files(data: dict[str, Any], folder: Path) -> None:
    """Put the text of the files that keys name in their place."""
    for (name, key), expected in _FILES.items():
        table = data.get(name)
        if not isinstance(table, dict):
            continue
        named = table.get(key)
        if not isinstance(named, str) or "\n" in named or not named:
            continue
        try:
            text = (folder / named).read_text(encoding="utf-8-sig")
        except (OSError, ValueError) as error:
            reason = error.strerror if isinstance(error, OSError) and error.strerror else "not a text file"
            raise InputError(f"{name}.{key}", named, f"{expected} ({reason.lower()})") from None
        data[name] = {**table, key: text.strip() + "\n"}


def _insert_law(data: dict[str, Any], folder: Path) -> None:
    """Put the text of the file that assembly.subbundle.law names in its place."""
    assembly = data.get("assembly")
    table = assembly.get("subbundle") if isinstance(assembly, dict) else None
    named = table.get("law") if isinstance(table, dict) else None
    if not isinstance(table, dict) or not isinstance(named, str) or "\n" in named or named in shipped_laws():
        return
    try:
        table["law"] = (folder / named).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "not a text file"
        expected = f"a sub-bundle law: a file that can be read ({reason.lower()}) or {_one_of(shipped_laws())}"
        raise InputError("assembly.subbundle.law", named, expected) from None


def _toml_expectation(text: str, error: tomllib.TOMLDecodeError) -> str:
    """What is wrong with the TOML, with the line it is on."""
    message = str(error)
    at = re.search(r"at line (\d+)", message)
    lines = text.splitlines()
    line = int(at[1]) if at else len(lines)
    shown = f", line {line}: {lines[line - 1].strip()[:60]!r}" if 0 < line <= len(lines) else ""
    reason = message[:1].lower() + re.sub(r" \(at [^()]*\)$", "", message)[1:]
    return " ".join(f"valid TOML{shown}: {reason} (text and quantities stand in quotes)".split())


def _override(data: dict[str, Any], overrides: Sequence[str]) -> None:
    given = {}
    for text in overrides:
        key, value = _override_parts(text)
        given[key] = _toml_value(value)
    for key, value in given.items():
        for other in _SUPERSEDES.get(key, ()):
            if other not in given:
                _table(data, other)[0].pop(other.rpartition(".")[2], None)
        table, last = _table(data, key, make=True)
        table[last] = value


def _override_parts(text: str) -> tuple[str, str]:
    """Key and value of an override."""
    key, equals, value = (part.strip() for part in text.partition("="))
    if not equals or not re.fullmatch(r"\w+(\.\w+)*", key):
        raise InputError("--set", text, 'table.key=value, such as filament.diameter="9 um"')
    return key, value


def _toml_value(text: str) -> Any:
    try:
        parsed = tomllib.loads(f"value = {text}")
    except tomllib.TOMLDecodeError:
        return text
    return parsed["value"] if len(parsed) == 1 else text


def _table(data: dict[str, Any], key: str, make: bool = False) -> tuple[dict[str, Any], str]:
    """The table that holds a dotted key, and the key's last part; an empty table where there is none."""
    *parents, last = key.split(".")
    for i, parent in enumerate(parents):
        data = data.setdefault(parent, {}) if make else data.get(parent, {})
        if not isinstance(data, dict):
            where = ".".join(parents[: i + 1])
            raise InputError(key, _shown_value(data), f"a known key: {where} is not a table")
    return data, last


def _without_none(data: Mapping[str, Any]) -> dict[str, Any]:
    return {k: _without_none(v) if isinstance(v, Mapping) else v for k, v in data.items() if v is not None}


# --- what pydantic found, in our words -------------------------------------------------------------------------------


def _field_value(model: type[BaseModel], key: str) -> Value:
    return next(m for m in model.model_fields[key].metadata if isinstance(m, Value))


def _translated(error: ValidationError, root: type[BaseModel]) -> InputError:
    """The first error, but a misspelt key before the one that is missed for it."""
    found = error.errors(include_url=False)
    return _input_error(min(found, key=lambda e: e["type"] != "extra_forbidden"), root)


def _input_error(error: ErrorDetails, root: type[BaseModel]) -> InputError:
    loc = [str(part) for part in error["loc"]]
    context = error.get("ctx", {})
    # a quoted TOML key can hold anything
    key, value = ".".join(part if re.fullmatch(r"[\w-]+", part) else repr(part) for part in loc), error["input"]
    if error["type"] == "refused":
        inner = context["key"]
        return InputError(".".join(p for p in (key, inner) if p), _shown_value(context["value"]), context["expected"])
    if error["type"] == "extra_forbidden":
        return InputError(key, _shown_value(value), "a known key" + _meant_key(loc, root))
    if error["type"] == "missing":
        value = NOT_GIVEN
        if loc[0] == "filament" and len(loc) == 2:
            return InputError(key, value, f"{_expected(loc, root)} (or filament.material = {_one_of(MATERIALS)})")
    return InputError(key, _shown_value(value), _expected(loc, root) + _later(key, value))


def _expected(loc: Sequence[str], root: type[BaseModel]) -> str:
    """What a key takes, from its field."""
    field = _field(loc, root)
    if field is None:
        return "a table of keys"
    for metadata in field.metadata:
        expected = getattr(metadata, "expected", None)
        if isinstance(expected, str):
            return expected
    if _models(field):
        return f"a table [{'.'.join(loc)}]"
    choices = getattr(field.annotation, "__args__", ())
    if field.annotation is bool:
        return "true or false"
    if choices and all(isinstance(c, str) for c in choices):
        return _one_of(choices)
    return "text in quotes"


def _field(loc: Sequence[str], root: type[BaseModel]) -> FieldInfo | None:
    models: list[type[BaseModel]] = [root]
    field = None
    for key in loc:
        if key.isdigit():  # a place in a list of tables
            continue
        field = next((m.model_fields[key] for m in models if key in m.model_fields), None)
        if field is None:
            return None
        models = _models(field)
    return field


def _models(field: FieldInfo) -> list[type[BaseModel]]:
    """The tables that a field may hold."""
    kinds = (field.annotation, *getattr(field.annotation, "__args__", ()))
    return [kind for kind in kinds if isinstance(kind, type) and issubclass(kind, BaseModel)]


def _meant_key(loc: Sequence[str], root: type[BaseModel]) -> str:
    """The key of that name in another table, or the one of the same table that looks most alike."""
    *parents, last = loc
    parent = _field(parents, root) if parents else None
    models = _models(parent) if parent is not None else [] if parents else [root]
    meant = [key for key in _all_keys(root) if key.rpartition(".")[2] == last]
    if not meant:
        near = difflib.get_close_matches(last, [key for m in models for key in m.model_fields], n=1)
        meant = [".".join([*parents, key]) for key in near]
    return f" (did you mean {' or '.join(meant)}?)" if meant else ""


def _all_keys(model: type[BaseModel], prefix: str = "") -> list[str]:
    keys = []
    for key, field in model.model_fields.items():
        keys.append(prefix + key)
        for inner in _models(field):
            keys += _all_keys(inner, f"{prefix}{key}.")
    return keys


def meant(name: str, names: Iterable[str]) -> str:
    """ " (did you mean ...?)", or nothing where no name looks alike."""
    near = difflib.get_close_matches(name, list(names), n=3)
    return f" (did you mean {' or '.join(near)}?)" if near else ""


def _later(key: str, value: object) -> str:
    reason = _LATER.get((key, value)) if isinstance(value, str) else None
    return f" ({reason})" if reason else ""


def _one_of(words: Iterable[str]) -> str:
    quoted = [repr(w) for w in words]
    return quoted[0] if len(quoted) == 1 else f"{', '.join(quoted[:-1])} or {quoted[-1]}"


def _shown_value(value: object) -> object:
    """The value, abridged where its text would fill the line."""
    text = repr(value)
    return value if len(text) <= 60 else Abridged(text[:56] + " ...")
