"""When the tows and filaments of a weave are rods, and what either level leaves out."""

from __future__ import annotations

from cgfibre.errors import InputError
from cgfibre.plan.model import Choice, Omission
from cgfibre.plan.tows import TowModel
from cgfibre.scene import Scene

#: width over thickness up to which a tow may be a rod: wider ones do not roll on a radius of half their thickness
ROUND = 1.5


def level_of_tows(scene: Scene, tows: tuple[TowModel, TowModel]) -> Choice:
    """Chains unless rods are asked for, or a torsional rigidity is given to round tows, which no chain would heed;
    InputError for rods of flat tows."""
    asked = scene.model.level
    flat = any(t.chains > 1 or t.shape.width > ROUND * t.shape.thickness for t in tows)
    if asked == "rod" and flat:
        expected = f"'auto' or 'chain' for tows wider than {ROUND:g} thicknesses: a rod is round and rolls, they cannot"
        raise InputError("model.level", "rod", expected)
    if asked != "auto":
        return Choice("level", asked, "as asked in the scene")
    given = [name for name, tow in (("tow", scene.weave.tow), ("weft", scene.weave.weft)) if tow.GJ is not None]
    if given and not flat:
        return Choice("level", "rod", f"assembly.{given[0]}.GJ is given, which chains would leave out")
    why = "round tows of a fabric hardly twist or roll (rods: 0.03 % in thickness, at twice the cost)"
    if flat:
        why = "stretch and bending of tows, twist of ribbons; flat tows do not roll"
    return Choice("level", "chain", why)


def torsion_choices(scene: Scene, level: str, tows: tuple[TowModel, TowModel]) -> list[Choice]:
    """Where the torsional rigidity of rods comes from; nothing of chains, which have none."""
    if level != "rod":
        return []
    origins = []
    for tow, model in zip((scene.weave.tow, scene.weave.weft), tows, strict=True):
        why = "filaments that slide past each other: the sum of theirs (a twisted or sized yarn has more: GJ)"
        if tow.GJ is not None:
            why = "as asked in the scene"
        elif tow.modulus is not None:
            why = "a solid of its section and of the filament's G12"
        origins.append((f"GJ {model.whole.GJ * 1e-15:.3g} N mm2", why))
    if origins[0] == origins[1]:
        origins.pop()
    names = ("",) if len(origins) == 1 else (" of warp", " of weft")
    return [Choice(f"torsion{name}", *origin) for name, origin in zip(names, origins, strict=True)]


def left_out(level: str, what: str) -> tuple[Omission, ...]:
    """What a level leaves out of the twist of ``what`` (tows or filaments)."""
    if level == "rod":
        return (
            Omission(
                f"resistance of {what} to rolling",
                "round sections roll on lines, they do not flatten",
                f"{what} turn too easily; limp ones do so in place of sliding, and feel no friction",
            ),
        )
    error = "0.03 % in thickness, 0.6 % where tows are so limp that friction turns their sections (level = 'rod')"
    if what == "filaments":
        error = "0.4 % in thickness; filaments roll by up to 0.5 rad (level = 'rod', at twice the cost)"
    return (
        Omission(f"twist and rolling of {what}", f"beads of a chain do not spin, friction cannot roll {what}", error),
    )
