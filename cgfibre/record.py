"""What a run leaves: the record (one row a sample) and the frames (filament positions), in plain arrays.

The column names and units of ``curve.csv`` (interface) are stated here once.
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from cgfibre.build.system import FilamentSystem, FloatArray, IntArray

#: columns of curve.csv and of /record, with their units
CURVE_COLUMNS: dict[str, str] = {
    "step": "1",
    "time_us": "us",
    "displacement_um": "um",
    "thickness_um": "um",
    "force_top_N": "N",
    "force_bottom_N": "N",
    "pressure_MPa": "MPa",
    "fibre_volume_fraction": "1",
    "kinetic_J": "J",
    "stored_J": "J",
    "work_J": "J",
}


#: what curve.csv and /record have beside them of a weave that is loaded in its plane, with units
CELL_COLUMNS: dict[str, str] = {
    "cell_x_um": "um",
    "cell_y_um": "um",
    "shear_rad": "rad",
    "tension_warp_N": "N",
    "tension_weft_N": "N",
    "shear_couple_N_per_m": "N/m",
    "work_cell_J": "J",
}
#: what curve.csv has beside them where there is more than one cycle; always in /record
CYCLE_COLUMNS = ("cycle", "phase")


def phases(displacement: FloatArray) -> IntArray:
    """(n,) 0 loading, 1 holding, 2 unloading, from the platen's displacement where nothing else tells them."""
    change = np.diff(displacement, prepend=0.0)
    tiny = 1e-9 * max(1.0, float(np.max(np.abs(displacement), initial=0.0)))
    return np.where(change > tiny, 0, np.where(change < -tiny, 2, 1)).astype(np.int64)


@dataclass(frozen=True)
class Curve:
    """The pressure-thickness record: one array of n_samples a column of :data:`CURVE_COLUMNS`.

    Compression is positive; forces are means over the sampling window on the whole modelled length (section: per the
    stated depth). ``phase`` is (n_samples,) int: 0 loading, 1 holding, 2 unloading. ``width_um`` is the width of the
    assembly under the platen at the sample. ``cycle`` (n_samples,) int counts the loadings from 1 (not given: one); the
    last one ends at the scene's stop.

    ``cell`` has one array a column of :data:`CELL_COLUMNS`, of a weave that is loaded in its plane, else nothing: edges
    of the cell or patch along warp and weft, the weft's turn, tension a tow, the couple that resists a change of the
    angle over the cell's area x y, and the work of the edges since the platens began to move.
    """

    columns: dict[str, FloatArray]
    phase: IntArray
    width_um: FloatArray
    cycle: IntArray = field(default_factory=lambda: np.empty(0, dtype=np.int64))
    cell: dict[str, FloatArray] = field(default_factory=dict)

    def __post_init__(self) -> None:
        missing = set(CURVE_COLUMNS) - set(self.columns)
        if missing:
            raise ValueError(f"Curve lacks the columns {sorted(missing)}")
        if len(self.cycle) == 0:
            object.__setattr__(self, "cycle", np.ones(len(self.phase), dtype=np.int64))

    def __getitem__(self, name: str) -> FloatArray:
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.phase)

    @property
    def work(self) -> FloatArray:
        """(n_samples,) J, work of the platens and, in the plane, of the cell's edges."""
        return self["work_J"] + self.cell["work_cell_J"] if self.cell else self["work_J"]

    @property
    def loading(self) -> np.ndarray:
        """(n_samples,) bool, true while the platen goes down for the first time; :meth:`of` gives later loadings."""
        return (self.phase == 0) & (self.cycle == 1)

    @property
    def unloading(self) -> np.ndarray:
        """(n_samples,) bool, true while the platen goes back, in any cycle."""
        return self.phase == 2

    @property
    def cycles(self) -> int:
        """How many loadings there are."""
        return int(np.max(self.cycle, initial=1))

    def of(self, cycle: int) -> Curve:
        """The curve of one cycle, as if it were the only one; it starts at the last sample of the one before.

        Its own rows have ``cycle`` 1, so :attr:`loading` is the loading of that cycle.
        """
        keep = self.cycle == cycle
        before = np.flatnonzero(self.cycle < cycle)
        phase = self.phase.copy()
        if len(before) and keep.any():
            keep[before[-1]], phase[before[-1]] = True, 0
        columns = {name: values[keep] for name, values in self.columns.items()}
        cell = {name: values[keep] for name, values in self.cell.items()}
        return Curve(columns, phase[keep], self.width_um[keep], cell=cell)


@dataclass(frozen=True)
class Balance:
    """What stands beside the platens' forces and work in a section, at the samples of the curve (n_samples,).

    Forces on the discs along z, upwards: ``springs`` and ``drag`` of the background, N; ``momentum`` N us of the discs;
    ``contact`` J in the contacts' normal springs (a part of the curve's stored energy; that of their tangential ones is
    not known); ``factor``: how many times stiffer contacts have become.
    """

    springs: FloatArray
    drag: FloatArray
    momentum: FloatArray
    contact: FloatArray
    factor: FloatArray


@dataclass(frozen=True)
class Frames:
    """Filament positions over time.

    ``positions`` (n_frames, n_beads, 3) um, unwrapped, in the axes of the scene (x along, y across, z compaction);
    ``step`` (n_frames,); ``displacement_um`` (n_frames,) of the platen; ``factor`` (n_frames,): how many times stiffer
    than at first contacts had become (not given: 1). ``box`` (n_frames, 3, 2) um, bounds of the box of a weave that is
    loaded in its plane, and ``tilt`` (n_frames,) um, how far its upper y edge lies over the lower one along x (not
    given: 0); None: as built.
    """

    step: IntArray
    displacement_um: FloatArray
    positions: FloatArray
    factor: FloatArray = field(default_factory=lambda: np.empty(0))
    box: FloatArray | None = None
    tilt: FloatArray = field(default_factory=lambda: np.empty(0))

    def __post_init__(self) -> None:
        if len(self.factor) == 0:
            object.__setattr__(self, "factor", np.ones(len(self.step)))
        if len(self.tilt) == 0:
            object.__setattr__(self, "tilt", np.zeros(len(self.step)))

    def __len__(self) -> int:
        return len(self.step)

    def system_at(self, system: FilamentSystem, k: int) -> FilamentSystem:
        """``system``, as built, in frame ``k``: with its positions and its box."""
        if self.box is None:
            return replace(system, positions=self.positions[k])
        return replace(system, positions=self.positions[k], box=self.box[k], tilt=float(self.tilt[k]))
