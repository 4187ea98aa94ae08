"""What the planner chooses, why, what it promises; and that every choice can be overruled."""

import math

import numpy as np
import pytest

from cgfibre.errors import InputError
from cgfibre.mechanics import rod
from cgfibre.plan import level as levels
from cgfibre.plan.contact import OVERLAP_LIMIT
from cgfibre.plan.cost import COSTS, predicted_seconds
from cgfibre.plan.make import make_plan, other_levels
from cgfibre.plan.outline import outline
from cgfibre.plan.promise import NOTHING
from cgfibre.report import print_plan
from cgfibre.scene_reading import load_scene
from cgfibre.workflow import RunOptions, run_scene

PERIODIC = ("ends.support=symmetry", "platens.width=full", "assembly.length=35 um", "ends.tension=0 N")


def planned(base, *overrides):
    return make_plan(load_scene(base, overrides))


def chosen(plan, what):
    return next(c for c in plan.choices if c.what == what)


# --- level -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("overrides", "level", "why"),
    [
        ((), "chain", "too little to roll"),
        (("assembly.twist=0.26 turn/cm",), "chain", "too little to roll"),  # of a real tow: 0.04 um of straightening
        (("assembly.twist=3.6 turn/cm",), "rod", "curved rest shape"),
        (('assembly.migration={period="400 um"}', "assembly.void_fraction=0.6"), "rod", "curved rest shape"),
        (PERIODIC, "section", "nothing varies"),
        (("model.accuracy=0.4",), "section", "accuracy 0.4"),
        (("model.accuracy=0.2",), "chain", "too little to roll"),
        (("assembly.length=20 mm", "platens.stop.displacement=6 um"), "chain", "too little to roll"),
        (("filament.G12=1 MPa",), "chain", "level = 'rod' rolls"),
        (("model.level=rod",), "rod", "as asked"),
    ],
)
def test_the_least_level_that_a_scene_needs(overrides, level, why):
    plan = planned("carbon-37", *overrides)
    assert plan.level == level
    assert why in chosen(plan, "level").reason


def test_a_filament_that_wants_to_be_straight_moves_by_its_curvature_over_its_span():
    scene = load_scene("carbon-37", ["assembly.twist=3.6 turn/cm", "ends.tension=0 N"])
    out = outline(scene)
    tau = 3.6e-4
    assert levels.natural_curvature(scene, out) == pytest.approx(out.radius() * (2 * math.pi * tau) ** 2)
    assert levels.straightening(scene, out) == pytest.approx(levels.natural_curvature(scene, out) * 700**2 / 8)
    # a tension of 4 EI/L^2 halves nothing, more of it shortens the arm to sqrt(EI/P)
    tight = load_scene("carbon-37", ["assembly.twist=3.6 turn/cm", "ends.tension=0.4 N"])
    assert levels.straightening(tight, out) == pytest.approx(
        levels.natural_curvature(tight, out) * out.filament.EI / 4e8
    )


def test_friction_turns_long_filaments_and_rolling_costs_what_it_is_worth():
    """Turn = mu N (D/2) L/(4 GJ); no rolling errs by nothing at small turns and by ROLLING_ERROR at large ones."""
    scene = load_scene("carbon-37", ["platens.stop.displacement=8 um"])
    out = outline(scene)
    normal = out.bending_force(scene, 4.0) / math.sqrt(37)
    assert levels.rolling_turn(scene, out) == pytest.approx(0.2 * normal * 3.5 * 700 / (4 * out.filament.GJ))
    assert levels.rolling_error(0.1) < 0.01 < 0.9 * levels.ROLLING_ERROR < levels.rolling_error(4.0)
    assert [p.what for p in levels.level_errors(scene, out, "rod")] == []
    assert [p.what for p in levels.level_errors(scene, out, "section")] == ["section"]


# --- spacing, softening, symmetry ------------------------------------------------------------------------------------


@pytest.mark.parametrize("width", [0.0, 100.0, 400.0])
def test_a_chains_bending_error_is_that_of_the_trapezoidal_rule(width):
    """Energy of bending, the integral of M^2, by hinges s apart; M rises over a and is even between the edges."""
    length, s = 700.0, 5.0
    a = (length - width) / 2
    x = np.arange(0.0, length + s / 2, s)
    moment = np.minimum(np.minimum(x, length - x), a)
    hinges = s * np.sum(moment**2)
    exact = 2 * a**3 / 3 + a**2 * width
    assert rod.chain_bending_error(s, length, width=width) == pytest.approx(hinges / exact - 1, rel=1e-9)
    with pytest.raises(InputError, match="less than the span"):
        rod.chain_bending_error(s, length, width=length)


def test_one_filament_alone_is_as_coarse_as_its_bending_allows():
    fine, coarse = (
        planned(
            "carbon-37",
            "assembly.count=1",
            "platens.stop.displacement=3 um",
            "model.level=chain",
            f"model.accuracy={a}",
            "contact.shape=beads",
        )
        for a in (0.05, 0.4)
    )
    assert coarse.spacing > 2 * fine.spacing > 13
    for plan, accuracy in ((fine, 0.05), (coarse, 0.4)):
        assert rod.chain_bending_error(plan.spacing, 700.0, width=500.0) <= 0.1 * accuracy * 1.001
        assert plan.spacing / 500 <= 0.3 * accuracy * 1.001
    beads = "contact.shape=beads"
    assert planned("carbon-37", beads).spacing <= 7.0  # neighbours' beads have to meet
    assert planned("carbon-37-full-length", "assembly.count=1", "platens.stop.displacement=3 um", beads).spacing <= 7.0


def test_segments_are_as_long_as_bending_and_curvature_allow():
    plan = planned("carbon-37")
    assert plan.contact.shape == "capsule" and 26 < plan.spacing <= 28
    assert planned("carbon-37", "model.accuracy=0.01").spacing < 20
    twisted = planned("carbon-127-twisted")
    out = outline(load_scene("carbon-127-twisted"))
    assert twisted.spacing**2 * levels.natural_curvature(load_scene("carbon-127-twisted"), out) / 8 <= 0.01 * 7 * 1.001
    assert planned("carbon-37", "assembly.length=140 um", "platens.width=70 um").spacing <= 140 / 16 * 1.001


def test_line_contacts_are_softened_as_far_as_the_expected_load_allows():
    """Deep in the jam contacts are real; to 12 um softening lengthens the step."""
    assert planned("carbon-37").contact.softening == 1
    shallow = planned("carbon-37", "platens.stop.displacement=12 um")
    assert 2 < shallow.contact.softening < 6
    assert shallow.timestep > 1.3 * planned("carbon-37").timestep
    assert planned("carbon-37", "contact.softening=2").contact.softening == 2


def test_stiff_contacts_are_softened_to_bending_as_far_as_the_overlap_allows():
    beads = "contact.shape=beads"
    assert planned("carbon-37", beads).contact.softening == 1  # softer than its bending as they are
    glass = planned("carbon-37", "filament.material=E-glass", beads)
    scene = load_scene("carbon-37", ["filament.material=E-glass"])
    assert glass.contact.softening > 1
    overlap = (
        glass.contact.softening * scene.contact.line_load / glass.contact.line_stiffness / glass.platens.top_span[0]
    )
    assert overlap < OVERLAP_LIMIT
    added = glass.contact.softening * scene.contact.line_load / glass.contact.line_stiffness
    assert added <= OVERLAP_LIMIT * scene.filament.diameter * 1.001
    assert glass.timestep > planned("carbon-37", "filament.material=E-glass", "contact.softening=1", beads).timestep


def test_symmetry_halves_the_beads_and_the_time():
    shallow = "platens.stop.displacement=14 um"
    for shape, share in (("beads", 0.53), ("capsule", 0.57)):  # 14 and a held one of 27
        asked = (shallow, f"contact.shape={shape}")
        half, whole = planned("carbon-37", *asked), planned("carbon-37", *asked, "model.symmetry=none")
        assert half.n_beads < share * whole.n_beads
        assert half.predicted_seconds < 0.7 * whole.predicted_seconds
    deep = planned("carbon-37")
    assert "buckling takes sides" in chosen(deep, "symmetry").reason
    assert planned("carbon-37", "model.symmetry=half").n_beads < 0.57 * deep.n_beads


@pytest.mark.parametrize(
    ("override", "what", "value"),
    [
        ("model.level=chain", "level", "chain"),
        ("model.spacing=5 um", "bead spacing", "5 um at most"),
        ("model.far_field=none", "far field", "none"),
        ("model.symmetry=none", "symmetry", "none"),
        ("model.axial_softening=2", "axial softening", "2"),
        ("contact.softening=3", "contact softening", "3"),
        ("model.timestep=0.0001 us", "time step", "0.0001 us"),
        ("platens.speed=0.1 m/s", "platen speed", "0.1 m/s"),
    ],
)
def test_every_choice_can_be_overruled(override, what, value):
    choice = chosen(planned("carbon-37", override), what)
    assert choice.value == value and "as asked in the scene" in choice.reason
    assert "as asked" not in chosen(planned("carbon-37"), what).reason


# --- what is promised ------------------------------------------------------------------------------------------------


def test_the_promise_is_the_sum_of_its_parts_and_follows_the_speed():
    plan = planned("carbon-37")
    assert plan.promised_error == pytest.approx(sum(p.value for p in plan.promise))
    assert all(p.value >= 0 and p.reason for p in plan.promise)

    def speed(*overrides):
        return next(p.value for p in planned("carbon-37", *overrides).promise if p.what == "platen speed")

    assert speed("model.accuracy=0.1") == pytest.approx(2 * speed(), rel=0.02)
    assert speed("platens.speed=2 m/s") > speed("platens.speed=1 m/s") > speed()


def test_a_speed_far_too_high_is_promised_nothing(capsys):
    scene = load_scene("carbon-127-section", ["assembly.length=345 mm", "platens.speed=4 m/s"])
    plan = make_plan(scene)
    assert next(p for p in plan.promise if p.what == "platen speed").value == NOTHING
    print_plan(scene, plan, brief=True)
    assert "no promise" in capsys.readouterr().out.replace("\n", " ")


def test_time_goes_with_steps_and_beads():
    plan = planned("carbon-37", "platens.unload=false")
    both = planned("carbon-37")
    cost = COSTS["chain, capsules"]
    steps = both.planned_steps - plan.planned_steps
    per_step = cost.step + cost.bead * plan.n_beads + cost.block / plan.sampling.block
    assert both.predicted_seconds - plan.predicted_seconds == pytest.approx(
        steps * per_step, rel=0.1
    )  # blocks differ a little
    assert predicted_seconds("rod", 100, plan.motion, plan.sampling) > predicted_seconds(
        "chain", 100, plan.motion, plan.sampling
    )


# --- a periodic cell -------------------------------------------------------------------------------------------------


@pytest.mark.validate
def test_where_nothing_varies_a_section_stands_for_every_rod(tmp_path):
    """Seven loose filaments between full platens: rods that turn freely and discs lock at the same thickness.

    Both feel next to nothing until they lock; there the thickness at 1 mN agrees to 5 % D (bumps of rods in register
    play no part; jitter and the order of sliding do).
    """
    overrides = (
        *PERIODIC,
        "assembly.jitter=0.3 um",
        "platens.stop.force=20 mN",
        "platens.unload=false",
        "model.speed_check=false",
        "contact.softening=3",
    )
    at = {}
    for level in ("auto", "rod"):
        out = run_scene("carbon-7", RunOptions(tmp_path / level), [*overrides, f"model.level={level}"])
        force, thickness = out.curve["force_top_N"], out.curve["thickness_um"]
        at[out.summary["level"]] = thickness[np.argmax(force > 1e-3)]
    assert at["section"] == pytest.approx(at["rod"], abs=0.35)


# --- other levels ----------------------------------------------------------------------------------------------------


def test_other_levels_are_planned_or_refused_with_the_reason():
    scene = load_scene("carbon-37")
    others = other_levels(scene, make_plan(scene))
    assert set(others) == {"rod", "section", "subbundle"}
    assert isinstance(others["subbundle"], InputError)  # too few layers of sub-bundles
    assert others["rod"].predicted_seconds > make_plan(scene).predicted_seconds > others["section"].predicted_seconds
    assert others["section"].promised_error > make_plan(scene).promised_error
    twisted = load_scene("carbon-37", ["assembly.twist=3.6 turn/cm"])
    refused = other_levels(twisted, make_plan(twisted))["section"]
    assert isinstance(refused, InputError) and refused.key == "assembly.twist"
