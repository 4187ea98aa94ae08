"""Platens that are curved across a section: two discs against their closed form, a bundle between two of them."""

import math

import numpy as np
import pytest
from scipy.optimize import brentq

from cgfibre import workflow
from cgfibre.build.system import FloatArray
from cgfibre.engine.assemble import platen_heights
from cgfibre.errors import InputError
from cgfibre.plan.section_platens import first_touch, middle_gap
from cgfibre.plan.system import build_system
from cgfibre.review import platen_gaps
from cgfibre.scene_reading import load_scene

CURVED = ("model.level=section", "platens.shape=crimped", "contact.friction=0", "platens.friction=0")
#: two discs off the middle, a third one far below them
CENTRES = "y_um,z_um\n-20,5\n20,5\n0,-10\n"


def two_discs(k: float, kn: float, displacement: FloatArray, radius: float, convex: bool, r: float = 3.5) -> FloatArray:
    """Force on a frictionless cylinder, nN, that presses discs at (+-20, 5) on springs k; overlap N/kn.

    A disc moves by N/k along the normal, whose direction is that from the axis to the disc.
    """
    b, z = 20.0, 5.0
    out = radius + r if convex else radius - r
    axis = z + math.sqrt(out**2 - b**2) * (1 if convex else -1)

    def off(N: float, d: float) -> float:
        reach = out - N / kn if convex else out + N / kn
        # from the axis to the disc, before and after: the spring's end is N/k back along the normal
        rest = math.hypot(b, z - axis + d)
        return reach + (-N / k if convex else N / k) - rest

    forces = []
    for d in displacement:
        high = 10 * k * max(d, 1e-3)
        N = brentq(off, 0.0, high, args=(d,)) if d > 0 else 0.0
        forces.append(2 * N * abs(z - axis + d) / math.hypot(b, z - axis + d))
    return np.array(forces)


@pytest.mark.parametrize("curvature", ["convex", "concave"])
def test_two_discs_under_a_curved_platen(bench, curvature):
    centres = bench.folder / "centres.csv"
    centres.write_text(CENTRES)
    asked = ("assembly.arrangement=file", f"assembly.centres={centres}", "assembly.jitter=0 um")
    curve = (f"platens.curvature={curvature}", "platens.crimp_angle=30 deg", "platens.crimp_width=60 um")
    motion = ("platens.crimp_side=top", "platens.speed=0.02 m/s", "platens.unload=false")
    run = bench.run("run", *CURVED, *asked, *curve, *motion, "model.spring=exact")  # as linear as the closed form
    _, plan = workflow.plan_scene(run.out / "scene.toml")
    assert plan.platens.crimp_radius == pytest.approx(60.0)
    c = run.curve
    exact = two_discs(plan.springs[0], plan.platens.kn, c["displacement_um"], 60.0, curvature == "convex")
    late = c["displacement_um"] > 1.0
    assert c["force_top_N"][late] == pytest.approx(exact[late] * 1e-9, rel=5e-4)
    flat = 2 * plan.springs[0] * c["displacement_um"] * 1e-9
    assert np.all(c["force_top_N"][late] < 0.95 * flat[late]), "they give way sideways"
    assert run.summary["warnings"] == [] or not any("platen" in w for w in run.summary["warnings"])


def test_a_bundle_between_two_curved_platens(bench):
    """Nothing but the platens holds a periodic section: both carry the same; frames keep out of the platens."""
    cell = ("ends.support=symmetry", "platens.width=full", "platens.speed=0.1 m/s", "platens.stop.displacement=9 um")
    curve = ("platens.crimp_angle=10 deg", "platens.unload=false", 'platens.cycles=[{displacement="8 um"}]')
    run = bench.run("run", *CURVED[:2], *cell, *curve)
    c = run.curve
    high = c["force_top_N"] > 0.3 * c["force_top_N"].max()
    assert c["force_bottom_N"][high].mean() == pytest.approx(c["force_top_N"][high].mean(), rel=0.05)
    _, plan = workflow.plan_scene(run.out / "scene.toml")
    assert plan.platens.bottom_crimped
    scene_guards = {g["name"]: g["ok"] for g in run.summary["guards"]}
    assert scene_guards["beads past the top platen"] and scene_guards["beads past the bottom platen"]


@pytest.mark.parametrize("curvature", ["convex", "concave"])
@pytest.mark.parametrize("side", ["both", "top"])
def test_platens_first_touch_at_displacement_zero_and_thickness_is_at_the_middle(curvature, side):
    asked = [*CURVED, f"platens.curvature={curvature}", f"platens.crimp_side={side}", "platens.crimp_angle=20 deg"]
    asked += ["assembly.arrangement=rectangular", "platens.stop.thickness=16 um"]
    scene = load_scene("carbon-37-section", [*asked, "assembly.count=36"])
    _, plan = workflow.plan_scene("carbon-37-section", [*asked, "assembly.count=36"])
    system = build_system(scene, plan)
    r = system.diameter / 2
    for gap in platen_gaps(plan, system, 0.0):
        assert np.min(gap(system.positions) - r) == pytest.approx(0, abs=1e-9)
    top, bottom = platen_heights(system, plan)
    gap = middle_gap(plan.platens, system.positions[:, 1:], r)
    assert top - bottom == pytest.approx(gap)
    assert gap - plan.motion.planned_displacement == pytest.approx(16.0, abs=0.5)  # jitter
    assert any(c.what == "crimped platens" and "middle" in c.reason for c in plan.choices)
    half = plan.width / 2
    assert plan.platens.crimp_radius == pytest.approx(half / math.sin(math.radians(20)))


def test_a_disc_beside_the_cylinder_is_refused():
    asked = [*CURVED, "platens.crimp_angle=40 deg", "platens.crimp_width=10 um"]
    with pytest.raises(InputError) as error:
        workflow.plan_scene("carbon-37-section", asked)
    assert error.value.key == "platens.crimp_width"


def test_where_a_cylinder_touches_one_disc():
    scene = load_scene("carbon-37-section", [*CURVED, "platens.crimp_angle=30 deg", "platens.crimp_width=60 um"])
    _, plan = workflow.plan_scene(
        "carbon-37-section", [*CURVED, "platens.crimp_angle=30 deg", "platens.crimp_width=60 um"]
    )
    p = plan.platens
    assert scene.platens.crimp_width == 60.0 and p.crimp_centre == pytest.approx(0, abs=1e-9)
    at_middle = np.array([[0.0, 2.0]])
    assert first_touch(p, at_middle, 3.5, True, 1.0) == pytest.approx(5.5)
    assert first_touch(p, at_middle, 3.5, True, -1.0) == pytest.approx(-1.5)
    aside = np.array([[63.5 * 0.6, 0.0]])  # 3-4-5: the axis is 63.5 x 0.8 above
    assert first_touch(p, aside, 3.5, True, 1.0) == pytest.approx(63.5 * 0.8 - 60)
