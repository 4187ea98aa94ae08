"""What a deck of sub-bundles says of their contact: the tables of the law and who touches whom how."""

from __future__ import annotations

import numpy as np

from cgfibre.build.system import FloatArray
from cgfibre.plan.contact import TANGENTIAL_DAMPING, TANGENTIAL_RATIO
from cgfibre.plan.model import Discs, Plan

LAW_FILE = "law.txt"


def table_text(sections: dict[str, tuple[FloatArray, FloatArray]], about: str) -> str:
    """Text of a table file of the plugin: a section of (argument, value) for every keyword."""
    lines = [f"# {about}"]
    for keyword, (x, y) in sections.items():
        lines += ["", keyword, f"N {len(x)}"]
        lines += [f"{i + 1} {a:.17g} {b:.17g}" for i, (a, b) in enumerate(zip(x.tolist(), y.tolist(), strict=True))]
    return "\n".join(lines) + "\n"


def law_text(discs: Discs) -> str:
    """The law of two sub-bundles and that of one on a platen, which is the plane of symmetry between two: half the
    overlap at the same force. Overlap um, force nN/um of depth."""
    x, load = np.array(discs.overlap), np.array(discs.load)
    sections = {"PAIR": (x, load), "PLATEN": (x / 2, load)}
    if discs.unload is not None:
        unload = np.array(discs.unload)
        sections |= {"PAIR_UNLOAD": (x, unload), "PLATEN_UNLOAD": (x / 2, unload)}
    return table_text(sections, "cgfibre sub-bundle law: overlap um, force nN/um of depth")


def series(first: FloatArray, second: FloatArray) -> FloatArray:
    """Stiffness factor of two bodies in contact of the factors ``first`` and ``second``: in series, 2/(1/a + 1/b)."""
    return np.asarray(2 / (1 / first + 1 / second))


def law_files(discs: Discs, plan: Plan) -> tuple[dict[str, float | int | str], dict[str, FloatArray], dict[str, str]]:
    """(parameters, columns of numbers, texts) of a deck of sub-bundles: kinds of them and lengths of contact."""
    factors = np.array(discs.factors)
    n = len(factors)
    first, second = (k.astype(float) for k in np.triu_indices(n))
    pairs = series(factors[first.astype(int)], factors[second.astype(int)])
    parameters: dict[str, float | int | str] = {
        "contact_shape": "subbundle",
        "contact_law": f"table {LAW_FILE} PAIR" + ("" if discs.unload is None else " unload PAIR_UNLOAD"),
        "platen_law": f"table {LAW_FILE} PLATEN" + ("" if discs.unload is None else " unload PLATEN_UNLOAD"),
        "contact_damping": plan.contact.gamma,
        "contact_friction": plan.contact.friction,
        "contact_kt_ratio": TANGENTIAL_RATIO,
        "tangential_damping": TANGENTIAL_DAMPING,
        "platen_damping": plan.platens.gamma,
        "subbundle_kinds": n,
        "subbundle_pairs": len(pairs),
    }
    tables = {
        "pair_first.txt": first + 1,
        "pair_second.txt": second + 1,
        "pair_lengths.txt": pairs * plan.depth,
        "kind_lengths.txt": factors * plan.depth,
    }
    return parameters, tables, {LAW_FILE: law_text(discs)}
