"""Runs of small weaves for tests: without pictures, each in a folder of its own."""

import numpy as np
import tomli_w

from cgfibre import workflow
from cgfibre.measure.compaction import thickness_at_pressure

AT = np.array([0.05, 0.1, 0.19])  # MPa


class WeaveBench:
    """``tables`` makes the tables of a scene of changes."""

    def __init__(self, folder, tables):
        self.folder, self.tables = folder, tables

    def scene(self, changes):
        path = self.folder / "weave.toml"
        path.write_text(tomli_w.dumps(self.tables(changes)))
        return path

    def __call__(self, name, changes, **options):
        run = workflow.RunOptions(self.folder / name, pictures=False, **options)
        return workflow.run_scene(self.scene(changes), run)


def thickness(result):
    """um at the pressures AT of the loading."""
    c = result.curve
    return thickness_at_pressure(c["thickness_um"][c.loading], c["pressure_MPa"][c.loading], AT)
