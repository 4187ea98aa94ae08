"""Speed of whole runs: processor seconds, node-steps a second and core, memory, engine seconds against the plan's.

python analysis/bench_run.py [PART ...] [--ranks 1,2] [--only CASE,...] [--contact capsule,beads] [--most SECONDS]

Parts: contact (default), capsules beside beads on the bundles of the charts, loading alone; levels, a few micrometres
at every level. Seconds are those of the processors, all ranks together; other work on the machine lengthens them (by a
third was seen), far less than time on the clock. The loaded state is the last fifth of the steps. A run that the plan
takes for dearer than --most seconds is cut short, and its seconds are carried to the whole by the steps: marked >, as
steps under load take longer than those before.
"""

from __future__ import annotations

import argparse
import os
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path

from cgfibre.chart import LOADING_ALONE
from cgfibre.workflow import RunOptions, plan_scene, run_scene

#: a few micrometres are enough: time a step hardly depends on the level's depth
SHORT = ("platens.stop.displacement=3 um", "platens.unload=false", "model.accuracy=0.2", "model.speed_check=false")
#: scene, displacement um, and the processor seconds aimed at with capsules
CASES = {
    "carbon-37-12": ("carbon-37", 12.0, 5.0),
    "carbon-37-30": ("carbon-37", 30.0, 20.0),
    "carbon-127-40": ("carbon-127", 40.0, 60.0),
}
LOADED = 0.8  # of the steps: what comes later is the loaded state
#: measured elsewhere, not by this script: 37 filaments of 26 nodes, one core, by the size of the time step
YADE = "YADE capsule beams, 37 filaments of 26 nodes to 10 um: 15 to 76 CPU s, 254 MB (measured once, elsewhere)"


def _engines() -> list[Path]:
    """/proc folders of this process's descendants that are engines."""
    parents, names = {}, {}
    for stat in Path("/proc").glob("[0-9]*/stat"):
        try:
            text = stat.read_text()
        except OSError:  # ended meanwhile
            continue
        pid, name, after = text.split(" ", 1)[0], text[text.index("(") + 1 : text.rindex(")")], text[text.rindex(")") :]
        parents[pid], names[pid] = after.split()[2], name

    def ours(pid: str) -> bool:
        while pid in parents:
            pid = parents[pid]
            if pid == str(os.getpid()):
                return True
        return False

    return [Path("/proc") / pid for pid, name in names.items() if name == "lmp" and ours(pid)]


@dataclass
class Meter:
    """Steps and processor seconds as a run goes on, and the most memory of its engines together, MiB."""

    steps: list[int] = field(default_factory=list)
    seconds: list[float] = field(default_factory=list)
    memory: float = 0.0

    def __call__(self, step: int, planned: int, displacement: float, force: float) -> None:
        """The signature of a run's progress."""
        ticks, memory = 0, 0.0
        for engine in _engines():
            try:
                after = (engine / "stat").read_text().rpartition(")")[2].split()
                status = (engine / "status").read_text()
            except OSError:
                continue
            ticks += int(after[11]) + int(after[12])
            memory += int(status.partition("VmHWM:")[2].split()[0]) / 1024 if "VmHWM:" in status else 0.0
        self.memory = max(self.memory, memory)
        if ticks and (not self.steps or step > self.steps[-1]):
            self.steps.append(step)
            self.seconds.append(ticks / os.sysconf("SC_CLK_TCK"))

    def loaded(self) -> float:
        """Processor seconds a step in the last part of the run; nan where it was too short to be looked at."""
        late = [k for k, step in enumerate(self.steps) if step >= LOADED * self.steps[-1]] if self.steps else []
        if len(late) < 2:
            return float("nan")
        first, last = late[0], late[-1]
        return (self.seconds[last] - self.seconds[first]) / (self.steps[last] - self.steps[first])


def run_case(scene: str, depth: float, overrides: Sequence[str], ranks: int, most: float) -> str:
    """Cells of the table: nodes, steps, CPU s of the whole, Mnode-steps/s/core whole and loaded, MiB, plan s, depth."""
    _, plan = plan_scene(scene, overrides)
    run_to, asked, short = depth, overrides, plan
    while short.predicted_seconds > most:  # the same speeds, for less long
        run_to *= 0.8
        asked = (*overrides, f"platens.stop.displacement={run_to!r} um")
        _, short = plan_scene(scene, asked)
    meter = Meter()
    with tempfile.TemporaryDirectory() as out:
        options = RunOptions(Path(out) / "run", ranks=ranks, pictures=False)
        s = run_scene(scene, options, asked, progress=meter).summary
    step = s["engine_cpu_s"] / s["n_steps"]
    sign = ">" if run_to < depth else ""
    rate, loaded = (1e-6 * s["n_beads"] / t for t in (step, meter.loaded()))
    return (
        f"{s['n_beads']:6d} {plan.planned_steps:8d} {sign + format(step * plan.planned_steps, '.3g'):>8s} "
        f"{rate:8.2f} {loaded:8.2f} {meter.memory:6.0f} {plan.predicted_seconds:7.1f} {run_to:7.1f}"
    )


HEAD = (
    f"{'nodes':>6s} {'steps':>8s} {'CPU s':>8s} {'M/s/core':>8s} {'loaded':>8s} {'MiB':>6s} {'plan s':>7s} "
    f"{'run, um':>7s}"
)


def contact(arguments: argparse.Namespace) -> None:
    """Capsules beside beads, loading alone, at each scene's own accuracy."""
    print(f"{'case':14s} {'contact':8s} {'ranks':>5s} {HEAD} {'aim s':>6s}")
    for name in arguments.only.split(",") if arguments.only else CASES:
        scene, depth, aim = CASES[name]
        for shape in arguments.contact.split(","):
            for ranks in (int(n) for n in arguments.ranks.split(",")):
                overrides = (*LOADING_ALONE, f"platens.stop.displacement={depth!r} um", f"contact.shape={shape}")
                cells = run_case(scene, depth, overrides, ranks, arguments.most)
                print(f"{name:14s} {shape:8s} {ranks:5d} {cells} {aim:6.0f}", flush=True)
    print(YADE)


def levels(arguments: argparse.Namespace) -> None:
    """Every level of two scenes, a few micrometres deep."""
    print(f"{'scene':14s} {'level':8s} {'ranks':>5s} {HEAD}")
    for scene in ("carbon-7", "carbon-37"):
        for level in ("chain", "rod", "section"):
            for ranks in (int(n) for n in arguments.ranks.split(",")):
                if level == "section" and ranks > 1:
                    continue
                cells = run_case(scene, 3.0, (*SHORT, f"model.level={level}"), ranks, arguments.most)
                print(f"{scene:14s} {level:8s} {ranks:5d} {cells}", flush=True)


PARTS = {"contact": contact, "levels": levels}


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("parts", nargs="*", default=["contact"], help=", ".join(PARTS))
    parser.add_argument("--ranks", default="1")
    parser.add_argument("--only", default="", metavar="CASE,...", help=", ".join(CASES))
    parser.add_argument("--contact", default="capsule,beads")
    parser.add_argument("--most", type=float, default=240.0, help="predicted seconds of one run [240]")
    arguments = parser.parse_args()
    for part in arguments.parts:
        PARTS[part](arguments)


if __name__ == "__main__":
    main()
