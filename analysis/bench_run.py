"""Speed of whole runs by level: bead-steps a second, engine seconds against the plan's, cgfibre's own share.

python analysis/bench_run.py [--scenes carbon-7,carbon-37]
"""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path

from cgfibre.workflow import RunOptions, plan_scene, run_scene

#: a few micrometres are enough: time a step hardly depends on the depth
SHORT = ("platens.stop.displacement=3 um", "platens.unload=false", "model.accuracy=0.2", "model.speed_check=false")


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--scenes", default="carbon-7,carbon-37")
    parser.add_argument("--ranks", default="1,2")
    arguments = parser.parse_args()
    print(
        f"{'scene':12s} {'level':8s} {'ranks':>5s} {'beads':>6s} {'steps':>8s} {'engine s':>9s} {'plan s':>7s} "
        f"{'Mbead-steps/s':>13s} {'own share':>9s}"
    )
    for scene in arguments.scenes.split(","):
        for level in ("chain", "rod", "section"):
            for ranks in (int(n) for n in arguments.ranks.split(",")):
                if level == "section" and ranks > 1:
                    continue
                overrides = (*SHORT, f"model.level={level}")
                _, plan = plan_scene(scene, overrides)
                with tempfile.TemporaryDirectory() as out:
                    s = run_scene(scene, RunOptions(Path(out) / "run", ranks=ranks), overrides).summary
                work = s["n_beads"] * s["n_steps"]
                print(
                    f"{scene:12s} {level:8s} {ranks:5d} {s['n_beads']:6d} {s['n_steps']:8d} {s['engine_s']:9.2f} "
                    f"{plan.predicted_seconds:7.1f} {work / s['engine_s'] * 1e-6:13.2f} "
                    f"{1 - s['engine_s'] / s['wall_s']:9.1%}",
                    flush=True,
                )


if __name__ == "__main__":
    main()
