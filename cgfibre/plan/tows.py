"""What the planner of weaves starts from: the tows as sections, rigidities and chains, and the fabric of them."""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import lru_cache

import numpy as np

from cgfibre.build.system import FilamentSystem, FilamentType
from cgfibre.build.texgen import textile_from_xml
from cgfibre.build.tow_path import TowPath
from cgfibre.build.weave import TowShape, WeaveSpec, filament_system, ribbon_system, tow_system, weave_paths
from cgfibre.errors import InputError
from cgfibre.mechanics.ribbon import torsion_constant
from cgfibre.plan.outline import scene_filament
from cgfibre.scene import Scene
from cgfibre.scene_assembly import Tow, Weave

#: width over thickness from which on a tow is flat, chains side by side that such a one is given, at most, and the part
#: of its width, in thicknesses, that each stands for
FLAT, MOST_RIBBONS, RIBBON_ASPECT = 5.0, 5, 2.0


@dataclass(frozen=True)
class TowModel:
    """A tow as modelled: ``shape``, constants of the whole tow (``whole``, its diameter the thickness), ``chains`` that
    share them, area of ``fibres`` um2 in its section, ``EI_in_plane`` nN um2 (that of ``whole`` is out of the tow's
    plane), ``modulus`` kPa (EA over the fibres' area)."""

    shape: TowShape
    whole: FilamentType
    chains: int
    fibres: float
    EI_in_plane: float

    @property
    def modulus(self) -> float:
        """EA over the area of the fibres, kPa."""
        return self.whole.EA / self.fibres

    @property
    def chain(self) -> FilamentType:
        """One of its chains: an equal part of everything."""
        t, n = self.whole, self.chains
        return FilamentType(t.diameter, t.EA / n, t.EI / n, t.GJ / n, t.kGA / n, t.mass_per_length / n)


def second_moments(shape: TowShape) -> tuple[float, float]:
    """(about the width, about the thickness) um4: int 2/3 h^3 dy and int 2 h y^2 dy, h half the thickness at y."""
    y = 0.5 * shape.width * np.sin(np.linspace(-0.5, 0.5, 4001) * np.pi)
    h = shape.half_thickness_at(y * (1 - 1e-12))
    return float(np.trapezoid(2 / 3 * h**3, y)), float(np.trapezoid(2 * h * y**2, y))


def tow_model(scene: Scene, tow: Tow, key: str = "assembly.tow") -> TowModel:
    """Constants of a tow: so many filaments that slide past each other, or a solid of its modulus; overrides win.

    EI in the tow's plane: that of the solid's section, or of the filaments, which is the same about both axes; a tow of
    given EI is no solid, nor is its EI_in_plane more than that where it is not given. InputError names ``key`` where
    EI_in_plane is below EI, or given of a tow that is one chain.
    """
    shape = TowShape(tow.section, tow.width, tow.thickness)
    f = scene_filament(scene)
    n = tow.filaments
    out, across = second_moments(shape)
    area = shape.area if n is None else n * math.pi * f.diameter**2 / 4
    if tow.modulus is not None:
        EA, EI, in_plane = tow.modulus * shape.area, tow.modulus * out, tow.modulus * across
        GJ = scene.filament.G12 * float(torsion_constant(out, across))
        kGA = 0.9 * scene.filament.G12 * shape.area
    else:
        count = n or 1
        EA, EI, GJ, kGA = count * f.EA, count * f.EI, count * f.GJ, count * f.kGA
        in_plane = EI
    whole = FilamentType(
        diameter=tow.thickness,
        EA=tow.EA or EA,
        EI=tow.EI or EI,
        GJ=tow.GJ or GJ,
        kGA=kGA,
        mass_per_length=scene.filament.density * area,
    )
    chains = tow.ribbons
    if chains == "auto":
        aspect = tow.width / tow.thickness
        chains = 1 if aspect < FLAT else min(MOST_RIBBONS, math.ceil(aspect / RIBBON_ASPECT))
    given = tow.EI_in_plane
    if tow.EI is not None:
        in_plane = tow.EI
    if given is not None and (given < whole.EI * (1 - 1e-9) or (chains == 1 and given > whole.EI * (1 + 1e-9))):
        expected = f"at least EI, {whole.EI * 1e-15:.4g} N*mm**2: a flat tow is stiffer in its plane"
        if chains == 1:
            expected = f"EI, {whole.EI * 1e-15:.4g} N*mm**2: one chain bends alike both ways (or ribbons = 2 or more)"
        raise InputError(f"{key}.EI_in_plane", f"{given * 1e-15:.4g} N*mm**2", expected)
    return TowModel(shape, whole, int(chains), area, given or in_plane)


def tow_models(scene: Scene) -> tuple[TowModel, TowModel]:
    """Warp and weft."""
    return tow_model(scene, scene.weave.tow), tow_model(scene, scene.weave.weft, "assembly.weft")


def weave_spec(weave: Weave) -> WeaveSpec:
    """The weave as the builders take it."""
    rows = np.array(weave.interlacing, dtype=bool)
    periodic = weave.cell == "periodic"
    repeats = (weave.tows.weft // rows.shape[0], weave.tows.warp // rows.shape[1]) if periodic else (1, 1)
    return WeaveSpec(
        pattern=rows,
        warp=TowShape(weave.tow.section, weave.tow.width, weave.tow.thickness),
        weft=TowShape(weave.weft.section, weave.weft.width, weave.weft.thickness),
        warp_spacing=weave.spacing.warp,
        weft_spacing=weave.spacing.weft,
        periodic=periodic,
        repeats=repeats,
        tows=None if periodic else (weave.tows.warp, weave.tows.weft),
        gap=weave.gap,
    )


#: of a length: what tows of a TexGen file may differ from what the scene says of them
LIKE = 0.02


def woven(weave: Weave) -> WeaveSpec | tuple[tuple[TowPath, ...], tuple[float, float] | None]:
    """What the builders weave: the spec, or the paths of a TexGen file; InputError where it is another weave."""
    spec = weave_spec(weave)
    if weave.texgen is None:
        return spec
    textile = textile_from_xml(weave.texgen)
    said: list[tuple[str, float, float]] = [
        ("tows.warp", weave.tows.warp, sum(p.is_warp for p in textile.paths)),
        ("tows.weft", weave.tows.weft, sum(not p.is_warp for p in textile.paths)),
    ]
    for name, tow, warp in (("tow", weave.tow, True), ("weft", weave.weft, False)):
        shapes = [p.shape for p in textile.paths if p.is_warp == warp]
        for key in ("width", "thickness"):
            said += [(f"{name}.{key}", getattr(tow, key), getattr(shape, key)) for shape in shapes]
    if textile.cell is None and weave.cell == "periodic":
        raise InputError("assembly.cell", "periodic", "'patch': the textile of the file does not repeat")
    if textile.cell is not None:
        said += [(f"spacing.{name}", weave.size[k], textile.cell[k]) for k, name in enumerate(("weft", "warp"))]
    for key, mine, theirs in said:
        if abs(mine - theirs) > LIKE * theirs:
            expected = f"as in the TexGen file, {theirs:.5g}" + (" um over the cell" if "spacing" in key else "")
            raise InputError(f"assembly.{key}", f"{mine:.5g}", expected)
    return textile.paths, textile.cell


def tow_level(scene: Scene, spacing: float) -> FilamentSystem:
    """The weave as chains, one a round tow, ribbons of them for flat ones."""
    (warp, weft), fabric = tow_models(scene), woven(scene.weave)
    types = (warp.chain, weft.chain)
    if warp.chains == weft.chains == 1:
        return tow_system(fabric, types, spacing)
    return ribbon_system(fabric, types, spacing, (warp.chains, weft.chains))


def greatest_curvature(scene: Scene) -> float:
    """Of the tows' centre lines, 1/um, as a mean over a twentieth of the crossings' distance."""
    w, fabric = scene.weave, woven(scene.weave)
    found = 0.0
    for path in weave_paths(fabric) if isinstance(fabric, WeaveSpec) else fabric[0]:
        window = 0.05 * (w.spacing.weft if path.is_warp else w.spacing.warp)
        s = np.arange(0.0, path.arc_length, window)
        tangent = np.column_stack([np.interp(s, path.arc, path.tangent[:, k]) for k in range(3)])
        found = max(found, float(np.max(np.linalg.norm(np.diff(tangent, axis=0), axis=1), initial=0.0)) / window)
    return found


def filament_level(scene: Scene, spacing: float) -> FilamentSystem:
    """The weave filament by filament."""
    w, f = scene.weave, scene_filament(scene)
    return filament_system(
        woven(w),
        f,
        (w.tow.filaments or 1, w.weft.filaments or 1),
        spacing,
        w.tow.packing,
        w.tow.twist if w.tow.twist_direction == "Z" else -w.tow.twist,
        seed=w.seed,
    )


@lru_cache(maxsize=4)
def woven_system(scene: Scene, resolve: str, spacing: float) -> FilamentSystem:
    """The weave as chains of its tows or of its filaments."""
    return tow_level(scene, spacing) if resolve == "tow" else filament_level(scene, spacing)
