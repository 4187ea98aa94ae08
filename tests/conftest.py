"""A scene that presses seven filaments in a second, and runs of it that the tests share."""

import os
import shutil
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import pytest

from cgfibre import workflow

ROOT = Path(__file__).resolve().parent.parent
TINY = """\
description = "seven short filaments, pressed fast"
[filament]
material = "T700 carbon"
[assembly]
count = 7
length = "0.14 mm"
jitter = "0.01 um"
seed = 1
[platens]
width = "70 um"
speed = "1 m/s"
unload = true
[platens.stop]
displacement = "4 um"
[output]
frames = 10
samples = 40
"""


@dataclass(frozen=True)
class Bench:
    """Runs the tiny scene with overrides, in a folder of its own a call, without pictures."""

    scene: Path
    folder: Path

    def run(self, name, *overrides, **options):
        return workflow.run_scene(self.scene, workflow.RunOptions(self.folder / name, **options), overrides)


@pytest.fixture(scope="session")
def tiny(tmp_path_factory):
    """Path of the tiny scene."""
    path = tmp_path_factory.mktemp("scene") / "tiny.toml"
    path.write_text(TINY)
    return path


@pytest.fixture
def bench(tiny, tmp_path, monkeypatch):
    monkeypatch.setattr(workflow, "draw_all", lambda *args, **kwargs: [])
    return Bench(tiny, tmp_path)


@pytest.fixture(scope="session")
def finished(tiny, tmp_path_factory):
    """A finished run, with pictures and the text trajectory; do not write into it, take ``copied``."""
    out = tmp_path_factory.mktemp("finished") / "tiny"
    return workflow.run_scene(tiny, workflow.RunOptions(out), ["output.dump=true"])


@pytest.fixture
def copied(finished, tmp_path):
    """A copy of the finished run's folder."""
    return Path(shutil.copytree(finished.out, tmp_path / "copy"))


def cgfibre_command(*arguments):
    return [sys.executable, "-W", "error::RuntimeWarning", "-m", "cgfibre", *map(str, arguments)]


def cgfibre_environment(**extra):
    """Environment in which a child process finds this checkout."""
    return {**os.environ, "PYTHONPATH": str(ROOT), **extra}


@pytest.fixture
def cgfibre(tmp_path):
    """``cgfibre VERB ...`` as a process of its own, in an empty folder."""

    def call(*arguments, cwd=None, env=None):
        return subprocess.run(
            cgfibre_command(*arguments),
            cwd=cwd or tmp_path,
            env=env or cgfibre_environment(),
            capture_output=True,
            text=True,
            timeout=120,
            check=False,
        )

    return call
