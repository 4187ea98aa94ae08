"""A bundle of filaments as one FilamentSystem: section, jitter, path, stations, prestrain, box."""

from __future__ import annotations

import hashlib
from dataclasses import asdict, dataclass
from typing import Any, Literal

import numpy as np
from scipy.spatial import cKDTree

from cgfibre.build import curves
from cgfibre.build.packing import ArrangementSpec, arrange, min_distance
from cgfibre.build.spacing import SpacingSpec, stations
from cgfibre.build.system import FilamentSystem, FilamentType, FloatArray
from cgfibre.errors import InputError


def filament_type(
    diameter: float, E1: float, G12: float, density: float, shear_coefficient: float = 0.9
) -> FilamentType:
    """Section constants of a solid round filament.

    A = pi D^2/4; EA = E1 A; EI = E1 pi D^4/64; GJ = G12 pi D^4/32; kGA = k G12 A; mass per length = density A.
    ``diameter`` um, ``E1`` and ``G12`` kPa, ``density`` pg/um3 (1000 kg/m3 = 1). The thesis' printed "EI" of
    1.18e-10 N mm2 is I in mm4, and its Eq. 7-2 takes G23 where G12 belongs; pass G23 here to follow it.
    Raises :class:`InputError` for a value not above 0.
    """
    given = {"diameter": diameter, "E1": E1, "G12": G12, "density": density, "shear_coefficient": shear_coefficient}
    for key, value in given.items():
        if not (np.isfinite(value) and value > 0.0):
            raise InputError(f"filament.{key}", value, "a finite number above 0")
    area = np.pi * diameter**2 / 4.0
    return FilamentType(
        diameter=diameter,
        EA=E1 * area,
        EI=E1 * np.pi * diameter**4 / 64.0,
        GJ=G12 * np.pi * diameter**4 / 32.0,
        kGA=shear_coefficient * G12 * area,
        mass_per_length=density * area,
    )


@dataclass(frozen=True, eq=False)
class BundleSpec:
    """What is asked of a bundle (not comparable by ``==``: it may hold arrays).

    Attributes
    ----------
    filament : section constants
    section : an arrangement, or filament centres (n, 2) um of (y, z), which stand at mid-length
    stations : spacing along x, or the stations (m,) um themselves, rising from 0; ``None`` is for a section only
    twist : turns per um, positive Z (right-handed), negative S; see :mod:`cgfibre.build.curves`
    twist_state : "stress-free", every filament's natural shape is the one built (prestrain 0); "tensioned", all are cut
        to the bundle's own length L, so that prestrain = arc length / L - 1
    migration : how filaments change their radius, or ``None``
    jitter : um, radius of the disc of random shifts of each filament in y, z
    tow : index given to all filaments
    box_half_width : um, half the box across y; ``None`` takes the default of :func:`build_bundle`
    """

    filament: FilamentType
    section: ArrangementSpec | FloatArray
    stations: SpacingSpec | FloatArray | None = None
    twist: float = 0.0
    twist_state: Literal["stress-free", "tensioned"] = "stress-free"
    migration: curves.MigrationSpec | None = None
    jitter: float = 0.0
    tow: int = 0
    box_half_width: float | None = None

    def __post_init__(self) -> None:
        if not np.isfinite(self.twist):
            raise InputError("bundle.twist", self.twist, "a finite number of turns per um")
        if self.twist_state not in ("stress-free", "tensioned"):
            raise InputError("bundle.twist_state", self.twist_state, "'stress-free' or 'tensioned'")
        if not (np.isfinite(self.jitter) and self.jitter >= 0.0):
            raise InputError("bundle.jitter", self.jitter, "a finite length of at least 0 um")
        if isinstance(self.section, np.ndarray):
            shape = self.section.shape
            if len(shape) != 2 or shape[1] != 2 or shape[0] < 1 or not np.all(np.isfinite(self.section)):
                raise InputError("bundle.section", shape, "finite centres of shape (n, 2), n at least 1")
        if isinstance(self.stations, np.ndarray):
            x = self.stations
            if x.ndim != 1 or len(x) < 2 or x[0] != 0.0 or not np.all(np.diff(x) > 0.0) or not np.isfinite(x[-1]):
                raise InputError("bundle.stations", x.shape, "at least two finite stations that rise from 0")


def build_bundle(spec: BundleSpec, rng: np.random.Generator) -> FilamentSystem:
    """The bundle as chains of beads, one at each station of each filament, filament after filament.

    The generator is used in this order: section, jitter, migration. The box is not periodic and leaves room: in x and z
    one diameter beyond the outermost beads' surfaces; in y as wide as all filaments side by side (count D), but four
    times the width as built at most (a platen squeezes the bundle sideways), and at least one diameter beyond.
    Provenance (JSON): the spec, the generator's seed, and what was measured: the largest overlap, jitter r.m.s., helix
    angle, mean range of radius over which filaments migrate, and turn per bond (a large turn: chords cut the helix'
    corners, harmless where nothing touches).
    Raises :class:`InputError` without stations, for centres that overlap, and for a migration whose overlap exceeds
    ``migration.max_overlap``.
    """
    if spec.stations is None:
        raise InputError("bundle.stations", None, "a spacing or stations (build_section needs none)")
    seed = _seed(rng)
    x = stations(spec.stations) if isinstance(spec.stations, SpacingSpec) else np.asarray(spec.stations, dtype=float)
    d = spec.filament.diameter
    centres, moved = _section(spec, rng)
    length = float(x[-1] - x[0])
    measured: dict[str, Any] = {"jitter_rms_um": moved}
    if spec.migration is not None:
        result = curves.migrating(centres, x, d, spec.migration, spec.twist, rng)
        path, stretch = result.path, result.arc_lengths / length - 1.0
        overlap = curves.largest_overlap(path, d)
        if overlap > spec.migration.max_overlap * d:
            raise InputError(
                "migration.period",
                spec.migration.period,
                f"a longer period or a looser section: filaments overlap by {overlap:.3g} um, more than "
                f"{spec.migration.max_overlap:g} D",
            )
        radius = np.hypot(path[:, :, 1], path[:, :, 2])
        measured["mean_migration_um"] = float(np.ptp(radius, axis=1).mean())
    else:
        path = curves.helical(centres, x, spec.twist) if spec.twist else curves.straight(centres, x)
        radius = np.hypot(centres[:, 0], centres[:, 1])
        stretch = curves.helix_stretch(radius, spec.twist)
        overlap = max(d - min_distance(centres), 0.0)  # a turn keeps distances within a plane
    measured["largest_overlap_um"] = overlap
    measured["largest_helix_angle_rad"] = float(np.arctan(2.0 * np.pi * abs(spec.twist) * radius.max()))
    measured["largest_turn_per_bond"] = abs(spec.twist) * float(np.diff(x).max())
    prestrain = stretch if spec.twist_state == "tensioned" else np.zeros(len(centres))
    n, m = path.shape[:2]
    return _system(spec, path.reshape(n * m, 3), m, prestrain, _provenance("bundle", spec, seed, measured))


def build_section(spec: BundleSpec, rng: np.random.Generator) -> FilamentSystem:
    """The bundle's section at mid-length: one bead a filament, at x = 0; stations, twist and migration play no part.

    The generator is used as in :func:`build_bundle`, so that the same seed gives the same section. Box as there, with
    one diameter to both sides in x. Raises :class:`InputError` for centres that overlap.
    """
    seed = _seed(rng)
    centres, moved = _section(spec, rng)
    positions = np.column_stack([np.zeros(len(centres)), centres])
    overlap = max(spec.filament.diameter - min_distance(centres), 0.0)
    measured = {"jitter_rms_um": moved, "largest_overlap_um": overlap}
    return _system(spec, positions, 1, np.zeros(len(centres)), _provenance("section", spec, seed, measured))


def jittered(centres: FloatArray, amplitude: float, diameter: float, rng: np.random.Generator) -> FloatArray:
    """Centres (n, 2) each shifted by a random vector, uniform in the disc of radius ``amplitude`` um, without overlap.

    Shifts are drawn for all filaments at once; those of a pair that would come nearer than ``diameter`` (or nearer
    than they were, if they overlap already) are taken back and drawn again, up to ten times at each of the amplitudes
    1, 1/2, 1/4, ... 1/128 of the asked one; what is left then stays where it was. So shifts are smaller where
    filaments are close. The same generator gives the same shifts.
    """
    if amplitude == 0.0 or len(centres) == 0:
        return centres.copy()
    pairs = cKDTree(centres).query_pairs(diameter + 2.0 * amplitude, output_type="ndarray")
    i, j = pairs[:, 0], pairs[:, 1]
    least = np.minimum(_distances(centres, i, j), diameter)
    placed = np.zeros(len(centres), dtype=bool)
    result = centres.copy()
    for k in range(80):
        open_ = np.flatnonzero(~placed)
        if not len(open_):
            break
        u = rng.random((len(open_), 2))
        r, t = amplitude * 0.5 ** (k // 10) * np.sqrt(u[:, 0]), 2.0 * np.pi * u[:, 1]
        trial = result.copy()
        trial[open_] = centres[open_] + np.column_stack([r * np.cos(t), r * np.sin(t)])
        placed[:] = True
        tried = np.zeros_like(placed)
        tried[open_] = True
        while (bad := _distances(trial, i, j) < least).any():
            back = np.union1d(i[bad], j[bad])
            back = back[tried[back]]
            trial[back] = centres[back]
            tried[back] = placed[back] = False
        result = trial
    return result


def _distances(c: FloatArray, i: np.ndarray, j: np.ndarray) -> FloatArray:
    v = c[i] - c[j]
    return np.sqrt(v[:, 0] ** 2 + v[:, 1] ** 2)


def _section(spec: BundleSpec, rng: np.random.Generator) -> tuple[FloatArray, float]:
    """Centres after jitter, and the r.m.s. shift."""
    d = spec.filament.diameter
    if isinstance(spec.section, ArrangementSpec):
        centres = arrange(spec.section, d, rng)
    else:
        centres = np.array(spec.section, dtype=float)
    least = min_distance(centres)
    if least < d * (1.0 - 1e-9):
        raise InputError("bundle.section", f"least distance {least:.6g} um", f"no two centres nearer than {d:g} um")
    shifted = jittered(centres, spec.jitter, d, rng)
    return shifted, float(np.sqrt(np.mean(np.sum((shifted - centres) ** 2, axis=1))))


def _system(
    spec: BundleSpec, positions: FloatArray, beads: int, prestrain: FloatArray, provenance: dict[str, Any]
) -> FilamentSystem:
    n, d = len(prestrain), spec.filament.diameter
    low, high = positions.min(axis=0), positions.max(axis=0)
    box = np.column_stack([low - 1.5 * d, high + 1.5 * d])
    if spec.box_half_width is not None:
        half = spec.box_half_width
    else:
        width = float(high[1] - low[1]) + d
        half = max(0.5 * min(n * d, 4.0 * width), 0.5 * width) + d
    middle = 0.5 * float(low[1] + high[1])
    box[1] = min(box[1, 0], middle - half), max(box[1, 1], middle + half)
    return FilamentSystem(
        positions=positions,
        filament_start=np.arange(n + 1, dtype=np.int64) * beads,
        closed=np.zeros(n, dtype=bool),
        tow=np.full(n, spec.tow, dtype=np.int64),
        filament_type=np.zeros(n, dtype=np.int64),
        types=(spec.filament,),
        box=box,
        periodic=np.zeros(3, dtype=bool),
        prestrain=prestrain,
        provenance=provenance,
    )


def _seed(rng: np.random.Generator) -> dict[str, Any]:
    """Where the generator comes from: its kind, entropy and spawn key (draws made before are not counted)."""
    source = rng.bit_generator.seed_seq
    entropy = getattr(source, "entropy", None)
    if entropy is not None and not isinstance(entropy, int):
        entropy = [int(e) for e in entropy]
    key = [int(k) for k in getattr(source, "spawn_key", ())]
    return {"generator": type(rng.bit_generator).__name__, "entropy": entropy, "spawn_key": key}


def _provenance(builder: str, spec: BundleSpec, seed: dict[str, Any], measured: dict[str, Any]) -> dict[str, Any]:
    return {"builder": builder, "spec": _plain(asdict(spec)), "seed": seed, "measured": _plain(measured)}


def _plain(value: Any) -> Any:
    """As JSON takes it; an array is named by its shape and digest, for the system holds its values."""
    if isinstance(value, dict):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, (list, tuple)):
        return [_plain(v) for v in value]
    if isinstance(value, np.ndarray):
        digest = hashlib.sha256(np.ascontiguousarray(value, dtype=float).tobytes()).hexdigest()
        return {"shape": list(value.shape), "sha256": digest}
    return value.item() if isinstance(value, np.generic) else value
