"""Discs, spheres and walls with a tabulated normal force in the engine: pair and fix wall granular/table."""

import math
import re
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.interpolate import PchipInterpolator

from cgfibre.engine.lammps import find_engine, run_deck
from cgfibre.engine.plugin import NoCompilerError, build_plugin
from cgfibre.errors import EngineError
from cgfibre.mechanics.contact import LineContact

#: loading: soft, then stiff, with a flat piece; unloading from 0.8 um: residual overlap of 0.25 um
LOAD = np.array([[0, 0], [0.1, 3], [0.3, 20], [0.4, 20], [0.5, 45], [0.8, 200], [1.0, 260]], dtype=float)
UNLOAD = np.array([[0.25, 0], [0.4, 8], [0.6, 40], [0.7, 100], [0.8, 200]], dtype=float)
TABLES = "table tables.txt LOAD"
BOTH = f"{TABLES} unload UNLOAD"
RADIUS = 3.5


def section(keyword, rows):
    body = "\n".join(f"{k} {d!r} {f!r}" for k, (d, f) in enumerate(rows.tolist(), 1))
    return f"{keyword}\nN {len(rows)}\n\n{body}\n\n"


@dataclass(frozen=True)
class Curve:
    """scipy's curve with the ends of the plugin: (0, 0) first, last slope beyond."""

    rows: np.ndarray

    @cached_property
    def pchip(self):
        rows = self.rows if self.rows[0, 0] == 0 else np.vstack([[0.0, 0.0], self.rows])
        return PchipInterpolator(rows[:, 0], rows[:, 1])

    def __call__(self, d):
        last = self.rows[-1, 0]
        beyond = self.pchip(last) + self.pchip(last, 1) * (d - last)
        return np.where(d <= 0, 0.0, np.where(d < last, self.pchip(np.clip(d, 0, last)), beyond))

    def energy(self, d):
        return self.pchip.antiderivative()(d)


LOADING, UNLOADING = Curve(LOAD), Curve(UNLOAD)


def branch(overlap):
    """Force along a history of overlaps (in order), the rule of the plugin written out."""
    force, deepest, r = np.zeros_like(overlap), 0.0, UNLOAD[-1, 0]
    for k, d in enumerate(overlap):
        deepest = 0.0 if d <= 0 else max(d, deepest)
        if d > 0:
            shape = 1.0 if d >= deepest else UNLOADING(d * r / deepest) / UNLOADING(r)
            force[k] = min(LOADING(d), LOADING(deepest) * shape)
    return force


@pytest.fixture(scope="module")
def library():
    try:
        return build_plugin().library
    except NoCompilerError as error:
        pytest.skip(str(error))


@dataclass(frozen=True)
class Decks:
    """Runs hand-written decks in a folder with the plugin and the tables beside them."""

    folder: Path

    def run(self, deck, ranks=1, **variables):
        """Rows of thermo output by column name, of all runs of the deck."""
        (self.folder / "in.test").write_text(deck)
        run_deck(find_engine(), self.folder, "in.test", ranks, {k: str(v) for k, v in variables.items()})
        columns: dict[str, list[float]] = {}
        names: list[str] = []
        for line in (self.folder / "log.lammps").read_text().splitlines():
            words = line.split()
            if words[:1] == ["Step"]:
                names = words
            elif words[:2] == ["Loop", "time"]:
                names = []
            elif names and len(words) == len(names) and re.fullmatch(r"\d+", words[0]):
                for name, word in zip(names, words, strict=True):
                    columns.setdefault(name, []).append(float(word))
        return {name: np.array(values) for name, values in columns.items()}

    def dump(self, name):
        """Rows of the last frame of a dump, sorted by id."""
        text = (self.folder / name).read_text().rpartition("ITEM: ")[2].splitlines()
        return dict(zip(text[0].split()[1:], np.array([row.split() for row in text[1:]], dtype=float).T, strict=True))

    def locals(self, name):
        """Rows of all frames of a local dump, the columns as they come."""
        frames = (self.folder / name).read_text().split("ITEM: ENTRIES")[1:]
        rows = [r.split() for f in frames for r in f.split("ITEM:")[0].splitlines()[1:]]
        return np.array(rows, dtype=float)


@pytest.fixture
def decks(library, tmp_path):
    (tmp_path / "plugin.so").symlink_to(library)
    (tmp_path / "tables.txt").write_text("# um, nN\n" + section("LOAD", LOAD) + section("UNLOAD", UNLOAD))
    return Decks(tmp_path)


HEAD = """
plugin load ./plugin.so
units micro
dimension {dimension}
boundary f f {z}
atom_style sphere
atom_modify map array
comm_modify vel yes
newton off
neighbor 1 bin
neigh_modify delay 0 every 1 check yes
region box block {box}
create_box 2 box
"""
END = """
thermo_style custom step {columns}
thermo_modify format float %.16e norm no
thermo 1
"""


def head(dimension=2, box="-20 20 -20 20 -0.5 0.5"):
    return HEAD.format(dimension=dimension, z="p" if dimension == 2 else "f", box=box)


def end(columns):
    return END.format(columns=columns)


def pair_deck(law, path, steps, dt=0.01, radii=(RADIUS, RADIUS), columns=""):
    """Disc 1 held at the origin, disc 2 led along ``path``, variables dx, dy (from touching), vx, vy."""
    reach = sum(radii)
    return (
        head()
        + f"""
create_atoms 1 single 0 0 0
create_atoms 2 single {reach!r} 0 0
set type 1 diameter {2 * radii[0]!r}
set type 2 diameter {2 * radii[1]!r}
set group all density 1.8
pair_style granular/table
pair_coeff * * {law}
timestep {dt}
group moving id 2
{path}
fix lead moving move variable v_dx v_dy NULL v_vx v_vy NULL
compute contact all pair/local p1 p2 p3 p4 p5 p6
variable fx equal fx[2]
variable fy equal fy[2]
variable gx equal fx[1]
variable gy equal fy[1]
variable px equal x[2]
variable py equal y[2]
variable tz equal C_spin[2][3]
compute spin all property/atom tqx tqy tqz
compute stress all pressure NULL virial
dump contacts all local 1 contacts.txt c_contact[*]
dump_modify contacts format float %.17g
"""
        + end("v_px v_py v_fx v_fy v_gx v_gy v_tz pe c_stress[1] " + columns)
        + f"run {steps}\n"
    )


def led(dx="0", dy="0", vx="0", vy="0"):
    return f"variable dx equal {dx}\nvariable dy equal {dy}\nvariable vx equal {vx}\nvariable vy equal {vy}\n"


def zigzag(speed, *turns):
    """Expression of a path 0 -> turns[0] -> turns[1] ... at constant speed, its velocity, and the steps of 0.01 us."""
    at, time, path, velocity = 0.0, 0.0, "0", "0"
    for turn in turns:
        span = abs(turn - at) / speed
        v = math.copysign(speed, turn - at)
        part = f"(time>={time!r}&&time<{time + span!r})"
        path += f"+{part}*({at!r}+{v!r}*(time-{time!r}))"
        velocity += f"+{part}*{v!r}"
        at, time = turn, time + span
    path += f"+(time>={time!r})*{at!r}"
    return path, velocity, round(time / 0.01)


# --- normal force ----------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("radii", [(3.5, 3.5), (2.0, 5.0)])
def test_the_force_of_two_discs_is_the_table(decks, radii):
    """Within 1e-10 of scipy's monotone interpolation of the rows, past the last row too; its integral is the energy."""
    path, velocity, steps = zigzag(0.3, -1.25)
    out = decks.run(pair_deck(TABLES, led(dx=path, vx=velocity), steps, radii=radii))
    overlap = sum(radii) - out["v_px"]
    assert overlap.max() == pytest.approx(1.25, abs=5e-3)
    np.testing.assert_allclose(out["v_fx"], LOADING(overlap), rtol=1e-10, atol=1e-10 * 260)
    np.testing.assert_allclose(out["c_stress[1]"] * 40 * 40, out["v_fx"] * out["v_px"], rtol=1e-10, atol=1e-9)
    inside = overlap < 1.0
    np.testing.assert_allclose(out["PotEng"][inside], LOADING.energy(overlap[inside]), rtol=1e-10, atol=1e-10)


def test_a_cycle_follows_the_branches(decks):
    """Loading, unloading, reloading, from below, at and beyond the table's reference: the rule as written out above."""
    path, velocity, steps = zigzag(0.3, -0.5, -0.2, -0.8, -0.1, -0.95, -0.3, -1.0, 0.1, -0.6)
    out = decks.run(pair_deck(BOTH, led(dx=path, vx=velocity), steps))
    overlap = 2 * RADIUS - out["v_px"]
    expected = branch(overlap)
    np.testing.assert_allclose(out["v_fx"], expected, rtol=1e-9, atol=1e-10 * 260)
    assert np.sum(expected < LOADING(overlap) - 1e-6) > 200


@pytest.mark.parametrize("law", ["hooke 250", "line 5e3", "line 5e3 soften 2.5"])
def test_linear_and_line_laws(decks, law):
    """Hooke; Johnson's parallel cylinders, the plugin's curve within 1e-9 of the exact inverse."""
    radii = (3.0, 4.0)
    path, velocity, steps = zigzag(0.3, -0.6)
    out = decks.run(pair_deck(f"{law} length 2", led(dx=path, vx=velocity), steps, radii=radii))
    d = np.maximum(sum(radii) - out["v_px"], 0)
    if law == "hooke 250":
        expected = 250 * d
    else:
        modulus = 1e4 * (1 - 0.3**2) / (2.5 if "soften" in law else 1)  # of each cylinder, for E* = 5e3
        expected = LineContact.between(*radii, modulus, 0.3, modulus, 0.3).line_load(d)
    assert np.all(np.diff(out["v_fx"][1:]) > 0)
    np.testing.assert_allclose(out["v_fx"], 2 * expected, rtol=1e-9, atol=1e-9)


def wall_deck(shape, law, path, steps, start=(0.0, RADIUS), columns="", extra=""):
    """A disc that does not turn, led along ``path`` from ``start``, against a wall."""
    return (
        head(box="-60 60 -60 60 -0.5 0.5")
        + f"""
create_atoms 1 single {start[0]!r} {start[1]!r} 0
set group all diameter {2 * RADIUS!r} density 1.8
pair_style zero 8
pair_coeff * *
timestep 0.01
{path}
fix lead all move variable v_dx v_dy NULL v_vx v_vy NULL
{extra}
fix wall all wall/granular/table {shape} {law} contacts
variable px equal x[1]
variable py equal y[1]
variable fx equal fx[1]
variable fy equal fy[1]
variable n equal F_wall[1][1]
variable tx equal F_wall[1][2]
variable slip equal F_wall[1][6]
"""
        + end("v_px v_py v_fx v_fy f_wall f_wall[*] v_n v_tx v_slip " + columns)
        + f"run {steps}\n"
    )


def test_the_force_on_a_wall_is_the_table(decks):
    path, velocity, steps = zigzag(0.3, -1.25)
    out = decks.run(wall_deck("plane y 0 above", TABLES, led(dy=path, vy=velocity), steps))
    overlap = RADIUS - out["v_py"]
    np.testing.assert_allclose(-out["f_wall[2]"], LOADING(overlap), rtol=1e-10, atol=1e-10 * 260)
    np.testing.assert_array_equal(-out["f_wall[2]"], out["v_fy"])
    np.testing.assert_array_equal(out["f_wall[4]"], overlap > 0)
    inside = overlap < 1.0
    np.testing.assert_allclose(out["f_wall"][inside], LOADING.energy(np.maximum(overlap, 0)[inside]), atol=1e-9)


def test_a_wall_moves_by_its_variable_with_its_velocity(decks):
    """The same overlaps by moving the wall; damping sees its velocity."""
    path, _, steps = zigzag(0.3, 1.0, 0.2)
    variables = led() + f"variable up equal {path}\n"
    out = decks.run(wall_deck("plane y 0 above", f"{TABLES} damping 20 move y v_up", variables, steps, columns="v_up"))
    rate = np.gradient(out["v_up"], 0.01)
    steady = np.abs(np.diff(out["v_up"], prepend=0) / 0.01 - rate) < 1e-9
    expected = np.maximum(0, LOADING(out["v_up"]) + 20 * rate)
    np.testing.assert_allclose(out["v_fy"][steady][2:], expected[steady][2:], rtol=1e-8, atol=1e-8)
    assert steady.sum() > steps - 10


@pytest.mark.parametrize(
    ("shape", "start", "direction", "size"),
    [
        ("plane x 10 below", (6.5, 0.0), (1, 0), RADIUS / 2),
        ("cylinder z 0 0 10 outside", (0.0, 13.5), (0, -1), RADIUS / 2 * (1 + RADIUS / 10)),
        ("cylinder z 0 0 10 inside", (0.0, -6.5), (0, -1), RADIUS / 2 * (1 - RADIUS / 10)),
    ],
)
def test_shapes_of_walls(decks, shape, start, direction, size):
    """Line law on a plane, on and in a cylinder; the mean log radius of a rigid partner is the disc's own."""
    path, velocity, steps = zigzag(0.3, 0.5)
    d = [f"{c}*({path})" for c in direction]
    v = [f"{c}*({velocity})" for c in direction]
    out = decks.run(wall_deck(shape, "line 5e3", led(d[0], d[1], v[0], v[1]), steps, start=start))
    overlap = np.hypot(out["v_px"] - start[0], out["v_py"] - start[1])
    law = LineContact(5e3, RADIUS**2 / (2 * size), RADIUS)
    along = -(out["v_fx"] * direction[0] + out["v_fy"] * direction[1])
    np.testing.assert_allclose(along, law.line_load(overlap), rtol=1e-8, atol=1e-8)


def test_a_block_has_edges_and_sides(decks):
    """A finite anvil, 0 <= x <= 5, y < 0: the force comes from the nearest point of its surface."""
    where = [(2.0, 3.2), (7.0, 2.0), (8.2, -4.0), (-2.0, 2.5), (11.0, 2.0)]
    nearest = [(2.0, 0.0), (5.0, 0.0), (5.0, -4.0), (0.0, 0.0), (5.0, 0.0)]
    for place, surface in zip(where, nearest, strict=True):
        out = decks.run(wall_deck("plane y 0 above", "hooke 100 span x 0 5", led(), 0, start=place))
        away = np.subtract(place, surface)
        gap = float(np.hypot(*away))
        expected = 100 * max(0, RADIUS - gap) * away / gap
        np.testing.assert_allclose([out["v_fx"][0], out["v_fy"][0]], expected, atol=1e-10)


# --- friction --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("damping", [0, 5])
@pytest.mark.parametrize("spring", ["20 0.3", "stiffness 3000 0"])
def test_friction_is_mu_times_the_normal_force_in_every_branch(decks, damping, spring):
    """A disc slides steadily along a wall while the normal force goes through all its branches."""
    down, down_speed, steps = zigzag(0.3, -0.5, -0.2, -0.8, -0.4, -1.0, 0.1)
    law = f"{BOTH} damping {damping} friction 0.3 kinetic 0.2 tangential {spring}"
    out = decks.run(wall_deck("plane y 0 above", law, led("2*time", down, "2", down_speed), steps))
    normal, friction = out["v_n"], out["v_tx"]
    # one step of travel, 0.02 um, times the spring is beyond any limit here once the contact is under way
    slipping = (out["v_slip"] == 1) & (normal > 0)
    assert slipping.sum() > 0.8 * np.sum(normal > 0)
    np.testing.assert_allclose(friction[slipping], -0.2 * normal[slipping], rtol=1e-12)
    np.testing.assert_allclose(out["f_wall[1]"], -friction, rtol=1e-12)
    if damping == 0:
        np.testing.assert_allclose(normal, branch(RADIUS - out["v_py"]), rtol=1e-9, atol=1e-9)
    assert np.all(normal >= 0)


def test_static_friction_holds_until_its_limit_then_kinetic(decks):
    """At a constant normal force: a spring to 0.3 N, then 0.2 N; on the way back a spring of the same stiffness."""
    slide, slide_speed, steps = zigzag(0.1, 0.5, 0.44, 0.6)
    law = "hooke 100 friction 0.3 kinetic 0.2 tangential 0.8 0.3"
    out = decks.run(wall_deck("plane y 0 above", law, led(dx=slide, vx=slide_speed), steps, start=(0.0, RADIUS - 1.0)))
    x, friction = out["v_px"], -out["v_tx"]
    np.testing.assert_allclose(out["v_n"], 100.0, rtol=1e-12)
    k = 80.0
    first = x[: np.argmax(x)] <= 0.3 * 100 / k - 2e-3
    np.testing.assert_allclose(friction[: np.argmax(x)][first], k * x[: np.argmax(x)][first], rtol=1e-9, atol=0.2)
    assert 30 - k * 0.001 - 1e-9 <= friction.max() <= 30
    beyond = (x > 0.3 * 100 / k + 2e-3) & (np.arange(len(x)) < np.argmax(np.diff(x) < 0))
    np.testing.assert_allclose(friction[beyond], 20, rtol=1e-12)
    back = np.argmin(x[np.argmax(np.diff(x) < 0) :]) + np.argmax(np.diff(x) < 0)
    assert friction[back] == pytest.approx(20 - k * 0.06, abs=0.2)
    assert friction[-1] == pytest.approx(28, rel=1e-9)  # it sticks: a spring once more, 12.8 nN beyond 15.2


@pytest.mark.parametrize("newton", ["on", "off"])
def test_friction_of_two_discs_stays_in_the_turning_contact_plane(decks, newton):
    """Disc 2 swings around disc 1 by 60 degrees at constant overlap: |T| = mu N across N, in forces and output."""
    reach, w = 2 * RADIUS - 0.5, 0.2
    path = led(
        f"{reach}*cos({w}*time)-{2 * RADIUS}",
        f"{reach}*sin({w}*time)",
        f"-{w * reach}*sin({w}*time)",
        f"{w * reach}*cos({w}*time)",
    )
    law = f"{TABLES} friction 0.25 tangential 0.8 0.3"
    deck = pair_deck(law, path, 520).replace("newton off", f"newton {newton}")
    out = decks.run(deck)
    contact = decks.locals("contacts.txt")
    x, y = out["v_px"], out["v_py"]
    normal = (out["v_fx"] * x + out["v_fy"] * y) / np.hypot(x, y)
    tangent = (-out["v_fx"] * y + out["v_fy"] * x) / np.hypot(x, y)
    np.testing.assert_allclose(normal[1:], float(LOADING(0.5)), rtol=1e-9)
    slipping = contact[:, 5] == 1
    assert slipping[-400:].all()
    np.testing.assert_allclose(tangent[1:][slipping], -0.25 * normal[1:][slipping], rtol=1e-9)
    np.testing.assert_allclose(contact[:, 0], normal[1:], rtol=1e-12)
    np.testing.assert_allclose(np.hypot(contact[:, 1], contact[:, 2]), np.abs(tangent[1:]), rtol=1e-9, atol=1e-12)
    np.testing.assert_allclose(contact[:, 4], 0.5, rtol=1e-9)
    # third law, and the torque about the contact, half way between the centres
    np.testing.assert_allclose(out["v_gx"], -out["v_fx"], rtol=1e-15)
    np.testing.assert_allclose(out["v_gy"], -out["v_fy"], rtol=1e-15)
    np.testing.assert_allclose(out["v_tz"], -tangent * np.hypot(x, y) / 2, rtol=1e-9, atol=1e-12)


def test_damping_never_pulls(decks):
    """Leaving fast: the force of the law less the damping's, but no adhesion; friction follows it to zero."""
    path, velocity, steps = zigzag(2.0, -0.5, 0.1)
    law = f"{TABLES} damping 10 friction 0.3 tangential 0.8 0.3"
    out = decks.run(pair_deck(law, led(dx=path, vx=velocity), steps))
    rate = np.where(np.arange(steps + 1) * 0.01 < 0.25, 2.0, -2.0)
    overlap = 2 * RADIUS - out["v_px"]
    expected = np.maximum(0, LOADING(overlap) + 10 * rate) * (overlap > 0)
    np.testing.assert_allclose(out["v_fx"], expected, rtol=1e-9, atol=1e-9)
    assert np.sum((overlap > 0) & (out["v_fx"] == 0)) > 5


def test_a_spinning_cylinder_drags(decks):
    """Its surface moves at omega R: a disc at rest on top is dragged along, one led at that speed is not."""
    deck = "cylinder z 0 0 10 outside"
    law = "hooke 100 friction 0.3 rotate v_w"
    spin = "variable w equal 0.2\n"
    rest = decks.run(wall_deck(deck, law, led() + spin, 200, start=(0.0, 13.0)))
    np.testing.assert_allclose(rest["v_fx"][-50:], -0.3 * 50, rtol=1e-12)
    arm = 13.0
    along = led(
        f"-{arm}*sin(0.2*10/{arm}*time)",
        f"{arm}*(cos(0.2*10/{arm}*time)-1)",
        "-2*cos(0.2*10/13*time)",
        "-2*sin(0.2*10/13*time)",
    )
    led_along = decks.run(wall_deck(deck, law, along + spin, 200, start=(0.0, arm)))
    assert np.abs(led_along["v_tx"]).max() < 1e-6


# --- dissipation -----------------------------------------------------------------------------------------------------

LOOP = LOADING.energy(0.8) - quad(lambda d: float(UNLOADING(d)), 0.25, 0.8, points=UNLOAD[1:-1, 0])[0]


def work(overlap, force):
    return float(np.sum((force[1:] + force[:-1]) / 2 * np.diff(overlap)))


@pytest.mark.parametrize("cycles", [1, 3])
def test_a_driven_cycle_dissipates_the_loop(decks, cycles):
    """To the reference and out again. Tolerance: the trapezoidal rule over steps of 0.2 % of the path."""
    path, velocity, steps = zigzag(0.1, *(cycles * (-0.8, 0.05)))
    out = decks.run(pair_deck(BOTH, led(dx=path, vx=velocity), steps))
    assert work(2 * RADIUS - out["v_px"], out["v_fx"]) == pytest.approx(cycles * LOOP, rel=1e-4)


def test_a_loaded_cycle_dissipates_the_loop(decks):
    """A heavy disc pressed on a wall by a force that rises slowly to the table's last and falls again.

    Tolerance: 0.3 %, the swing of the disc about its rest at this rate; a plain spring would give 0.
    """
    top, period, dt = 200.0, 400.0, 0.02
    load = f"variable load equal -{top}*0.5*(1-cos(2*PI*time/{period}))\nfix load all addforce 0 v_load 0\n"
    drag = "fix drag all viscous 20\n"
    deck = wall_deck("plane y 0 above", BOTH, led(), 0, extra=load + drag).replace("run 0", "")
    deck = deck.replace("fix lead all move variable v_dx v_dy NULL v_vx v_vy NULL", "fix lead all nve")
    deck = deck.replace("timestep 0.01", f"timestep {dt}").replace("thermo 1", "thermo 5")
    out = decks.run(deck + f"run {round(period / dt)}\n")
    overlap = RADIUS - out["v_py"]
    assert overlap.max() == pytest.approx(0.8, rel=2e-3)
    assert work(overlap, out["v_n"]) == pytest.approx(LOOP, rel=3e-3)


@pytest.mark.parametrize("spring", ["0.8 0", "stiffness 200 0"])
@pytest.mark.parametrize("law", [BOTH, "line 400", TABLES])
def test_no_path_makes_energy(decks, law, spring):
    """A disc led along a wall on a path that does not close: the work put in never falls below zero.

    Tolerance: 1e-3 of the largest, the trapezoidal rule over the corners where slip begins and ends.
    """
    path = led(
        "0.25*sin(1.7*time)+0.1*sin(4.1*time)",
        "-0.45*(1-cos(1.1*time))*(1+0.4*sin(0.37*time))",
        "0.25*1.7*cos(1.7*time)+0.1*4.1*cos(4.1*time)",
        "-0.45*(1.1*sin(1.1*time)*(1+0.4*sin(0.37*time))+(1-cos(1.1*time))*0.4*0.37*cos(0.37*time))",
    )
    out = decks.run(wall_deck("plane y 0 above", f"{law} friction 0.4 kinetic 0.3 tangential {spring}", path, 6000))
    fx, fy = -out["v_fx"], -out["v_fy"]
    steps = (fx[1:] + fx[:-1]) / 2 * np.diff(out["v_px"]) + (fy[1:] + fy[:-1]) / 2 * np.diff(out["v_py"])
    total = np.cumsum(steps)
    assert total.max() > 20
    assert total.min() > -1e-3 * total.max()
    # nothing is kept by a contact that opened: what was spent since the last opening was friction and loops
    open_now = np.flatnonzero(out["f_wall[4]"][1:] == 0)
    assert np.all(np.diff(total[open_now]) > -1e-3 * total.max())


def test_no_branch_lies_above_the_loading_curve(decks):
    """A loading curve that softens to the reference and stiffens beyond: the scaled shape alone would lie above it."""
    load = np.array([[0, 0], [0.2, 100], [0.8, 200], [1.0, 800]], dtype=float)
    unload = np.array([[0.05, 0], [0.3, 90], [0.8, 200]], dtype=float)
    (decks.folder / "tables.txt").write_text(section("LOAD", load) + section("UNLOAD", unload))
    path, velocity, steps = zigzag(0.2, -1.0, 0.05)
    out = decks.run(pair_deck(BOTH, led(dx=path, vx=velocity), steps))
    overlap = 2 * RADIUS - out["v_px"]
    scaled = 800 * Curve(unload)(0.8 * overlap) / 200
    back = (np.arange(len(overlap)) > np.argmax(overlap)) & (overlap > 0)
    np.testing.assert_allclose(out["v_fx"][back], np.minimum(Curve(load)(overlap), scaled)[back], rtol=1e-9, atol=1e-7)
    assert np.sum((scaled > Curve(load)(overlap))[back]) > 100


@pytest.mark.parametrize("spring", ["0.8 0", "stiffness 200 0"])
def test_a_spring_that_softens_gives_nothing_back(decks, spring):
    """Sheared while pressed hard, let go while pressed softly, five times: the tangential work stays positive."""
    points = [(0.0, -0.8)] + 5 * [(0.075, -0.8), (0.075, -0.5), (-0.133, -0.5), (-0.133, -0.8), (0.0, -0.8)]
    time, x, y, vx, vy, before = 0.0, "0", "0", "0", "0", (0.0, 0.0)
    for point in points:
        span = 0.01 * max(2, round(max(abs(point[0] - before[0]), abs(point[1] - before[1])) / 0.002))
        leg = f"(time>={time!r}&&time<{time + span!r})"
        x, y = (
            a + f"+{leg}*({b!r}+{(c - b) / span!r}*(time-{time!r}))"
            for a, b, c in zip((x, y), before, point, strict=True)
        )
        vx, vy = (a + f"+{leg}*{(c - b) / span!r}" for a, b, c in zip((vx, vy), before, point, strict=True))
        time, before = time + span, point
    law = f"{TABLES} friction 0.4 tangential {spring}"
    out = decks.run(wall_deck("plane y 0 above", law, led(x, y, vx, vy), round(time / 0.01) - 1))
    tangential = np.cumsum((out["v_tx"][1:] + out["v_tx"][:-1]) / -2 * np.diff(out["v_px"]))
    assert tangential.max() > 0.4
    assert tangential.min() > -1e-3


# --- many bodies -----------------------------------------------------------------------------------------------------

CLOUD_LAW = f"{BOTH} damping 0.5 friction 0.3 kinetic 0.2 tangential 0.8 0.3 rolling 30 0.2 0.1"


def cloud(dimension, folder):
    """Data file of a jittered lattice of discs or spheres of two sizes and types that move and spin."""
    rng = np.random.default_rng(4)
    places = 3.4 + 6.8 * np.arange(-3, 3)
    x = np.array(np.meshgrid(places, places, [0.0] if dimension == 2 else [-3.4, 3.4])).reshape(3, -1).T
    v, w = rng.normal(0, 3.0, x.shape), rng.normal(0, 0.3, x.shape)
    x += rng.uniform(-0.4, 0.4, x.shape)
    if dimension == 2:
        x[:, 2] = v[:, 2] = w[:, 0] = w[:, 1] = 0
    thick = 0.5 if dimension == 2 else 12
    rows = list(
        zip(range(1, len(x) + 1), rng.integers(1, 3, len(x)).tolist(), x.tolist(), v.tolist(), w.tolist(), strict=True)
    )
    lines = [
        "discs",
        "",
        f"{len(x)} atoms",
        "2 atom types",
        "-21 21 xlo xhi",
        "-30 30 ylo yhi",
        f"-{thick} {thick} zlo zhi",
    ]
    lines += ["", "Atoms # sphere", ""]
    lines += [f"{k} {t} {7.6 - 0.6 * t} 1.8 {' '.join(map(repr, p))}" for k, t, p, _, _ in rows]
    lines += ["", "Velocities", ""]
    lines += [f"{k} {' '.join(map(repr, a + b))}" for k, _, _, a, b in rows]
    (folder / "cloud.data").write_text("\n".join(lines) + "\n")


WRITE = "write_dump all custom last.txt id x y z vx vy vz omegax omegay omegaz fx fy fz tqx tqy tqz "
WRITE += "modify sort id format float %.17g\n"


def cloud_deck(commands, dimension=2, newton="on", walls=True, start="read_data cloud.data"):
    """The cloud in a box periodic in x, between two walls of which one moves; histories of every kind."""
    deck = head(dimension).replace("newton off", f"newton {newton}")
    deck = re.sub(r"boundary .*", "boundary p f p" if walls else f"boundary s s {'p' if dimension == 2 else 's'}", deck)
    deck = re.sub(r"region box.*\ncreate_box.*", start, deck).replace("map array", "map array sort 20 8.0")
    return (
        deck
        + f"""
pair_style granular/table
pair_coeff 1 1 {CLOUD_LAW}
pair_coeff 1 2 {TABLES} damping 1 friction 0.4 tangential stiffness 60 0.1
pair_coeff 2 2 hooke 150 friction 0.2 tangential 0.5 0
fix move all nve/sphere{" disc" if dimension == 2 else ""}
{"fix flat all enforce2d" if dimension == 2 else ""}
timestep 0.01
variable push equal 2*sin(0.5*time)
"""
        + f"""
fix bottom all wall/granular/table plane y -22 above {CLOUD_LAW} move y v_push
fix top all wall/granular/table plane y 22 below {CLOUD_LAW}
"""
        * walls
        + end("pe press f_bottom[2]" if walls else "pe press").replace("thermo 1", "thermo 50")
        + commands
    )


STATE = ("x", "y", "z", "vx", "vy", "vz", "omegax", "omegay", "omegaz", "fx", "fy", "fz", "tqx", "tqy", "tqz")


def same(a, b, tolerance):
    """Largest difference of two states over the size of each quantity is below ``tolerance``."""
    np.testing.assert_array_equal(a["id"], b["id"])
    for name in STATE:
        scale = max(np.abs(a[name[:-1] + c]).max() for c in "xyz")
        assert np.abs(a[name] - b[name]).max() < tolerance * scale, name


@pytest.mark.parametrize(("dimension", "newton"), [(2, "on"), (3, "off")])
def test_forces_and_moments_sum_to_zero(decks, dimension, newton):
    """Without walls; to round-off, 1e-13 of the sum of their sizes."""
    cloud(dimension, decks.folder)
    decks.run(cloud_deck("run 150\n" + WRITE, dimension, newton, walls=False))
    s = decks.dump("last.txt")
    x, f, torque = (np.array([s[a + c] for c in "xyz"]).T for a in ("", "f", "tq"))
    assert np.sum(np.abs(f).sum(axis=1) > 0) > 20
    assert np.abs(torque).max() > 1
    assert np.abs(f.sum(axis=0)).max() < 1e-13 * np.abs(f).sum()
    moment = (np.cross(x, f) + torque).sum(axis=0)
    assert np.abs(moment).max() < 1e-13 * (np.abs(x).max() * np.abs(f).sum())


@pytest.mark.parametrize(("ranks", "newton", "dimension"), [(2, "on", 2), (4, "off", 2), (2, "on", 3)])
def test_any_number_of_ranks_computes_the_same(decks, ranks, newton, dimension):
    """Periodic in x, with walls, migration and contacts across ranks and images. Collisions enlarge round-off."""
    cloud(dimension, decks.folder)
    deck = cloud_deck("run 300\n" + WRITE, dimension, newton)
    one = decks.run(deck), decks.dump("last.txt")
    more = decks.run(deck, ranks), decks.dump("last.txt")
    same(one[1], more[1], 1e-9)
    for name in ("PotEng", "Press", "f_bottom[2]"):
        np.testing.assert_allclose(more[0][name], one[0][name], rtol=1e-9, atol=1e-9 * np.abs(one[0][name]).max())


@pytest.mark.parametrize("damped", [False, True])
def test_a_run_goes_on_from_a_restart(decks, damped):
    """Written in mid-run on two ranks, read on one; and after runs that only end: as if it had not been broken.

    With damping as if a run had ended there: the engine computes the forces anew when a run begins, from velocities
    half a step later than it did before.
    """

    def run(commands, ranks=1, **options):
        deck = cloud_deck(commands, **options)
        if not damped:
            deck = re.sub(r" damping [\d.]+", "", deck).replace("rolling 30 0.2", "rolling 30 0")
        decks.run(deck, ranks)

    cloud(2, decks.folder)
    run("run 200\nrun 200\n" + WRITE if damped else "run 400\n" + WRITE)
    whole = decks.dump("last.txt")
    run("restart 200 half.rst half.rst\nrun 250\n", 2)
    run("run 200\n" + WRITE, start="read_restart half.rst")
    same(whole, decks.dump("last.txt"), 1e-9)
    run("run 200\nwrite_restart end.rst\n" if damped else "run 100\nrun 60 pre no\nrun 40\nwrite_restart end.rst\n")
    run("run 200\n" + WRITE, start="read_restart end.rst")
    same(whole, decks.dump("last.txt"), 1e-9)


def test_contacts_remember_through_a_restart(decks):
    """A restart file without its histories goes on differently: the test before this one can fail."""
    cloud(2, decks.folder)
    decks.run(cloud_deck("run 200\nwrite_restart half.rst\nrun 1\n" + WRITE))
    kept = decks.dump("last.txt")
    deck = cloud_deck("run 1\n" + WRITE, start="read_restart half.rst")
    decks.run(deck)
    same(kept, decks.dump("last.txt"), 1e-9)
    forget = "pair_style zero 8\npair_coeff * *\nrun 0\n"
    decks.run(deck.replace("pair_style granular/table", forget + "pair_style granular/table"))
    lost = decks.dump("last.txt")
    assert np.abs(kept["fx"] - lost["fx"]).max() > 0.01 * np.abs(kept["fx"]).max()


# --- rolling ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize(("slope", "rolls"), [(0.08, False), (0.12, True)])
def test_a_disc_on_a_slope_rests_below_its_rolling_limit_and_rolls_above(decks, slope, rolls):
    """Rolling limit 0.1: beyond it a = g (sin - 0.1 cos) m R^2/(m R^2 + I) along the slope, I = m R^2/2."""
    g, radius, mass = 0.5, 3.5, 1.8 * math.pi * 3.5**2
    law = "hooke 1e4 damping 50 friction 0.5 tangential 0.8 0.4 rolling 2e3 20 0.1"
    sink = mass * g * math.cos(math.atan(slope)) / 1e4
    deck = (
        head(box="-100 100 -20 20 -0.5 0.5")
        + f"""
create_atoms 1 single -80 {radius - sink!r} 0
set group all diameter {2 * radius} mass {mass!r}
pair_style zero 8
pair_coeff * *
timestep 0.01
fix move all nve/sphere disc
fix flat all enforce2d
fix wall all wall/granular/table plane y 0 above {law}
fix weight all addforce {mass * g * math.sin(math.atan(slope))!r} {-mass * g * math.cos(math.atan(slope))!r} 0
variable px equal x[1]
variable vx equal vx[1]
compute spin all property/atom omegaz
variable w equal C_spin[1]
"""
        + end("v_px v_vx v_w time").replace("thermo 1", "thermo 100")
        + "run 8000\n"
    )
    out = decks.run(deck)
    if not rolls:
        assert abs(out["v_px"][-1] + 80) < 0.1
        assert abs(out["v_vx"][-1]) < 1e-6
        return
    angle = math.atan(slope)
    a = g * (math.sin(angle) - 0.1 * math.cos(angle)) / 1.5
    late = out["Time"] > 20
    fitted = np.polyfit(out["Time"][late], out["v_vx"][late], 1)[0]
    # the arm of friction is the radius less the sinking, 3e-3 of it
    assert fitted == pytest.approx(a, rel=2e-2)
    np.testing.assert_allclose(out["v_w"][late], -out["v_vx"][late] / radius, rtol=1e-2)


# --- odd cases -------------------------------------------------------------------------------------------------------


def test_coincident_centres_push_apart(decks):
    """No direction to go by: a finite force, opposite on the two, and the discs part."""
    deck = pair_deck(f"{BOTH} friction 0.3 tangential 0.8 0.3", led(), 0)
    deck = deck.replace(f"single {2 * RADIUS!r} 0 0", "single 0 0 0")
    out = decks.run(deck)
    assert out["v_fx"][0] == -out["v_gx"][0] == pytest.approx(-float(LOADING(7.0)), rel=1e-10)
    assert np.isfinite([v for column in out.values() for v in column]).all()


def test_a_box_too_narrow_for_two_images_is_refused(decks):
    deck = pair_deck(TABLES, led(), 0).replace("boundary f f p", "boundary f p p").replace("-20 20 -0.5", "-5 5 -0.5")
    with pytest.raises(EngineError, match="periodic box is 10 wide in y, expected at least 14"):
        decks.run(deck)


@pytest.mark.parametrize(
    ("law", "complaint"),
    [
        ("spring 3", "normal law is spring, expected none, hooke, line or table"),
        ("hooke -3", "stiffness of law hooke is -3, expected a number above 0"),
        ("hooke 3 tangential 0 0", "stiffness of tangential is 0, expected a number above 0"),
        (
            "hooke 3 friction 0.2 kinetic 0.3 tangential 1 0",
            "kinetic friction coefficient is 0.3, expected at most 0.2",
        ),
        ("hooke 3 friction angle tables.txt LOAD tangential 1 0", "friction is by angle"),
        ("hooke 3 damping many", "damping is many"),
        ("hooke 3 mu 2", "pair_coeff of granular/table has mu"),
        ("table nowhere.txt LOAD", "file nowhere.txt: file is unreadable"),
        ("table tables.txt OTHER", "section is OTHER"),
        ("table bad.txt FALLING", "table FALLING of file bad.txt: force of row 3 is 0.5, expected no less than 1"),
        ("table bad.txt BACK", "argument of row 3 is 0.1, expected more than 0.2"),
        ("table bad.txt TEXT", "row 2 is 2 0.2 one"),
        ("table bad.txt SHORT", "row 3 is end of file"),
        ("table bad.txt NEGATIVE", "force of row 1 is -1"),
        ("table bad.txt OFFSET", "force of row 1 is 1, expected 0 at no overlap"),
        ("table bad.txt GOOD unload HIGH", "expected at most"),
        ("table bad.txt GOOD unload APART", "its last force is 3, expected 2"),
    ],
)
def test_complaints_name_what_is_wrong(decks, law, complaint):
    (decks.folder / "bad.txt").write_text(
        "GOOD\nN 2\n1 0 0\n2 0.2 2\nHIGH\nN 3\n1 0 0\n2 0.1 1.5\n3 0.2 2\nAPART\nN 2\n1 0 0\n2 0.2 3\n"
        "FALLING\nN 3\n1 0 0\n2 0.1 1\n3 0.2 0.5\nBACK\nN 3\n1 0 0\n2 0.2 1\n3 0.1 2\nTEXT\nN 2\n1 0 0\n2 0.2 one\n"
        "NEGATIVE\nN 2\n1 0 -1\n2 0.1 1\nOFFSET\nN 2\n1 0 1\n2 0.1 1\nSHORT\nN 3\n1 0 0\n2 0.1 1\n"
    )
    with pytest.raises(EngineError, match=re.escape(complaint)):
        decks.run(pair_deck(law, led(), 0))


def test_every_pair_of_types_wants_its_line(decks):
    deck = pair_deck(TABLES, led(), 0).replace("pair_coeff * *", "pair_coeff 1 1 hooke 1\npair_coeff 2 2")
    with pytest.raises(EngineError, match="pair_coeff 1 2 of granular/table is missing"):
        decks.run(deck)
