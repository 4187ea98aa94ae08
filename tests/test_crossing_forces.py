"""Forces of touching segments found again from positions, against the engine's own on the same positions."""

import numpy as np
import pytest
from capsule_bench import Box, forces_on

from cgfibre.build.system import FilamentSystem, FilamentType
from cgfibre.measure.crossing_forces import touches
from cgfibre.measure.fabric import Fabric
from cgfibre.mechanics.contact import LineContact

D, EDGE, MODULUS = 7.0, 250.0, 5.5e6


def tangle(rng, count=160):
    """Filaments of four segments of 20 um, softly bent, at every angle to each other, in a periodic box."""
    out = []
    for _ in range(count):
        way = rng.normal(size=3)
        points = [rng.uniform(0, EDGE, 3)]
        for _ in range(4):
            way = way / np.linalg.norm(way) + 0.3 * rng.normal(size=3)
            points.append(points[-1] + 20.0 * way / np.linalg.norm(way))
        out.append(np.array(points))
    return out


def fabric_of_lines(filaments, box):
    """The tangle as a fabric of one tow."""
    n = len(filaments)
    system = FilamentSystem(
        positions=np.concatenate(filaments),
        filament_start=np.arange(n + 1) * 5,
        closed=np.zeros(n, dtype=bool),
        tow=np.zeros(n, dtype=np.int64),
        filament_type=np.zeros(n, dtype=np.int64),
        types=(FilamentType(D, 1.0, 1.0, 1.0, 1.0, 1.0),),
        box=box.edges,
        periodic=np.ones(3, dtype=bool),
        prestrain=np.zeros(n),
    )
    return Fabric(system, np.zeros(1, dtype=np.int64), (np.arange(n),))


@pytest.mark.parametrize("law", ["hooke", "line"])
def test_forces_are_the_engine_s(tmp_path, law):
    filaments = tangle(np.random.default_rng(5))
    words = f"hooke {MODULUS}" if law == "hooke" else f"line {MODULUS}"
    box = Box(np.array([[0.0, EDGE]] * 3), True)
    rows = forces_on(tmp_path, filaments, box, reach=25.0, law=words).rows
    fabric = fabric_of_lines(filaments, box)
    system = fabric.system
    line = LineContact(MODULUS, D / 4, D / 2)
    of = {
        "hooke": lambda overlap: MODULUS * overlap,
        "line": lambda overlap: line.line_load(np.minimum(overlap, 0.999 * line.greatest_approach)),
    }[law]
    found = touches(fabric, system.positions, of, MODULUS if law == "line" else None)
    assert len(found) == len(rows) > 100
    assert found.length == pytest.approx(rows[:, 14], rel=1e-9)
    # Hertz' ellipse by a table of its shape
    accuracy = 1e-12 if law == "hooke" else 2e-4
    # tunnelled so deep that the line law ends are left to the engine's own continuation
    shallow = rows[:, 15] > 0.75 * D if law == "line" else np.ones(len(rows), dtype=bool)
    assert shallow.sum() > 30
    assert found.force[shallow] == pytest.approx(rows[shallow, 4], rel=accuracy)
    error = np.abs(found.vector - rows[:, 8:11])[shallow]
    assert np.max(error / rows[shallow, 4][:, None]) < accuracy


def test_the_mean_of_both_sides_is_the_engine_s(tmp_path):
    filaments = tangle(np.random.default_rng(6))
    box = Box(np.array([[0.0, EDGE]] * 3), True)
    rows = forces_on(tmp_path, filaments, box, reach=25.0, law=f"hooke {MODULUS}", sides="both").rows
    fabric = fabric_of_lines(filaments, box)
    found = touches(fabric, fabric.system.positions, lambda overlap: MODULUS * overlap, both_sides=True)
    first = rows[:, 2] < rows[:, 3]
    pairs = np.where(first[:, None], rows[:, :2], rows[:, 1::-1])
    known, place = np.unique(pairs, axis=0, return_inverse=True)
    assert len(found) == len(known) > 100
    for mine, column, sign in ((found.force, 4, 1.0), (found.length, 14, 1.0), (found.vector[:, 2], 10, -1.0)):
        theirs = np.bincount(place.ravel(), np.where(first, 1.0, sign) * rows[:, column], len(known))
        assert mine == pytest.approx(theirs, rel=1e-9, abs=1e-9 * np.max(np.abs(theirs)))
