"""The pictures of README.md, from a real run of carbon-37: results/carbon-37 if it is there, else a new one.

python analysis/readme_figures.py
"""

from __future__ import annotations

import shutil
from pathlib import Path

from cgfibre.workflow import RunOptions, measure_folder, run_scene

ROOT = Path(__file__).resolve().parent.parent
PICTURES = ("curve.png", "sections.png", "bundle.png")


def main() -> None:
    """Run or measure, then copy the pictures to docs/figures."""
    run = ROOT / "results" / "carbon-37"
    result = measure_folder(run) if (run / "results.h5").exists() else run_scene("carbon-37", RunOptions(run))
    target = ROOT / "docs" / "figures"
    target.mkdir(parents=True, exist_ok=True)
    for name in PICTURES:
        shutil.copyfile(result.out / name, target / f"carbon-37-{name}")
    print(
        f"peak force {result.summary['peak_force_N']:.3g} N, speed error {result.summary['speed_error']:.1%}; "
        f"pictures in {target.relative_to(ROOT)}"
    )


if __name__ == "__main__":
    main()
