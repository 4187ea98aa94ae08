"""Random scenes over the whole schema: refused, stopped with a remedy, flagged or trusted with reason; nothing else."""

from collections import Counter

import pytest
from hypothesis import HealthCheck, given, settings
from random_scenes import built, fate_of, random_scenes, scenes_of

from cgfibre import workflow

FATES = {"refused", "stopped", "flagged", "trusted", "dear"}


@settings(max_examples=80, deadline=None, derandomize=True, database=None, suppress_health_check=list(HealthCheck))
@given(random_scenes())
def test_every_scene_is_planned_and_built_or_refused_in_words(data):
    fate = built(data)
    assert fate.kind in ("built", "refused") and not fate.offence, (fate, data)


def ends_well(data, folder, check_speed, **options):
    fate = fate_of(data, folder, check_speed, **options)
    assert fate.kind in FATES and not fate.offence, (fate, data)
    return fate.kind


def test_a_few_scenes_end_as_scenes_may(tmp_path, monkeypatch):
    """Fifteen of them, small; the first that runs is drawn too."""
    draw, count = workflow.draw_all, Counter()
    for i, data in enumerate(scenes_of(0, 15)):
        ran = count["flagged"] + count["trusted"]
        monkeypatch.setattr(workflow, "draw_all", draw if ran == 0 else lambda *args, **kwargs: [])
        count[ends_well(data, tmp_path / str(i), i % 5 == 0, cap=0.3)] += 1
    assert count["refused"] >= 1 and count["flagged"] + count["trusted"] >= 4, count


@pytest.mark.validate
def test_five_hundred_scenes_end_as_scenes_may(tmp_path, monkeypatch):
    """Those of `python analysis/random_scenes.py 0 20`; every second trusted one runs at half its speed too."""
    monkeypatch.setattr(workflow, "draw_all", lambda *args, **kwargs: [])
    count = Counter()
    for block in range(20):
        for i, data in enumerate(scenes_of(block)):
            count[ends_well(data, tmp_path / f"{block}-{i}", i % 2 == 0)] += 1
    assert sum(count.values()) == 500
    # each kind of end was met, most scenes ran
    assert all(count[kind] for kind in ("refused", "stopped", "flagged", "trusted")), count
    assert count["dear"] < 50, count
