"""Analytic plain weaves that the tests of fabrics share: z = +-A cos(pi u/s), crossings at (i + 1/2) s."""

import numpy as np

from cgfibre.build.system import FilamentSystem, FilamentType

S = 100.0  # spacing of the tows, um


def plain(n=2, amplitude=10.0, diameter=20.0, per_spacing=16, periodic=True, offsets=((0.0, 0.0),), spacing=S):
    """n x n tows, each of filaments at `offsets` (across, z) from its centre line; beads at equal steps of x or y."""
    size = n * spacing
    u = np.arange(n * per_spacing + (0 if periodic else 1)) * spacing / per_spacing
    chains, tow = [], []
    for axis in (0, 1):
        for k in range(n):
            sign = (-1) ** k * (1 if axis == 0 else -1)
            for across, up in offsets:
                # crests at the other tows' centres: the cosine's phase is half a spacing
                z = sign * amplitude * np.cos(np.pi * (u / spacing - 0.5)) + up
                chain = np.empty((len(u), 3))
                chain[:, axis], chain[:, 1 - axis], chain[:, 2] = u, (k + 0.5) * spacing + across, z
                chains.append(chain)
                tow.append(axis * n + k)
    count = len(chains)
    kind = FilamentType(diameter=diameter, EA=1e6, EI=1e6, GJ=1e6, kGA=1e6, mass_per_length=3.0)
    margin = 0 if periodic else 10.0
    return FilamentSystem(
        positions=np.concatenate(chains),
        filament_start=np.concatenate([[0], np.cumsum([len(c) for c in chains])]),
        closed=np.full(count, periodic),
        tow=np.array(tow),
        filament_type=np.zeros(count, dtype=np.int64),
        types=(kind,),
        box=np.array([[-margin, size + margin], [-margin, size + margin], [-500.0, 500.0]]),
        periodic=np.array([periodic, periodic, False]),
        prestrain=np.zeros(count),
    )
