"""cgfibre/laws/carbon-127.toml and docs/figures/subbundle-law.png: the law of 127 carbon filaments.

Derives the law from cells of filaments and of discs (five minutes of processor time) unless --draw says that the
shipped one is to be drawn as it is.

python analysis/homogenise.py [--cells N] [--rounds N] [--draw]
"""

from __future__ import annotations

import argparse
from pathlib import Path

from cgfibre.homogenise import LawOptions, derive_law, law_lines, section_scene
from cgfibre.plot_subbundle import figure_law
from cgfibre.scene_reading import load_scene
from cgfibre.subbundle_law import find_law

ROOT = Path(__file__).resolve().parent.parent
NAME = "carbon-127"


def main() -> None:
    """Derive, write, draw."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cells", type=int, default=8)
    parser.add_argument("--rounds", type=int, default=2)
    parser.add_argument("--draw", action="store_true")
    arguments = parser.parse_args()
    if not arguments.draw:
        scene = section_scene(load_scene("carbon-127-section", [f"name={NAME}"]))
        found = derive_law(scene, LawOptions(cells=arguments.cells, rounds=arguments.rounds), print)
        (ROOT / "cgfibre" / "laws" / f"{NAME}.toml").write_text(found.law.to_toml())
        find_law.cache_clear()
        print("\n".join(law_lines(found)))
    figure_law(find_law(NAME)).savefig(ROOT / "docs" / "figures" / "subbundle-law.png")


if __name__ == "__main__":
    main()
