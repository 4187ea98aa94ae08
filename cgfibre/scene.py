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
from contextlib import suppress
from importlib import resources
from pathlib import Path
from typing import Annotated, Any, ClassVar, Literal, TypeVar

import tomli_w
from pydantic import BaseModel, BeforeValidator, ConfigDict, ValidationError, model_validator
from pydantic.fields import FieldInfo
from pydantic_core import ErrorDetails, PydanticCustomError

from cgfibre import units
from cgfibre.errors import InputError
from cgfibre.materials import MATERIALS, find_material, isotropic_shear_modulus
from cgfibre.scene_values import (
    NOT_GIVEN,
    Abridged,
    Angle,
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
    Length,
    LengthOrZero,
    LineForce,
    Modulus,
    PoissonRatio,
    TimeOrZero,
    Twist,
    Value,
    refusal,
)
from cgfibre.subbundle_law import find_law, shipped_laws

#: void fraction of touching filaments in hexagonal order, 1 - pi / (2 sqrt 3)
LEAST_VOID_FRACTION = 1.0 - math.pi / (2.0 * math.sqrt(3.0))

#: levels of a cross-section, which have no length along the filaments
FLAT = ("section", "subbundle")

T = TypeVar("T", bound=BaseModel)


class _Table(BaseModel):
    """A table of the scene: no other keys than its fields, never changed once made."""

    model_config = ConfigDict(frozen=True, extra="forbid", strict=True)

    def _shown(self, key: str) -> object:
        """The value of a field as the scene writes it."""
        return self.model_dump(include={key})[key]


#: for the scenes of other tests, which have tables of their own
Table = _Table


class Filament(_Table):
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


class Migration(_Table):
    """``[assembly.migration]``: filaments that wander in radius along their length (thesis Eqs 2-1, 2-2).

    ``period`` is the length of one wander out and back; ``minimum_radius`` the least radius over the bundle's;
    ``epsilon`` and ``beta`` the parameters of the packing probability p(R), Eq 2-1.
    """

    period: Length
    minimum_radius: Annotated[float, Value(least=0.0, below=1.0)] = 0.0
    epsilon: Annotated[float, Value(least=0.0, most=0.5)] = 0.05
    beta: Annotated[float, Value(least=0.0, most=100.0)] = 0.3


class Subbundle(_Table):
    """``[assembly.subbundle]`` of level "subbundle".

    How many ``filaments`` one disc stands for (about: as many discs as the arrangement takes), by which ``law`` (a
    shipped one's name, or a file that ``cgfibre homogenise`` wrote) and ``mapping`` they touch, and the ``spread`` of
    their stiffness, evenly over +- that part, dealt out with the seed.
    """

    filaments: Annotated[int, Value(whole=True, least=2, most=100_000)] = 127
    law: str = "carbon-127"
    mapping: Literal["contact", "lattice"] = "contact"
    spread: Annotated[float, Value(least=0.0, most=0.5)] = 0.1

    @model_validator(mode="after")
    def _readable(self) -> Subbundle:
        try:
            find_law(self.law)
        except InputError as error:
            raise refusal("law", Abridged(repr(self.law[:40])), f"a sub-bundle law: {error}") from None
        return self


class Bundle(_Table):
    """``[assembly]`` of kind "bundle": filaments side by side.

    Regular arrangements take their centre distance from ``pitch`` or from ``void_fraction`` (hexagonal relation, 0.31
    if neither is given), the random one takes ``fibre_volume_fraction``. ``aspect`` is width over height. The
    arrangement "file" takes ``centres``, such as those found in a micrograph; ``count`` is then theirs.
    """

    kind: Literal["bundle"] = "bundle"
    count: Annotated[int, Value(whole=True, least=1, most=10_000_000)]
    arrangement: Literal[
        "circular", "hexagonal", "rectangular", "elliptic", "racetrack", "virtual", "random", "file"
    ] = "circular"
    centres: Annotated[tuple[tuple[float, float], ...] | None, CentresText()] = None
    pitch: Annotated[float | None, Value("um", above=0.0, most=1e7)] = None
    void_fraction: Annotated[float | None, Value(least=LEAST_VOID_FRACTION, most=0.95)] = None
    fibre_volume_fraction: Annotated[float | None, Value(least=0.05, most=0.80)] = None
    first_angle: Angle = 0.0
    aspect: Annotated[float | None, Value(least=1e-3, most=1e3)] = None
    length: Length
    twist: Twist = 0.0
    twist_direction: Literal["Z", "S"] = "Z"
    twist_state: Literal["stress-free", "tensioned"] = "stress-free"
    migration: Migration | None = None
    jitter: LengthOrZero = 0.0
    seed: Annotated[int, Value(whole=True, least=0, most=2**31 - 1)] = 0
    subbundle: Subbundle | None = None

    @model_validator(mode="before")
    @classmethod
    def _fill(cls, data: Any) -> Any:
        packing = ("pitch", "void_fraction", "fibre_volume_fraction")
        if isinstance(data, dict) and data.get("arrangement") == "file":
            if "count" in data or "centres" not in data:
                return {"count": 1, **data}  # centres that are not there are named by a check of their own
            with suppress(PydanticCustomError):  # named by its own field
                return {**data, "count": len(CentresText().read(data["centres"]))}
            return {"count": 1, **data}
        if isinstance(data, dict) and data.get("arrangement") != "random" and not any(key in data for key in packing):
            return {**data, "void_fraction": 0.31}
        return data

    @model_validator(mode="after")
    def _consistent(self) -> Bundle:
        if self.arrangement == "file":
            self._check_file()
        elif self.centres is not None:
            expected = f"no such key: {self.arrangement} packing places the filaments itself (or arrangement = 'file')"
            raise refusal("centres", Abridged("(given)"), expected)
        elif self.arrangement == "random":
            for key in ("pitch", "void_fraction"):
                if getattr(self, key) is not None:
                    raise refusal(key, self._shown(key), "no such key: random packing takes fibre_volume_fraction")
            if self.fibre_volume_fraction is None:
                raise refusal("fibre_volume_fraction", NOT_GIVEN, "a number, at least 0.05 and at most 0.8")
        elif self.fibre_volume_fraction is not None:
            expected = f"no such key: {self.arrangement} packing takes pitch or void_fraction"
            raise refusal("fibre_volume_fraction", self.fibre_volume_fraction, expected)
        elif self.pitch is not None and self.void_fraction is not None:
            raise refusal("pitch", self._shown("pitch"), "either pitch or void_fraction, not both")
        if self.arrangement == "circular":
            self._check_rings()
        elif self.first_angle != 0.0:
            expected = f"no such key: it turns the rings of a circular arrangement, this one is {self.arrangement}"
            raise refusal("first_angle", self._shown("first_angle"), expected)
        if self.aspect is not None and self.arrangement in ("circular", "hexagonal", "virtual", "random", "file"):
            expected = f"no such key: it shapes rectangular, elliptic and racetrack, this one is {self.arrangement}"
            raise refusal("aspect", self.aspect, expected)
        return self

    def _check_file(self) -> None:
        if self.centres is None:
            raise refusal("centres", NOT_GIVEN, CentresText.expected)
        for key in ("pitch", "void_fraction", "fibre_volume_fraction"):
            if getattr(self, key) is not None:
                raise refusal(key, self._shown(key), "no such key: the centres are those of assembly.centres")
        if self.count != len(self.centres):
            raise refusal("count", self.count, f"{len(self.centres)}, the number of centres (or no count)")

    def _check_rings(self) -> None:
        n = _rings(self.count)
        fewer, more = (1 + 3 * k * (k + 1) for k in (n, n + 1))
        if self.count != fewer:
            expected = f"full rings, 1 + 3 n (n + 1) filaments: {fewer} or {more} (or another arrangement)"
            raise refusal("count", self.count, expected)

    @property
    def straight(self) -> bool:
        """Whether filaments run straight along x."""
        return self.twist == 0.0 and self.migration is None


#: kind -> table; the place where a weave will stand
ASSEMBLIES: dict[str, type[Bundle]] = {"bundle": Bundle}


def _assembly(data: Any) -> Any:
    if not isinstance(data, dict):
        return data
    kind = data.get("kind", "bundle")
    if not isinstance(kind, str) or kind not in ASSEMBLIES:
        expected = _one_of(ASSEMBLIES) + _later("assembly.kind", kind)
        raise refusal("kind", kind, expected)
    return ASSEMBLIES[kind].model_validate(data)


class Ends(_Table):
    """``[ends]``: how filaments are held, and the tension on each."""

    support: Literal["simply-supported", "clamped", "symmetry"] = "simply-supported"
    tension: ForceOrZero = 4.0e5  # 0.04 cN


class Stop(_Table):
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


class Platens(_Table):
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


class Contact(_Table):
    """``[contact]``: between filaments.

    ``shape``: filaments touch along their segments (capsule, needs the plugin) or bead by bead. ``line_load`` is where
    the secant stiffness of the line contact is taken; ``softening`` divides that stiffness; ``damping_ratio`` is that
    of two beads or stretches on their contact. ``kinetic_friction``: that of filaments that slip, where it is less than
    the static one; ``friction_by_angle``: the static one against the angle at which filaments cross, in place of
    ``friction`` (with ``kinetic_friction`` over ``friction`` as its ratio). Both for capsules.
    """

    shape: Literal["auto", "capsule", "beads"] = "auto"
    friction: Friction = 0.2
    kinetic_friction: Annotated[float | None, Value(least=0.0, most=2.0)] = None
    friction_by_angle: Annotated[tuple[tuple[float, float], ...] | None, AngleTable()] = None
    law: Literal["auto", "hooke", "hertz", "line"] = "auto"
    line_load: LineForce = 1.0e6  # 1 N/mm
    softening: AutoFactor = "auto"
    damping_ratio: Annotated[float | Literal["auto"], Value(words=("auto",), above=0.0, most=1.0)] = "auto"


class Model(_Table):
    """``[model]``: how it is computed. ``depth``, ``spring`` and ``torsional_spring`` belong to the section level.

    ``most_steps`` of loading bound what an automatic platen speed may cost, whatever accuracy asks for.
    """

    level: Literal["auto", "chain", "rod", "section", "subbundle"] = "auto"
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


class Output(_Table):
    """``[output]``: frames and samples over the whole run; ``dump`` adds a text trajectory for OVITO."""

    frames: Annotated[int, Value(whole=True, least=2, most=5000)] = 60
    samples: Annotated[int, Value(whole=True, least=10, most=100_000)] = 300
    dump: bool = False


class Scene(_Table):
    """A compaction experiment: what is asked, in engine units."""

    name: str = ""
    description: str = ""
    filament: Filament
    assembly: Annotated[Bundle, BeforeValidator(_assembly)]
    ends: Ends = Ends()
    platens: Platens
    contact: Contact = Contact()
    model: Model = Model()
    output: Output = Output()

    #: combinations of tables, checked in this order: the place for new ones
    CHECKS: ClassVar[tuple[Callable[[Scene], None], ...]] = ()

    @model_validator(mode="after")
    def _combinations(self) -> Scene:
        for check in self.CHECKS:
            check(self)
        return self

    def to_toml(self) -> str:
        """The scene resolved, every key written out; :func:`scene_from_dict` of it is an equal scene."""
        return tomli_w.dumps(self.model_dump(exclude_none=True), multiline_strings=True)


# --- combinations ----------------------------------------------------------------------------------------------------


def _length_um(value: float) -> str:
    """A length for a message, to four figures."""
    return f"{value:.4g} um"


def _rings(count: int) -> int:
    """Number of full rings that ``count`` filaments fill."""
    return (math.isqrt(12 * count - 3) - 3) // 6


def _pitch(scene: Scene) -> float:
    """Centre distance in um: as given, or p = D sqrt(pi / (2 sqrt(3) (1 - void))); D for random packing."""
    bundle, diameter = scene.assembly, scene.filament.diameter
    if bundle.pitch is not None:
        return bundle.pitch
    if bundle.void_fraction is None:
        return diameter
    return diameter * math.sqrt((1.0 - LEAST_VOID_FRACTION) / (1.0 - bundle.void_fraction))


def _height(scene: Scene) -> float:
    """Height as built in um: exact for circular rings, an upper bound for the other arrangements."""
    bundle, diameter, p = scene.assembly, scene.filament.diameter, _pitch(scene)
    if bundle.arrangement == "circular":
        top = 0.0
        for ring in range(1, _rings(bundle.count) + 1):
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


def _check_sizes(scene: Scene) -> None:
    bundle, diameter = scene.assembly, scene.filament.diameter
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
    bundle, diameter, p = scene.assembly, scene.filament.diameter, _pitch(scene)
    if bundle.twist == 0.0 or bundle.count == 1:
        return
    outer = _rings(bundle.count) * p
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
    bundle = scene.assembly
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
    thinnest = diameter if scene.assembly.count > 1 else 0.5 * diameter
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
    length, diameter = scene.assembly.length, scene.filament.diameter
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
    spacing, diameter, length = scene.model.spacing, scene.filament.diameter, scene.assembly.length
    alone = scene.assembly.count == 1 or scene.contact.shape != "beads"
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
    if scene.assembly.straight:
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
        if not scene.assembly.straight:
            raise refuse("'condensed' is the stiffness of a straight filament, these are twisted or migrate")


def _check_section(scene: Scene) -> None:
    """What needs a length along the filaments has no meaning in a section."""
    level = scene.model.level
    if level != "subbundle" and scene.assembly.subbundle is not None:
        expected = "no such table, but with model.level = 'subbundle'"
        raise refusal("assembly.subbundle", Abridged("{...}"), expected)
    if level not in FLAT:
        return
    bundle, none_along = scene.assembly, "a section has no length along the filaments (or level = 'chain' or 'rod')"
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


Scene.CHECKS = (
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
_LATER: dict[tuple[str, str], str] = {
    ("assembly.kind", "weave"): "woven fabrics are not in this version",
}

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
    _insert_centres(data, Path(source).parent)
    _insert_law(data, Path(source).parent)
    _override(data, overrides)
    _insert_centres(data, Path())
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


def _insert_centres(data: dict[str, Any], folder: Path) -> None:
    """Put the text of the file that assembly.centres names in its place."""
    table = data.get("assembly")
    if not isinstance(table, dict):
        return
    named = table.get("centres")
    if not isinstance(named, str) or "\n" in named:
        return
    try:
        text = (folder / named).read_text(encoding="utf-8-sig")
    except (OSError, ValueError) as error:
        reason = error.strerror if isinstance(error, OSError) and error.strerror else "not a text file"
        raise InputError("assembly.centres", named, f"{CentresText.expected} ({reason.lower()})") from None
    data["assembly"] = {**table, "centres": text.strip() + "\n"}


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
    if _model(field) is not None:
        return f"a table [{'.'.join(loc)}]"
    choices = getattr(field.annotation, "__args__", ())
    if field.annotation is bool:
        return "true or false"
    if choices and all(isinstance(c, str) for c in choices):
        return _one_of(choices)
    return "text in quotes"


def _field(loc: Sequence[str], root: type[BaseModel]) -> FieldInfo | None:
    model: type[BaseModel] | None = root
    field = None
    for key in loc:
        if key.isdigit():  # a place in a list of tables
            continue
        field = model.model_fields.get(key) if model is not None else None
        if field is None:
            return None
        model = _model(field)
    return field


def _model(field: FieldInfo) -> type[BaseModel] | None:
    """The table that a field holds, if it does."""
    for kind in (field.annotation, *getattr(field.annotation, "__args__", ())):
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind
    return None


def _meant_key(loc: Sequence[str], root: type[BaseModel]) -> str:
    """The key of that name in another table, or the one of the same table that looks most alike."""
    *parents, last = loc
    parent = _field(parents, root) if parents else None
    model = _model(parent) if parent is not None else root if not parents else None
    meant = [key for key in _all_keys(root) if key.rpartition(".")[2] == last]
    if not meant:
        near = difflib.get_close_matches(last, model.model_fields if model is not None else (), n=1)
        meant = [".".join([*parents, key]) for key in near]
    return f" (did you mean {' or '.join(meant)}?)" if meant else ""


def _all_keys(model: type[BaseModel], prefix: str = "") -> list[str]:
    keys = []
    for key, field in model.model_fields.items():
        keys.append(prefix + key)
        inner = _model(field)
        keys += _all_keys(inner, f"{prefix}{key}.") if inner is not None else []
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
