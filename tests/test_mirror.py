"""The right half of a symmetric assembly against all of it."""

import math
from dataclasses import replace

import numpy as np
import pytest

from cgfibre.cases.experiment import moved, planned, run
from cgfibre.engine.collect import read_run
from cgfibre.engine.mirror import moved_beads, right_half, whole_of
from cgfibre.errors import InputError
from cgfibre.mechanics import rod
from cgfibre.plan.make import make_plan
from cgfibre.scene_reading import load_scene

L, W = 280.0, 140.0


def pressed(folder, symmetry, ends):
    """(plan, system, curve, frames) of one filament under a platen with edges, at rest 0.1 um deep."""
    changes = {
        "model.level": "chain",
        "model.symmetry": symmetry,
        "assembly.length": f"{L} um",
        "platens.width": f"{W} um",
        "ends.support": ends,
        "output.frames": 4,
    }
    plan, system = planned(changes)
    plan = moved(plan, 0.1 / 4000 / plan.timestep, 4000, 8000)
    f = system.types[0]
    frequency = float(rod.bending_frequency(L, f.EI, f.mass_per_length, tension=4e5))
    run(folder, system, plan, platen_bottom_um=-1000.0, drag=2 * frequency * float(np.median(plan.beads.mass)))
    curve, frames, _ = read_run(folder, system, plan)
    return plan, system, curve, frames


@pytest.mark.parametrize("ends", ["simply-supported", "clamped"])
def test_half_a_filament_bends_as_all_of_it(tmp_path, ends):
    """Force, stored energy and shape: equal but for the held bead (2e-4) and the spacing (chain_bending_error differs
    by 2e-4, clamped 1e-3)."""
    whole_plan, _, whole, frames = pressed(tmp_path / "whole", "none", ends)
    plan, half_system, half, mirrored = pressed(tmp_path / "half", "half", ends)
    assert plan.beads.support == "symmetric" and len(plan.beads.stations) % 2 == 0
    assert plan.n_beads == moved_beads(half_system, plan) < whole_plan.n_beads
    np.testing.assert_allclose(
        half["force_top_N"][-1], whole["force_top_N"][-1], rtol=5e-4 if ends == "simply-supported" else 2e-3
    )
    np.testing.assert_allclose(half["stored_J"][-1], whole["stored_J"][-1], rtol=5e-3)
    # the same stations but for one segment more: compare shapes
    at = np.linspace(10.0, L - 10.0, 50)
    for positions in (frames.positions[-1], mirrored.positions[-1]):
        assert np.all(np.isfinite(positions))
    shapes = [np.interp(at, f.positions[-1][:, 0], f.positions[-1][:, 2]) for f in (frames, mirrored)]
    np.testing.assert_allclose(shapes[0], shapes[1], atol=3e-4)  # of 0.15 um: straight lines between stations
    assert mirrored.positions.shape[1] == half_system.n_beads


def test_the_whole_of_the_half_is_what_was_built():
    plan, system = planned({"model.symmetry": "half", "assembly.count": 7, "assembly.jitter": "0.1 um"})
    half, half_plan = right_half(system, plan)
    assert half.n_filaments == 7 and len(half_plan.beads.stations) == len(plan.beads.stations) // 2 + 1
    np.testing.assert_allclose(whole_of(half.positions, system, plan), system.positions, atol=1e-9)
    assert math.isclose(np.sum(half_plan.beads.mass[1:]) * 2, np.sum(plan.beads.mass), rel_tol=1e-12)
    same, same_plan = right_half(*reversed((replace(plan, beads=replace(plan.beads, support="simple")), system)))
    assert same is system and same_plan.beads.stations is plan.beads.stations


@pytest.mark.parametrize(
    ("overrides", "why"),
    [
        (["model.level=rod"], "only chains"),
        (["ends.support=symmetry"], "periodic cell"),
        (["assembly.twist=0.3 turn/cm", "model.level=chain"], "mirror image"),
    ],
)
def test_what_is_not_symmetric_is_not_halved(overrides, why):
    with pytest.raises(InputError, match=why) as refusal:
        make_plan(load_scene("carbon-7", [*overrides, "model.symmetry=half"]))
    assert refusal.value.key == "model.symmetry"
    plan = make_plan(load_scene("carbon-7", overrides))
    assert plan.beads.support != "symmetric" and any(why in c.reason for c in plan.choices)
