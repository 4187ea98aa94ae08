"""What a run leaves: the record (one row a sample) and the frames (filament positions), in plain arrays.

The column names and units of ``curve.csv`` (interface) are stated here once.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from cgfibre.build.system import FloatArray, IntArray

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


@dataclass(frozen=True)
class Curve:
    """The pressure-thickness record: one array of n_samples a column of :data:`CURVE_COLUMNS`.

    Compression is positive; forces are means over the sampling window on the whole modelled length (section: per the
    stated depth). ``phase`` is (n_samples,) int: 0 loading, 1 holding, 2 unloading. ``width_um`` is the width of the
    assembly under the platen at the sample.
    """

    columns: dict[str, FloatArray]
    phase: IntArray
    width_um: FloatArray

    def __post_init__(self) -> None:
        missing = set(CURVE_COLUMNS) - set(self.columns)
        if missing:
            raise ValueError(f"Curve lacks the columns {sorted(missing)}")

    def __getitem__(self, name: str) -> FloatArray:
        return self.columns[name]

    def __len__(self) -> int:
        return len(self.phase)

    @property
    def loading(self) -> np.ndarray:
        """(n_samples,) bool, true while the platen goes down."""
        return self.phase == 0

    @property
    def unloading(self) -> np.ndarray:
        """(n_samples,) bool, true while the platen goes back."""
        return self.phase == 2


@dataclass(frozen=True)
class Frames:
    """Filament positions over time.

    ``positions`` (n_frames, n_beads, 3) um, unwrapped, in the axes of the scene (x along, y across, z compaction);
    ``step`` (n_frames,); ``displacement_um`` (n_frames,) of the platen.
    """

    step: IntArray
    displacement_um: FloatArray
    positions: FloatArray

    def __len__(self) -> int:
        return len(self.step)
