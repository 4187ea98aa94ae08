"""Capsules on ranks, sorted, over joints and in odd places: what the cases of the suite (test_cases.py) do not ask."""

import numpy as np
import pytest

from cgfibre.cases import capsule_ranks as ranks

levels = pytest.mark.parametrize("level", ["chain", "rod"])


@pytest.fixture(scope="module")
def one_rank(tmp_path_factory):
    """level: plan, system as pressed, outcome on one rank; computed once."""
    done = {}

    def of(level):
        if level not in done:
            done[level] = ranks.pressed(tmp_path_factory.mktemp(level) / "one", level, 1, steps=1600)
        return done[level]

    return of


def same_forces(tmp_path, one_rank, level, n):
    plan, pressed, _ = one_rank(level)
    for name, system in (("squeezed", ranks.squeezed(pressed)), ("pressed", pressed)):
        expected, rows = ranks.forces(tmp_path / f"{name}-1", system, plan, 1)
        found, others = ranks.forces(tmp_path / f"{name}-{n}", system, plan, n)
        assert len(rows) > 50 and np.max(np.abs(expected)) > 1e6
        assert np.allclose(found, expected, rtol=0, atol=1e-12 * np.max(np.abs(expected)))
        assert rows.shape == others.shape
        assert np.allclose(rows, others, rtol=1e-12, atol=1e-9)


@levels
def test_two_ranks_find_the_same_forces(tmp_path, one_rank, level):
    same_forces(tmp_path, one_rank, level, 2)


@pytest.mark.validate
@levels
def test_four_ranks_find_the_same_forces(tmp_path, one_rank, level):
    same_forces(tmp_path, one_rank, level, 4)


@levels
def test_two_ranks_press_to_the_same_curve(tmp_path, one_rank, level):
    """With friction on: histories go with their beads from rank to rank. Rounding is amplified by the contacts."""
    expected = one_rank(level)[2].record.mean["top_force"]
    found = ranks.pressed(tmp_path / "two", level, 2, steps=1600)[2].record.mean["top_force"]
    assert np.max(expected) > 1e5
    assert np.allclose(found, expected, rtol=1e-7, atol=1e-7 * np.max(expected))


@levels
def test_sorted_atoms_press_to_the_same_curve(tmp_path, one_rank, level):
    expected = one_rank(level)[2].record.mean["top_force"]
    sort = ["atom_modify sort 50 40.0"]
    found = ranks.pressed(tmp_path / "sorted", level, 1, sort, steps=1600)[2].record.mean["top_force"]
    assert np.allclose(found, expected, rtol=1e-7, atol=1e-7 * np.max(expected))
