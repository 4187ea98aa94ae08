"""What the planners of all levels start from: the section as arranged and the filament's constants."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from cgfibre.build.bundle import filament_type
from cgfibre.build.packing import HEXAGONAL_LIMIT, ArrangementSpec, arrange, enclosing_area, pitch_from_void_fraction
from cgfibre.build.system import FilamentType, FloatArray
from cgfibre.mechanics import rod
from cgfibre.mechanics.support import bundle_bending_force
from cgfibre.plan.motion import LATE, depths_below_top, earlier_displacements, planned_displacement
from cgfibre.scene import Scene

SHEAR = 0.9  # Timoshenko coefficient of a solid circle


@dataclass(frozen=True)
class Outline:
    """The section as arranged, (n, 2) ``centres`` um, the filament's constants, the planned ``displacement`` um, and
    those of cycles before it."""

    filament: FilamentType
    centres: FloatArray
    pitch: float
    width: float
    height: float
    displacement: float
    earlier: tuple[float, ...] = ()

    def bending_force(self, scene: Scene, displacement: float) -> float:
        """Force on a platen that bends the filaments between their end supports, nN; rows join in as voids close."""
        width = 0.0 if scene.platens.width == "full" else float(scene.platens.width)
        length, tension = scene.bundle.length, scene.ends.tension
        stiffness = 1 / float(rod.platen_compliance(length, self.filament.EI, width=width, tension=tension))
        depths = LATE * depths_below_top(self.centres)
        force = bundle_bending_force(
            np.array(displacement), depths, stiffness, diameter=scene.filament.diameter, pitch=self.pitch
        )
        return float(force)

    def column(self) -> tuple[float, int]:
        """(sum of the gaps um, number of filaments) of the column that leads from top to bottom; (inf, 0): none does.

        Filaments within a tenth of a diameter of a common vertical stand one above the other: pressed by more than
        their gaps they are squeezed, however softly the rest would bend out of the way. One alone is such a column.
        """
        d = self.filament.diameter
        y, z = self.centres.T
        found = (math.inf, 0)
        for top in np.flatnonzero(z > z.max() - 0.1 * d):
            column = np.abs(y - y[top]) < 0.1 * d
            if z[column].min() < z.min() + 0.1 * d and np.max(np.diff(np.sort(z[column])), initial=0.0) < 2 * d:
                count = int(np.sum(column))
                found = min(found, (self.height - d * count, count))
        return found

    def radius(self) -> float:
        """Largest distance of a centre from the middle, um."""
        middle = self.centres.mean(axis=0)
        return float(np.max(np.linalg.norm(self.centres - middle, axis=1)))


def arrangement_spec(scene: Scene) -> ArrangementSpec:
    """The scene's arrangement as the builders take it."""
    a = scene.bundle
    if a.fibre_volume_fraction is not None:
        fraction: float | None = a.fibre_volume_fraction
    else:
        fraction = None if a.void_fraction is None else 1 - a.void_fraction
    return ArrangementSpec(
        name=a.arrangement,
        count=a.count,
        pitch=a.pitch,
        volume_fraction=fraction,
        first_angle=a.first_angle,
        aspect=1.0 if a.aspect is None else a.aspect,
        centres=a.centres,
        **({} if a.migration is None else {"epsilon": a.migration.epsilon, "beta": a.migration.beta}),
    )


def scene_filament(scene: Scene) -> FilamentType:
    """Section constants of the scene's filament."""
    f = scene.filament
    return filament_type(f.diameter, f.E1, f.G12, f.density, SHEAR)


def outline(scene: Scene) -> Outline:
    """Arrange the section and check the planned stop against it; InputError names what cannot be."""
    spec = arrangement_spec(scene)
    d = scene.filament.diameter
    centres = arrange(spec, d, np.random.default_rng(scene.bundle.seed))
    if spec.centres is not None:
        fraction = len(centres) * np.pi * d**2 / 4 / enclosing_area(centres, d)
        pitch = pitch_from_void_fraction(d, 1 - min(fraction, HEXAGONAL_LIMIT))
    else:
        pitch = spec.pitch or pitch_from_void_fraction(d, 1 - float(spec.volume_fraction or 0.69))
    width, height = (float(np.ptp(centres[:, k])) + d for k in (0, 1))
    depth = planned_displacement(scene, height, width, len(centres))
    earlier = earlier_displacements(scene, height, width, len(centres), depth)
    return Outline(scene_filament(scene), centres, max(pitch, d), width, height, depth, earlier)
