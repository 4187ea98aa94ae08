"""What joins the chains of flat tows: how stiff rungs, turns in the plane and twist are, what it costs the step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from cgfibre.build.ribbon import between, rungs, turns, twists
from cgfibre.build.system import FilamentSystem, FloatArray, IntArray
from cgfibre.mechanics.ribbon import chord_loss
from cgfibre.plan.model import Choice, Ribbon
from cgfibre.plan.tow_law import TowLaw
from cgfibre.plan.tows import TowModel
from cgfibre.scene import Scene

#: what rungs, and turns in the plane, may add to the stiffness that stretching gives a bead: a step 5 % shorter each
RUNG_SHARE, TURN_SHARE = 0.1, 0.1
#: bending in the plane above that out of it that counts
NOTICEABLE = 1e-6
#: rad
ROUNDING = 1e-12


@dataclass(frozen=True)
class Elements:
    """Bonded elements of ribbons: (n, 2 or 4) ``beads``, ``stiffness`` (n,) nN/um or nN um, value at ``rest`` (n,) um
    or rad: energy stiffness/2 (value - rest)^2, for twist stiffness (1 - cos(value - rest))."""

    beads: IntArray
    stiffness: FloatArray
    rest: FloatArray


def ribbon_elements(system: FilamentSystem, ribbon: Ribbon) -> tuple[Elements, Elements, Elements]:
    """(rungs, turns, twists) of a system's ribbons, at rest as built.

    A rung stands for a share ds of the tow's length: (E t) ds/w between chains w apart, E t the modulus across times
    the thickness. A turn over chords of span h measures the curvature as turn/h: (EI_in_plane - EI) ds/h^2, as much in
    every chain. Twist over a gap s: GJ/s, shared among the pairs of neighbours.
    """
    across = rungs(system)
    membrane, bending, torsion = (np.array(x) for x in (ribbon.across, ribbon.bending, ribbon.twist))
    turn, twist = turns(system, across, ribbon.reach), twists(system, across)
    used = torsion[twist.kind] > 0
    return (
        Elements(across.beads, membrane[across.kind] * across.share / across.length, across.length),
        Elements(turn.beads, bending[turn.kind] * turn.share / turn.span**2, _clean(turn.turn)),
        Elements(twist.beads[used], (torsion[twist.kind] / (twist.gap * twist.pairs))[used], _clean(twist.twist[used])),
    )


def _clean(angle: FloatArray) -> FloatArray:
    """Angles as built, rad, without rounding: plane curves have none."""
    return np.where(np.abs(angle) < ROUNDING, 0.0, angle)


def ribbon_bound(system: FilamentSystem, ribbon: Ribbon) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Stiffness (n_beads,) that rungs, turns, twists add to each bead, nN/um: omega^2 <= max of all sums over masses.

    Absolute row sums (Gershgorin): K |g_i| sum_j |g_j| over elements, g_i the gradient of the element's value at bead
    i: 1 of a rung; 1/l1, 1/l1 + 1/l2, 1/l2 of a turn over chords l1, l2, and |t2 - t1|/w of a rung w long that it
    turns; 1/arm of a twist.
    """
    across, turn, twist = ribbon_elements(system, ribbon)
    one, two, e = (between(system, turn.beads[:, i], turn.beads[:, j]) for i, j in ((0, 1), (1, 2), (1, 3)))
    l1, l2, l3 = (np.linalg.norm(x, axis=1) for x in (one, two, e))
    bent = np.linalg.norm(two / l2[:, None] - one / l1[:, None], axis=1) / l3
    of_twist = twists(system, rungs(system))
    arm = of_twist.arm[np.array(ribbon.twist)[of_twist.kind] > 0]
    gradients = (
        np.ones((len(across.beads), 2)),
        np.column_stack([1 / l1, 1 / l1 + 1 / l2 + bent, 1 / l2, bent]),
        np.repeat(1 / arm[:, None], 4, axis=1),
    )
    sums = []
    for element, g in zip((across, turn, twist), gradients, strict=True):
        rows = element.stiffness[:, None] * g * np.sum(g, axis=1)[:, None]
        total = np.bincount(element.beads.reshape(-1), rows.reshape(-1), system.n_beads)
        sums.append(total.astype(np.float64, copy=False))
    return sums[0], sums[1], sums[2]


def across_modulus(law: TowLaw, tow: TowModel, overlap: float) -> float:
    """Modulus of a tow across itself, kPa: E = 2 t p/overlap, of two tows that share an ``overlap`` um.

    Where the law has no force there: that of its last row.
    """
    pressure = law.load if law.pressure else law.load / tow.shape.width
    at = min(overlap, float(law.overlap[-1]))
    p = float(np.interp(at, law.overlap, pressure))
    if p <= 0:
        at, p = float(law.overlap[-1]), float(pressure[-1])
    return 2 * tow.shape.thickness * p / at


def plan_ribbon(
    scene: Scene,
    system: FilamentSystem,
    tows: tuple[TowModel, TowModel],
    law: TowLaw,
    overlap: float,
    softening: float,
) -> tuple[Ribbon | None, list[Choice]]:
    """(what joins the chains of flat tows, choices); None where every tow is one chain.

    Rungs are as stiff as the tow is across at the ``overlap`` (um) planned, or softer, so that they add no more than
    :data:`RUNG_SHARE` to the stiffness that stretching gives a bead; turns in the plane are taken over chords so long
    that they add no more than :data:`TURN_SHARE`. ``softening`` of the tows' EA.
    """
    if all(t.chains == 1 for t in tows):
        return None, []
    lengths, kind = system.bond_lengths(), system.filament_type[system.filament_of_bead]
    shortest = [float(np.min(lengths[kind[system.bonds()[:, 0]] == k])) for k in (0, 1)]
    stretch = [4 * t.chain.EA / softening / s for t, s in zip(tows, shortest, strict=True)]
    more = [t.EI_in_plane - t.whole.EI if _asked(scene) else 0.0 for t in tows]
    ribbon = Ribbon(
        across=tuple(across_modulus(law, t, overlap) * t.shape.thickness for t in tows),
        bending=tuple(x if x > NOTICEABLE * t.whole.EI else 0.0 for x, t in zip(more, tows, strict=True)),
        twist=tuple(t.whole.GJ for t in tows),
        reach=(0, 0),
    )
    added = ribbon_bound(system, ribbon)[0]
    soft = [max(1.0, float(np.max(added[kind == k])) / (RUNG_SHARE * stretch[k])) for k in (0, 1)]
    ribbon = replace(ribbon, across=tuple(a / x for a, x in zip(ribbon.across, soft, strict=True)))
    for k in (0, 1):
        if tows[k].chains > 1 and ribbon.bending[k] > 0:
            ribbon = replace(ribbon, reach=_reach(system, ribbon, k, TURN_SHARE * stretch[k]))
    flat = [k for k in (0, 1) if tows[k].chains > 1]
    return ribbon, [
        _rungs_choice(tows, ribbon, soft, flat),
        _bending_choice(scene, system, tows, ribbon, flat),
        _twist_choice(tows, flat),
    ]


def _asked(scene: Scene) -> bool:
    """Whether the scene gives bending in the plane of its tows, or moves its cell so that they might bend there."""
    w = scene.weave
    return any(t.EI_in_plane is not None for t in (w.tow, w.weft)) or not scene.in_plane.at_rest


def _reach(system: FilamentSystem, ribbon: Ribbon, k: int, most: float) -> tuple[int, ...]:
    """Reach of all kinds with that of kind ``k`` as short as adds no more than ``most`` (nN/um) to a bead, or a quarter
    of its chains."""
    of_kind = system.filament_type == k
    segments = np.diff(system.filament_start)[of_kind] - ~system.closed[of_kind]
    kind = system.filament_type[system.filament_of_bead]
    tried = ribbon.reach
    for n in range(1, max(1, int(np.min(segments)) // 4) + 1):
        tried = tuple(n if j == k else r for j, r in enumerate(ribbon.reach))
        if np.max(ribbon_bound(system, replace(ribbon, reach=tried))[1][kind == k]) <= most:
            break
    return tried


def _both(flat: list[int], text: Callable[[int], str]) -> str:
    """The text of flat tows: once where warp and weft have the same."""
    each = [text(k) for k in flat]
    if len(set(each)) == 1:
        return each[0]
    return ", ".join(f"{t} ({('warp', 'weft')[k]})" for t, k in zip(each, flat, strict=True))


def _rungs_choice(tows: tuple[TowModel, TowModel], ribbon: Ribbon, soft: list[float], flat: list[int]) -> Choice:
    def modulus(k: int) -> str:
        return f"{ribbon.across[k] / tows[k].shape.thickness * 1e-3:.3g} MPa"

    reason = "the tow's modulus across, as its law has it at the load planned; chains slide along each other freely"
    worst = max(soft[k] for k in flat)
    if worst > 1:
        reason += f"; {worst:.3g} times softer, for the time step: the width gives by as much more"
    return Choice("across the ribbons", _both(flat, modulus), reason)


def _bending_choice(
    scene: Scene, system: FilamentSystem, tows: tuple[TowModel, TowModel], ribbon: Ribbon, flat: list[int]
) -> Choice:
    def rigidity(k: int) -> str:
        t = tows[k]
        return f"EI {t.whole.EI * 1e-15:.3g} out of it, {t.EI_in_plane * 1e-15:.3g} N mm2 in it"

    if not any(ribbon.bending[k] > 0 for k in flat):
        return Choice("bending in the ribbons' plane", "as out of it", _without(tows, flat))
    lengths, w = system.bond_lengths(), scene.weave
    span = float(np.max(lengths)) * max(ribbon.reach)
    wave = 2 * min(w.spacing.warp, w.spacing.weft)
    loss = float(chord_loss(span, wave))
    return Choice(
        "bending in the ribbons' plane",
        _both(flat, rigidity),
        f"improper_style ribbon, turns over chords of {max(ribbon.reach)} segments ({span:.3g} um), which keeps the "
        f"time step; that takes {loss:.1%} off bends {wave:.4g} um long",
    )


def _without(tows: tuple[TowModel, TowModel], flat: list[int]) -> str:
    """Why no more than the chains' own EI resists bending in the plane."""
    if all(tows[k].EI_in_plane <= tows[k].whole.EI * (1 + NOTICEABLE) for k in flat):
        return "that of filaments which slide past each other is the same both ways: the chains have it"
    solid = _both(flat, lambda k: f"{tows[k].EI_in_plane / tows[k].whole.EI:.3g} times more")
    return (
        f"a solid tow has {solid}, but platens on a held cell bend it little (1e-4 of the thickness of carbon-satin); "
        "EI_in_plane asks for it, [cell] too"
    )


def _twist_choice(tows: tuple[TowModel, TowModel], flat: list[int]) -> Choice:
    return Choice(
        "twist of the ribbons",
        _both(flat, lambda k: f"GJ {tows[k].whole.GJ * 1e-15:.3g} N mm2"),
        "from rung to rung; chains alone resist small twists by their tension only",
    )
