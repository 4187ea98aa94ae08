import tomllib

import numpy as np
import pytest
from scene_tables import ABSENT, with_changes

from cgfibre.build import weave
from cgfibre.errors import InputError
from cgfibre.plan.make import make_plan
from cgfibre.scene_assembly import interlacing
from cgfibre.scene_reading import load_scene, scene_from_dict

WEAVE = {
    "filament": {"material": "nylon"},
    "assembly": {
        "kind": "weave",
        "spacing": "5 mm",
        "tow": {"thickness": "1.2 mm", "filaments": 30},
    },
    "platens": {"stop": {"pressure": "0.2 MPa"}},
}
SHIPPED = ("nylon-weave", "nylon-weave-filaments", "carbon-weave", "glass-weave", "glass-twill", "carbon-satin")


def changed(changes):
    return with_changes(WEAVE, changes)


def test_a_short_weave_is_filled_and_written_back():
    s = scene_from_dict(WEAVE)
    w = s.weave
    assert (w.pattern, w.cell, w.rest, w.gap) == ("plain", "periodic", "stress-free", 0.0)
    assert (w.tows.warp, w.tows.weft, w.size) == (2, 2, (1e4, 1e4))  # a repeat
    assert w.weft == w.tow and w.tow.width == w.tow.thickness == 1200.0
    assert s.in_plane.at_rest and s.cell is None
    assert scene_from_dict(tomllib.loads(s.to_toml())) == s


def test_weft_takes_what_it_is_not_given_from_the_warp():
    s = scene_from_dict(
        changed({"assembly.weft": {"filaments": 20}, "assembly.spacing": {"warp": "5 mm", "weft": "4 mm"}})
    )
    assert (s.weave.tow.filaments, s.weave.weft.filaments, s.weave.weft.thickness) == (30, 20, 1200.0)
    assert s.weave.size == (8000.0, 10000.0)  # weft tows are 4 mm apart, along x
    assert scene_from_dict(tomllib.loads(s.to_toml())) == s


def test_patterns_are_those_of_the_builder():
    """Over b, under a in one direction: the same fabric, perhaps counted from another tow or seen from below."""

    def alike(one, two):
        shifts = [np.roll(two, (i, j), (0, 1)) for i in range(len(two)) for j in range(len(two))]
        return any(np.array_equal(one, s) for s in shifts)

    assert interlacing("plain") == ((True, False), (False, True))
    assert interlacing("basket-2")[0] == (True, True, False, False)
    for a, b in ((1, 2), (2, 2), (3, 1)):
        mine = np.array(interlacing(f"twill-{a}/{b}"))
        assert mine.sum(axis=0).tolist() == mine.sum(axis=1).tolist() == [a] * (a + b)
        assert alike(mine, weave.twill(a, b)) or alike(mine[::-1], weave.twill(a, b))
    for n in (5, 8):
        mine = np.array(interlacing(f"satin-{n}"))
        assert mine.sum(axis=0).tolist() == mine.sum(axis=1).tolist() == [1] * n
        # no two crossings of neighbouring tows beside each other
        column = mine.argmax(axis=1)
        assert np.all(np.abs(np.diff(column)) > 1)
        assert any(alike(~mine, weave.satin(n, k)) for k in range(2, n - 1) if np.gcd(k, n) == 1)


def test_in_plane_and_laws_are_read():
    s = scene_from_dict(changed({"cell": {"tension": "2 N", "shear": "0 deg"}, "contact": {"law": "exponential"}}))
    assert s.in_plane.tension.warp == s.in_plane.tension.weft == 2e9 and not s.in_plane.at_rest
    rows = "overlap (um),pressure (MPa)\n0,0\n50,1\n100,4\n"
    s = scene_from_dict(changed({"contact": {"law": "table", "table": rows}}))
    assert s.contact.table.of == "pressure" and s.contact.table.rows[-1] == (100.0, 4000.0, None)
    assert scene_from_dict(tomllib.loads(s.to_toml())) == s
    rows = "overlap (um),force_per_length (N/mm),unloading (N/mm)\n0,0,0\n50,1,0.5\n100,4,4\n"
    law = scene_from_dict(changed({"contact": {"law": "table", "table": rows}})).contact.table
    assert law.of == "force_per_length" and law.rows[1] == (50.0, 1e6, 5e5)


@pytest.mark.parametrize(
    ("changes", "key", "part"),
    [
        ({"assembly.pattern": "herringbone"}, "assembly.pattern", "'twill-2/2'"),
        ({"assembly.pattern": "satin-4"}, "assembly.pattern", "'satin-5'"),
        ({"assembly.pattern": ["10", "1"]}, "assembly.pattern", "rows such as"),
        ({"assembly.tows": 3}, "assembly.tows.warp", "a multiple of 2"),
        ({"assembly.spacing": "1 mm"}, "assembly.spacing.warp", "at least 1200 um"),
        ({"assembly.tow.filaments": ABSENT}, "assembly.tow.filaments", "a number of filaments"),
        ({"assembly.tow.width": "1 mm"}, "assembly.tow.width", "at least the thickness"),
        ({"assembly.tow.wide": "1 mm"}, "assembly.tow.wide", "did you mean assembly.tow.width"),
        ({"assembly.length": "1 mm"}, "assembly.length", "a known key"),
        ({"ends.tension": "0.1 N"}, "ends", "a cell has no ends"),
        ({"platens.width": "1 mm"}, "platens", "platens cover all of a weave"),
        ({"platens.stop": {"displacement": "2.4 mm"}}, "platens.stop.displacement", "less than the thickness"),
        ({"model.level": "section"}, "model.level", "'auto', 'chain' or 'rod'"),
        ({"model.far_field": "graded"}, "model.far_field", "no such key"),
        ({"contact.law": "table"}, "contact.table", "a CSV file"),
        ({"contact.rise": "10 um"}, "contact.rise", "it belongs to law = 'exponential'"),
        ({"contact.law": "line", "contact.stiffness": 0.1}, "contact.stiffness", "laws 'linear' and 'exponential'"),
        ({"contact.law": "linear", "model.resolve": "filament"}, "contact.law", "with model.resolve = 'filament'"),
        ({"cell": {"strain": {"x": 0.1}, "tension": "1 N"}}, "cell.tension.warp", "0 N where cell.strain.x is given"),
        ({"cell": {"shear": "70 deg"}}, "cell.shear", "below"),
        ({"cell": {"shear": "10 deg", "when": "later"}}, "cell.when", "'during'"),
        ({"cell": {"shear": "10 deg", "over": "50 um"}}, "cell.over", "it belongs to 'during'"),
        ({"cell": {"shear": "10 deg", "when": "during", "over": "0 um"}}, "cell.over", "'auto' or a length"),
        ({"cell": {"tension": "1 N", "when": "after"}}, "cell.tension.warp", "edges = 'free', with when = 'after'"),
    ],
)
def test_a_bad_weave_gives_one_line_that_names_the_key(changes, key, part):
    with pytest.raises(InputError) as caught:
        scene_from_dict(changed(changes))
    assert caught.value.key == key and part in str(caught.value) and "\n" not in str(caught.value)


def test_bundles_refuse_what_is_a_weaves():
    bundle = {
        "filament": {"material": "T700 carbon"},
        "assembly": {"count": 37, "length": "0.7 mm"},
        "platens": {"width": "0.5 mm", "stop": {"displacement": "30 um"}},
    }
    for change, key in (
        ({"cell": {"shear": "5 deg"}}, "cell"),
        ({"contact": {"law": "linear"}}, "contact.law"),
        ({"contact": {"stiffness": 0.1}}, "contact.stiffness"),
        ({"model": {"resolve": "tow"}}, "model.resolve"),
    ):
        with pytest.raises(InputError) as caught:
            scene_from_dict(bundle | change)
        assert caught.value.key == key


def test_plans_say_the_order_and_the_time_of_what_happens_in_the_plane():
    """Before: steps while the platens wait; during: a way of the platen, slow enough; after: while it is held."""

    def plan_of(cell, **more):
        return make_plan(scene_from_dict(changed({"cell": cell} | more)))

    def said(plan):
        return {c.what: c for c in plan.choices}

    held, before = plan_of({}), plan_of({"shear": "50 deg"})
    assert said(held)["in the plane"].value == "held" and "trellis" not in said(held)
    assert "before the platens move" in said(before)["in the plane"].reason
    assert "from 45.7 deg on, lie side by side at 76.1 deg" in said(before)["trellis"].value
    assert before.woven.steps_before > 1.2 * before.woven.preparation > 0
    assert before.motion == held.motion and before.predicted_seconds > 1.5 * held.predicted_seconds
    during = plan_of({"strain": {"x": 0.01}, "when": "during"})
    assert during.woven.steps_before == 0 and f"{during.woven.over:.4g} um" in said(during)["in the plane"].reason
    assert plan_of({"shear": "5 deg", "when": "during", "over": "12 um"}).woven.over == 12.0
    stop = {"platens.stop": {"displacement": "90 um"}}
    assert plan_of({"shear": "5 deg", "when": "during"}, **stop).woven.over == 90.0
    # a way that the platen goes in less than ten of the fabric's periods slows it
    short = plan_of({"shear": "5 deg", "when": "during", "over": "5 um"})
    assert short.motion.first < 0.7 * during.motion.first and short.motion.pace < during.motion.pace
    after = plan_of({"shear": "5 deg", "when": "after"}, **{"platens.hold": "1 ms"})
    rows = after.sampling.sample
    assert after.motion.hold_steps >= after.woven.preparation + 1e3 / after.timestep
    assert after.motion.hold_steps - after.woven.preparation < 1e3 / after.timestep + rows + 1
    assert "behind the last loading" in said(after)["in the plane"].reason
    patch = plan_of({"tension": "1 N"}, **{"assembly.cell": "patch"})
    assert patch.woven.moved and not patch.woven.periodic and patch.woven.tension == (2e9, 2e9)


@pytest.mark.parametrize("name", SHIPPED)
def test_shipped_weaves_plan_with_reasons(name):
    scene = load_scene(name)
    assert scene_from_dict(tomllib.loads(scene.to_toml())) == scene
    plan = make_plan(scene)
    assert plan.woven is not None and plan.woven.periodic and plan.woven.at_rest
    assert plan.woven.resolve == ("filament" if "filaments" in name else "tow")
    assert 0 < plan.timestep < plan.timestep_limit and plan.planned_steps > 1000
    assert all(c.reason for c in plan.choices) and all(o.error for o in plan.omissions)
