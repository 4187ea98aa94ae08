"""Woven tows as FilamentSystems: a chain a tow, a ribbon of chains a tow, or every filament of every tow."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from cgfibre.build.overlap import initial_overlap
from cgfibre.build.system import FilamentSystem, FilamentType, FloatArray
from cgfibre.build.tow_packing import Packing, holding, loosened_section, packed_section
from cgfibre.build.tow_path import TowPath, resample, stations
from cgfibre.build.tow_shape import SECTIONS, TowShape
from cgfibre.build.weave_spec import (
    WeaveGeometry,
    WeaveSpec,
    consistent_plain,
    minimum_spacing,
    pattern_from_rows,
    plain,
    satin,
    twill,
    weave_geometry,
    weave_paths,
)
from cgfibre.errors import InputError

__all__ = [
    "SECTIONS",
    "TowPath",
    "TowShape",
    "WeaveGeometry",
    "WeaveSpec",
    "consistent_plain",
    "filament_system",
    "holding",
    "initial_overlap",
    "minimum_spacing",
    "packed_section",
    "pattern_from_rows",
    "plain",
    "resample",
    "ribbon_system",
    "satin",
    "tow_system",
    "twill",
    "weave_geometry",
    "weave_paths",
]

#: overlap of tows that is let be, of the thinner one's thickness
CLEAR = 1e-6
#: stretch of a fabric's height, by its gap or of its paths, that is given for overlap at most
STRETCH = 1.1
#: overlap of filaments of the thinner tow's thickness beyond which a spec is refused
OVERLAP = 1e-3
#: times that a spec's gap is opened
ROUNDS = 8
#: distance over diameter at which filaments are packed where they fit so
ROOM = 1.01
#: what is built: a spec, or paths with the periodic cell's edges (x, y) um (``None``: a patch)
Woven = WeaveSpec | tuple[Sequence[TowPath], tuple[float, float] | None]


def tow_system(woven: Woven, types: FilamentType | tuple[FilamentType, FilamentType], spacing: float) -> FilamentSystem:
    """Every tow one chain on its centre line, tow after tow, warp tows first (tow number = filament number).

    ``woven`` a spec, or (paths, cell) with the cell's edges in um (``None`` for a patch); ``types`` of all tows or of
    (warp, weft) tows; ``spacing`` um, largest distance of beads along the tow, with a bead on every crossing
    (:func:`stations`). Periodic: closed chains in a cell periodic along x and y. Prestrain is 0.
    Chords between beads dip into the tow they cross, by about (kappa s)^2 D / 4 for curvature kappa: a spec's gap is
    opened by what overlaps until less than :data:`CLEAR` of the thickness is left; given paths are stretched in height.
    Provenance: the spec, the gap or stretch, and the largest overlap as built.
    Raises :class:`InputError` for a diameter above the tow's thickness, and as :func:`weave_paths`.
    """
    kinds = _kinds(types)

    def build(woven: Woven) -> FilamentSystem:
        paths, cell, spec = _woven(woven)
        chains = []
        for path in paths:
            _fits(kinds[0 if path.is_warp else -1].diameter, path.shape)
            chains.append((path, resample(path, spacing=spacing)))
        return _system("tow_system", chains, kinds, cell, spec, {"spacing": spacing})

    return _cleared(woven, build)


def ribbon_system(
    woven: Woven,
    types: FilamentType | tuple[FilamentType, FilamentType],
    spacing: float,
    chains: int | tuple[int, int] | None = None,
) -> FilamentSystem:
    """Flat tows as ribbons: parallel chains across the width, of equal distance, one tow number each.

    Chain k of m stands (k - (m - 1) / 2) (w - D) / (m - 1) across the tow, so that the outermost rods end at its
    width; ``types`` are those of one chain, D its diameter, at most the thickness. ``chains`` of (warp, weft) tows, at
    least 2 (a round tow is one); ``None`` takes as many as stand side by side without a gap, ceil((w - D) / D) + 1.
    Rods of one thickness make a racetrack whatever the section: a spec's paths are made for racetracks of its widths
    and thicknesses, so that none overlap. Chains of one tow may stand in each other: leave out contacts inside a tow.
    Raises :class:`InputError` as :func:`tow_system`.
    """
    if isinstance(woven, WeaveSpec):
        woven = replace(woven, warp=_racetrack(woven.warp), weft=_racetrack(woven.weft))
    kinds = _kinds(types)
    counts = chains if isinstance(chains, tuple) else (chains, chains)

    def build(woven: Woven) -> FilamentSystem:
        paths, cell, spec = _woven(woven)
        rods = []
        for path in paths:
            d = kinds[0 if path.is_warp else -1].diameter
            _fits(d, path.shape)
            room = path.shape.width - d
            m = counts[0 if path.is_warp else 1]
            if m is None:
                m = int(np.ceil(room / d - 1e-9)) + 1 if room > 1e-9 * d else 1
            if m < (2 if room > 1e-9 * d else 1):
                raise InputError("ribbon.chains", m, "at least 2 chains a tow (1 a round tow)")
            points, tangent, normal = path.at(stations(path, spacing=spacing))
            across = np.cross(normal, tangent)
            offset = np.linspace(-0.5 * room, 0.5 * room, m) if m > 1 else np.zeros(1)
            rods += [(path, points + y * across) for y in offset]
        return _system("ribbon_system", rods, kinds, cell, spec, {"spacing": spacing, "chains": chains})

    return _cleared(woven, build)


def filament_system(
    woven: Woven,
    types: FilamentType | tuple[FilamentType, FilamentType],
    count: int | tuple[int, int],
    spacing: float,
    packing: Packing = "random",
    twist: float = 0.0,
    jitter: float = 0.0,
    seed: int = 0,
) -> FilamentSystem:
    """Every filament of every tow a chain: packed inside the tow's section, which follows its path.

    Filament (y, z) of the section runs at y across and z through the tow, with beads in the same sections (at
    :func:`stations` of the path). ``types`` of a filament and ``count`` of filaments, of all tows or of (warp, weft)
    tows; ``packing`` and ``jitter`` um: see :func:`packed_section`, each tow has its own; ``twist`` turns per um,
    positive Z, of round tows alone (a turning section must stay inside its outline), in a closed tow the nearest whole
    number of turns. Filaments are moved apart as if of D / (cos a cos(b / 2)), a the helix angle at the surface and b
    the largest turn of the path from one section to the next, and further by what still overlaps, so that their rods do
    not overlap either; a spec's gap is opened as in :func:`tow_system`. They are packed :data:`ROOM` D apart where they
    fit so, which leaves the same specimen of a seed at every bead spacing that needs no more.
    Raises :class:`InputError` for filaments that do not fit, twist of flat tows, a spec whose filaments still overlap
    by more than :data:`OVERLAP` of the thickness (dense and strongly twisted), and as :func:`tow_system`.
    """
    kinds = _kinds(types)
    counts = count if isinstance(count, tuple) else (count, count)
    if not np.isfinite(twist):
        raise InputError("filaments.twist", twist, "a finite number of turns per um")
    asked = {"spacing": spacing, "count": count, "packing": packing, "twist": twist, "jitter": jitter, "seed": seed}
    tows = []
    for path in _woven(woven)[0]:
        d = kinds[0 if path.is_warp else -1].diameter
        _, tangent, _ = path.at(stations(path, spacing=spacing))
        bend = float(np.arccos(np.clip(np.min(np.sum(tangent[1:] * tangent[:-1], axis=1)), -1.0, 1.0)))
        helix = np.arctan(np.pi * _turns(path, twist) / path.arc_length * (path.shape.width - d))
        tows.append((path.shape, counts[0 if path.is_warp else 1], d, d / float(np.cos(helix) * np.cos(0.5 * bend))))

    # one specimen a seed: what bead spacing and twist want beyond that is a matter of moving filaments a little
    rng = np.random.default_rng(seed)
    specimen = [_roomy(shape, n, d, packing, jitter, rng) for shape, n, d, _ in tows]

    def packed(looser: float) -> list[FloatArray]:
        if packing == "hexagonal" and jitter == 0.0:
            again = np.random.default_rng(seed)
            return [packed_section(shape, n, d, packing, again, looser * apart) for shape, n, d, apart in tows]
        each = zip(tows, specimen, strict=True)
        return [loosened_section(t[0], start, t[2], looser * t[3], np.random.default_rng(seed)) for t, start in each]

    def build(woven: Woven, sections: list[FloatArray]) -> FilamentSystem:
        paths, cell, spec = _woven(woven)
        rods = []
        for path, section in zip(paths, sections, strict=True):
            s = stations(path, spacing=spacing)
            points, tangent, normal = path.at(s)
            across = np.cross(normal, tangent)
            a = (2.0 * np.pi * _turns(path, twist) * s / path.arc_length)[:, None]
            # about the tangent, right-handed: y turns towards z
            e, f = np.cos(a) * across + np.sin(a) * normal, np.cos(a) * normal - np.sin(a) * across
            rods += [(path, points + y * e + z * f) for y, z in section]
        return _system("filament_system", rods, kinds, cell, spec, asked)

    looser, d = 1.0, min(kind.diameter for kind in kinds)
    system = _cleared(woven, partial(build, sections=packed(looser)))
    for _ in range(ROUNDS):
        overlap = float(system.provenance["measured"]["largest_overlap_um"])
        if overlap <= CLEAR * d:
            break
        looser *= 1.0 + 1.1 * overlap / d
        try:
            sections = packed(looser)
        except InputError:  # too dense to stand further apart
            break
        system = _cleared(woven, partial(build, sections=sections))
    overlap = float(system.provenance["measured"]["largest_overlap_um"])
    if isinstance(woven, WeaveSpec) and overlap > OVERLAP * min(woven.warp.thickness, woven.weft.thickness):
        raise InputError(
            "filaments.count", count, f"a looser tow, less twist or closer beads: {overlap:.3g} um of overlap are left"
        )
    return system


def _roomy(
    shape: TowShape, count: int, diameter: float, packing: Packing, jitter: float, rng: np.random.Generator
) -> FloatArray:
    """Filaments packed :data:`ROOM` diameters apart, or as they fit."""
    try:
        return packed_section(shape, count, diameter, packing, rng, ROOM * diameter, jitter)
    except InputError:
        return packed_section(shape, count, diameter, packing, rng, diameter, jitter)


def _turns(path: TowPath, twist: float) -> float:
    """Turns of the filaments over the path: of a closed one the nearest whole number."""
    if twist == 0.0:
        return 0.0
    if path.shape.section != "circular":
        raise InputError("filaments.twist", twist, f"0 for a {path.shape.section} tow: only round ones turn")
    turns = twist * path.arc_length
    if not path.closed:
        return turns
    if round(turns) == 0:
        least = 0.5 / path.arc_length
        raise InputError("filaments.twist", twist, f"at least {least:.4g} turns per um, or a longer cell")
    return float(round(turns))


def _cleared(woven: Woven, build: Callable[[Woven], FilamentSystem]) -> FilamentSystem:
    """The system with a spec's gap opened, or paths' heights stretched, until tows overlap by :data:`CLEAR` at most.

    Where that does not end (a gap that leaves no way between the tows, paths that want more than :data:`STRETCH`) the
    system is the one without: its overlap stays in the provenance, for a relaxation to clear.
    """
    first = system = build(woven)
    shapes = [woven.warp, woven.weft] if isinstance(woven, WeaveSpec) else [path.shape for path in woven[0]]
    thickness = min(shape.thickness for shape in shapes)
    gap, stretch = 0.0, 1.0
    key = "gap_added_um" if isinstance(woven, WeaveSpec) else "height_stretch"
    for _ in range(ROUNDS):
        overlap = initial_overlap(system, between_tows=True)[0]
        if overlap <= CLEAR * thickness:
            added = gap if isinstance(woven, WeaveSpec) else stretch
            return replace(system, provenance={**system.provenance, key: added})
        gap, stretch = gap + 1.01 * overlap, stretch + 1.01 * overlap / thickness
        if stretch > STRETCH:
            break
        try:
            if isinstance(woven, WeaveSpec):
                system = build(replace(woven, gap=woven.gap + gap))
            else:
                system = build(([path.stretched(stretch) for path in woven[0]], woven[1]))
        except InputError:
            break
    return replace(first, provenance={**first.provenance, key: 0.0 if isinstance(woven, WeaveSpec) else 1.0})


def _racetrack(shape: TowShape) -> TowShape:
    return shape if shape.section == "circular" else replace(shape, section="racetrack")


def _woven(woven: Woven) -> tuple[list[TowPath], tuple[float, float] | None, dict[str, Any]]:
    """Paths, the periodic cell, and the provenance of both."""
    if not isinstance(woven, WeaveSpec):
        paths, cell = list(woven[0]), woven[1]
        if not paths:
            raise InputError("paths", 0, "at least one tow")
        if any(p.closed for p in paths) and cell is None:
            raise InputError("cell", None, "the cell's edges for tows that run on through its boundary")
        return paths, cell, {"paths": len(paths)}
    spec = {
        "pattern": ["".join("X" if over else "." for over in row) for row in woven.pattern],
        "warp": [woven.warp.section, woven.warp.width, woven.warp.thickness],
        "weft": [woven.weft.section, woven.weft.width, woven.weft.thickness],
        "warp_spacing": woven.warp_spacing,
        "weft_spacing": woven.weft_spacing,
        "counts": list(woven.counts),
        "gap": woven.gap,
        "amplitudes": list(woven.amplitudes),
        "path": woven.path,
        "ends": None if woven.periodic else woven.ends,
    }
    return weave_paths(woven), woven.size if woven.periodic else None, spec


def _kinds(types: FilamentType | tuple[FilamentType, FilamentType]) -> tuple[FilamentType, ...]:
    """One type, or those of warp and weft."""
    return types if isinstance(types, tuple) else (types,)


def _fits(diameter: float, shape: TowShape) -> None:
    if diameter > shape.thickness * (1.0 + 1e-9):
        raise InputError("type.diameter", diameter, f"at most the tow's thickness, {shape.thickness:g} um")


def _system(
    builder: str,
    chains: list[tuple[TowPath, FloatArray]],
    kinds: tuple[FilamentType, ...],
    cell: tuple[float, float] | None,
    spec: dict[str, Any],
    asked: dict[str, Any],
) -> FilamentSystem:
    positions = np.concatenate([points for _, points in chains])
    d = max(kind.diameter for kind in kinds)
    low, high = positions.min(axis=0), positions.max(axis=0)
    # height to spare: a tow's thickness or a diameter beyond the outermost surfaces
    room = max(d, max(path.shape.thickness for path, _ in chains))
    box = np.column_stack([low - room, high + room])
    if cell is not None:
        box[0], box[1] = (0.0, cell[0]), (0.0, cell[1])
    kind = np.array([0 if path.is_warp or len(kinds) == 1 else 1 for path, _ in chains], dtype=np.int64)
    n = len(chains)
    system = FilamentSystem(
        positions=positions,
        filament_start=np.concatenate([[0], np.cumsum([len(points) for _, points in chains])]).astype(np.int64),
        closed=np.array([path.closed for path, _ in chains]),
        tow=np.array([path.index for path, _ in chains], dtype=np.int64),
        filament_type=kind,
        types=kinds,
        box=box,
        periodic=np.array([cell is not None, cell is not None, False]),
        prestrain=np.zeros(n),
        provenance={"builder": builder, "spec": spec, **asked},
    )
    overlap, pair = initial_overlap(system, between_tows=builder == "ribbon_system")
    measured = {"largest_overlap_um": overlap, "overlapping_filaments": None if pair is None else list(pair)}
    return replace(system, provenance={**system.provenance, "measured": measured})
