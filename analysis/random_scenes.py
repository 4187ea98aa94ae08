"""Random scenes by blocks of seeds: what became of each, and every offender.

python analysis/random_scenes.py 0 20 --out /tmp/random      # blocks 0 to 19 of 25 scenes, through the engine
python analysis/random_scenes.py 0 200 --plan                # planned and built alone

One JSON line a scene goes to OUT/fates.jsonl, blocks that are there already are left out: run it again to go on. Every
third scene that is trusted runs once more at half its speed. Exit code 1 when a scene ended as none may.
"""

from __future__ import annotations

import argparse
import json
import shutil
import sys
from collections import Counter
from dataclasses import asdict
from pathlib import Path

sys.path.insert(0, str(Path(__file__).resolve().parent.parent / "tests"))

from random_scenes import CAP, built, fate_of, scenes_of

from cgfibre import workflow

SIZE = 25


def main() -> None:
    """Run the blocks asked for and count."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("first", type=int)
    parser.add_argument("end", type=int)
    parser.add_argument("--plan", action="store_true", help="plan and build alone, without the engine")
    parser.add_argument("--every", type=int, default=3, help="check the speed of every n-th scene")
    parser.add_argument("--cap", type=float, default=CAP, help="planned engine seconds a scene")
    parser.add_argument("--out", type=Path, default=Path("results/random-scenes"))
    asked = parser.parse_args()
    draw = workflow.draw_all
    asked.out.mkdir(parents=True, exist_ok=True)
    path = asked.out / ("plans.jsonl" if asked.plan else "fates.jsonl")
    rows = [json.loads(line) for line in path.read_text().splitlines()] if path.exists() else []
    done = {(row["block"], row["scene"]) for row in rows}
    with path.open("a") as out:
        for block in range(asked.first, asked.end):
            if all((block, i) in done for i in range(SIZE)):
                continue
            for i, data in enumerate(scenes_of(block, SIZE)):
                if (block, i) in done:
                    continue
                folder = asked.out / f"{block}-{i}"
                shutil.rmtree(folder, ignore_errors=True)
                # pictures take longer than most of these runs
                workflow.draw_all = draw if (block * SIZE + i) % 10 == 0 else lambda *args, **kwargs: []
                if asked.plan:
                    fate = built(data)
                else:
                    fate = fate_of(data, folder, (block * SIZE + i) % asked.every == 0, asked.cap)
                row = {"block": block, "scene": i, **asdict(fate)}
                if fate.offence:
                    row["data"] = data
                    print(f"{block}-{i}: {fate.kind} {fate.message}\n    {fate.offence}", flush=True)
                else:
                    shutil.rmtree(folder, ignore_errors=True)
                rows.append(row)
                out.write(json.dumps(row) + "\n")
                out.flush()
    rows = [row for row in rows if asked.first <= row["block"] < asked.end]
    print(f"{len(rows)} scenes:", dict(Counter(row["kind"] for row in rows).most_common()))
    print("refused:", dict(Counter(r["message"].split(" = ")[0] for r in rows if r["kind"] == "refused").most_common()))
    print("guards:", dict(Counter(g for r in rows for g in r["guards"]).most_common()))
    print("stopped:", dict(Counter(r["message"][:90] for r in rows if r["kind"] == "stopped").most_common(12)))
    checked = [r["change"] for r in rows if r["change"] == r["change"]]
    print(f"trusted and run at half the speed: {len(checked)}, largest change {max(checked, default=0):.3g}")
    offenders = [f"{r['block']}-{r['scene']}" for r in rows if r["offence"]]
    print(f"offenders: {len(offenders)}", *offenders)
    sys.exit(1 if offenders else 0)


if __name__ == "__main__":
    main()
