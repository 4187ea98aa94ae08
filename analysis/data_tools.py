"""Figures and tables of docs/test_data.md: rendered micrographs, synthetic tow tests, the thesis' line contact.

python analysis/data_tools.py [micrographs] [tow_tests] [line_contact]

No record or picture of a real specimen ships: the micrographs are drawn from known filaments, the tow tests computed
from a known law with noise, so that what the tools find can be compared with what is there.
"""

from __future__ import annotations

import sys
import tempfile
import time
from dataclasses import replace
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from PIL import Image
from rendered_sections import CASES, PLAIN, UM, Microscope, bundle, score
from towtest_records import LAW, write_set

from cgfibre import micrograph, plot, towtest
from cgfibre.measure.section_image import find_filaments
from cgfibre.mechanics.compaction_laws import Conditions
from cgfibre.mechanics.contact import LineContact
from cgfibre.mechanics.line_stress import plane_strain_poisson, subsurface_stress
from cgfibre.workflow import RunOptions, run_scene

FIGURES = Path(__file__).resolve().parent.parent / "docs" / "figures"
CONDITIONS = [Conditions(*c) for c in ((1.5, 0.26, 10), (1.5, 0.55, 10), (6, 0.38, 30), (12, 0.26, 10), (12, 0.55, 50))]
SEEDS = range(5)


def shrink(picture: Path, target: Path, width: int = 1300, photograph: bool = False) -> None:
    """A copy of ``width`` pixels at most, for the repository; of a photograph 256 colours do."""
    with Image.open(picture) as image:
        size = min(width, image.width), round(image.height * min(width, image.width) / image.width)
        small = image.convert("RGB").resize(size, Image.Resampling.LANCZOS)
        (small.quantize(256) if photograph else small).save(target, optimize=True)


def micrographs(work: Path) -> None:
    """A rendered tow through the verb, and pressed; the table of the bars."""
    specimen = bundle(
        217, 0.66, Microscope(pixels_per_um=5.86, blur=1.6, noise=0.12, shade=0.4), np.random.default_rng(8)
    )
    Image.fromarray(specimen.picture).save(work / "tow.png")
    out = work / "section"
    options = micrograph.MicrographOptions(out, pixels_per_um=5.86, diameter=UM)
    found = micrograph.read_micrograph(work / "tow.png", options)
    print("\n".join(micrograph.report_lines(found)))
    shrink(out / "overlay.png", FIGURES / "micrograph-overlay.png", 760, photograph=True)
    shrink(out / "statistics.png", FIGURES / "micrograph-statistics.png")
    height = float(np.ptp(found.centres[:, 1])) + UM
    run = run_scene(out / "scene.toml", RunOptions(work / "run"), [f"platens.stop.thickness={0.6 * height:.4g} um"])
    shrink(run.out / "sections.png", FIGURES / "micrograph-run.png")
    print(f"pressed to {run.summary['least_thickness_um']:.1f} um: {run.summary['peak_force_N']:.3g} N")
    columns = ("pictures", "found", "false", "centre error r.m.s.", "largest", "diameter error", "its s.d.")
    print("| " + " | ".join(columns) + " |")
    print("|---" * len(columns) + "|")
    for name, (fraction, change, kwargs) in CASES.items():
        m = replace(PLAIN, **change)
        scores = []
        for seed in SEEDS:
            s = bundle(127, fraction, m, np.random.default_rng(100 + seed), **kwargs)
            f = find_filaments(s.picture, UM * m.pixels_per_um).filaments
            scores.append(score(s, f.centres, f.diameter))
        centre = np.concatenate([q.centre_error for q in scores])
        size = np.concatenate([q.diameter_error for q in scores])
        print(
            f"| {name} | {np.mean([q.found for q in scores]):.2%} | {np.mean([q.false for q in scores]):.2%} | "
            f"{np.sqrt(np.mean(centre**2)):.3f} D | {centre.max():.3f} D | {size.mean():+.1%} | {size.std():.1%} |"
        )


def tow_tests(work: Path) -> None:
    """A set of synthetic tests through the verb, with the touch fitted and out of the noise."""
    folder = work / "tests"
    folder.mkdir()
    paths = write_set(folder, CONDITIONS, 3, np.random.default_rng(0))
    print(f"law that the records were made from: {LAW}")
    for touch in ("noise", "fit"):
        out = work / f"towtest-{touch}"
        result = towtest.analyse_tests(paths, towtest.TowOptions(out, touch=touch, at=(1.0, 5.0)))
        print("\n".join(towtest.report_lines(result)))
    for name in ("towtest", "laws"):
        shrink(out / f"{name}.png", FIGURES / f"towtest-{name}.png")


def line_contact(work: Path) -> None:
    """The thesis' case, isotropic and with the filament's own anisotropy; the shear stress under it (no files)."""
    f, r, e = 2e6, 3.5, 10e6  # 2 N on 1 mm
    y = np.linspace(-1.2, 1.2, 601)
    nu = float(plane_strain_poisson(230e6, e, 0.256))
    curves = []
    for label, ratio in (("isotropic, ν 0.3 (the thesis')", 0.3), ("transversely isotropic T700", nu)):
        pair = LineContact.between(r, r, e, ratio, e, ratio)
        peak = pair.peak_pressure(f) * 1e-6
        curves.append(
            plot.ContactCurve(y, pair.pressure(y, f), f"{label}: b {pair.half_width(f):.2f} µm, {peak:.2f} GPa")
        )
        print(f"{label}: b {pair.half_width(f):.4f} um, peak {pair.peak_pressure(f) * 1e-3:.0f} MPa")
    pair = LineContact.between(r, r, e, nu, e, nu)
    z = np.linspace(0, 2.4, 241)
    stress = subsurface_stress(y[None, :], z[:, None], float(pair.half_width(f)), float(pair.peak_pressure(f)))
    fig = plot.new_figure(11.0, 4.2)
    with plot.style():
        left, right = fig.subplots(1, 2)
    plot.plot_contact_pressure(left, curves)
    plot.plot_shear_map(right, y, z, stress.greatest_shear * 1e-6, "Greatest shear stress (GPa)")
    fig.savefig(FIGURES / "line-contact.png")
    shrink(FIGURES / "line-contact.png", FIGURES / "line-contact.png")


PARTS = {"micrographs": micrographs, "tow_tests": tow_tests, "line_contact": line_contact}


def main() -> None:
    """All figures to docs/figures, all numbers to the screen."""
    begin = time.perf_counter()
    with tempfile.TemporaryDirectory() as folder:
        for part in sys.argv[1:] or ("micrographs", "tow_tests", "line_contact"):
            PARTS[part](Path(folder))
    print(f"{time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    main()
