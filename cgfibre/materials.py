"""Fibre materials with their sources.

Moduli are those of one filament, transversely isotropic about its axis (1 along, 2 and 3 across). Engine units: um,
kPa, pg/um^3 (1 GPa = 1e6 kPa, 1000 kg/m^3 = 1 pg/um^3).
"""

from __future__ import annotations

import difflib
from dataclasses import dataclass

from cgfibre.errors import InputError


@dataclass(frozen=True)
class Material:
    """Constants of one filament.

    Attributes: ``diameter`` um; ``E1``, ``E2`` Young's moduli along and across, ``G12``, ``G23`` shear moduli, kPa;
    ``nu12``, ``nu23`` Poisson's ratios; ``density`` pg/um^3; ``source`` where they come from.
    """

    name: str
    diameter: float
    E1: float
    E2: float
    nu12: float
    nu23: float
    G12: float
    G23: float
    density: float
    source: str


def isotropic_shear_modulus(young: float, poisson: float) -> float:
    """Shear modulus E / (2 (1 + nu)) of an isotropic solid, in the unit of ``young``.

    In the plane across a fibre the same relation gives G23 from E2 and nu23. Raises :class:`InputError` for
    nu <= -1.
    """
    if not poisson > -1.0:
        raise InputError("poisson", poisson, "a Poisson's ratio above -1")
    return young / (2.0 * (1.0 + poisson))


def _isotropic(name: str, diameter: float, young: float, poisson: float, density: float, source: str) -> Material:
    shear = isotropic_shear_modulus(young, poisson)
    return Material(name, diameter, young, young, poisson, poisson, shear, shear, density, source)


#: name -> material. Table to extend: a scene finds what is entered here.
#:
#: Nylon: Table 8-2 prints EI = 0.22e-3 N mm2 beside E = 1.05 GPa and a diameter of 300 um. A solid fibre of 300 um has
#: EI = 0.4175 N mm2; the printed value is that of a 45 um fibre. E and diameter are kept here, EI follows from them.
MATERIALS: dict[str, Material] = {
    m.name: m
    for m in (
        Material(
            name="T700 carbon",
            diameter=7.0,
            E1=230e6,
            E2=10e6,
            nu12=0.256,
            nu23=0.300,
            G12=27.3e6,
            G23=3.85e6,
            density=1.8,
            source="N. D. Chakladar, PhD thesis, The University of Manchester, 2014, Table 4-1",
        ),
        _isotropic(
            name="E-glass",
            diameter=9.0,
            young=72.5e6,
            poisson=0.22,
            density=2.58,
            source="W. D. Callister and D. G. Rethwisch, Materials Science and Engineering, 8th ed., Tables B.1 to B.3"
            " (isotropic); diameter of an EC9 weaving yarn (ISO 2078)",
        ),
        _isotropic(
            name="steel wire",
            diameter=100.0,
            young=207e6,
            poisson=0.30,
            density=7.85,
            source="W. D. Callister and D. G. Rethwisch, Materials Science and Engineering, 8th ed., Tables B.1 to B.3"
            " (plain carbon steel, isotropic); diameter of a fine spring wire (EN 10270-1 has 0.05 mm and more)",
        ),
        Material(
            name="E-glass yarn",
            diameter=300.0,
            E1=40.15e6,
            E2=75e3,
            nu12=0.2,
            nu23=0.2,
            G12=5e3,
            G23=31.25e3,
            density=2.62,
            source="Chakladar 2014, Table 7-2 (Chomarat 150TB): a whole yarn made homogeneous, not a filament;"
            " the diameter is the fabric's thickness, the yarn being 0.82 mm wide",
        ),
        _isotropic(
            name="nylon",
            diameter=300.0,
            young=1.05e6,
            poisson=0.39,
            density=1.172,
            source="Chakladar 2014, Table 8-2, without its EI (that of a 45 um fibre); isotropic, Poisson's ratio of"
            " nylon 6,6 from Callister and Rethwisch, 8th ed., Table B.3",
        ),
    )
}


def find_material(name: object, key: str = "filament.material") -> Material:
    """The library's material called ``name``; raises :class:`InputError` naming ``key``, with near names, if none."""
    if isinstance(name, str) and name in MATERIALS:
        return MATERIALS[name]
    expected = "one of " + ", ".join(repr(m) for m in MATERIALS)
    lower = {m.lower(): m for m in MATERIALS}
    near = difflib.get_close_matches(name.lower(), lower, n=1, cutoff=0.5) if isinstance(name, str) else []
    raise InputError(key, name, expected + (f" (did you mean {lower[near[0]]!r}?)" if near else ""))
